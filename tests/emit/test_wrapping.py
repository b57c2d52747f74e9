"""Where long lines of C are broken."""

from __future__ import annotations

import pytest

from esea_gen.emit.wrapping import wrap

#    ....|....1....|....2....|....3....|....4
CASES = (
    (  # at a sum, not inside its product; what stands deeper goes deeper
        "    v = aaaaaaaaa + f(bbbbbbbbbbbbbbbbbbb, cccccccccccccccccc);",
        "    v = aaaaaaaaa\n            + f(bbbbbbbbbbbbbbbbbbb,\n"
        "                cccccccccccccccccc);",
    ),
    (
        "    x = aaaaaaaaaaaaaa || bbbbbbbb && ccccc || dddddd;",
        "    x = aaaaaaaaaaaaaa\n            || bbbbbbbb && ccccc\n            || dddddd;",
    ),
    (  # behind a bracket where nothing else helps
        "    a_function_of_twenty_s(one_of_twenty_four_letters);",
        "    a_function_of_twenty_s(\n            one_of_twenty_four_letters);",
    ),
    (
        "#define NAME (aaaaaaaaaaaaa + bbbbbbbb + ccccccccccc)",
        "#define NAME (aaaaaaaaaaaaa + bbbbbbbb \\\n        + ccccccccccc)",
    ),
    (  # a string stays whole
        '    say("a + b, c && d || e \\" f+g", x, yyyyyyyy);',
        '    say("a + b, c && d || e \\" f+g", x,\n            yyyyyyyy);',
    ),
    (  # what cannot be broken stays
        "    an_array_of_names[another_array_of_names[iiiii]];",
        "    an_array_of_names[another_array_of_names[iiiii]];",
    ),
    (  # inside a comment nothing is code
        "/*\n * aaaaaaaaaa + bbbbbbbbbb * cccccccccc + ddd\n */",
        "/*\n * aaaaaaaaaa + bbbbbbbbbb * cccccccccc\n * + ddd\n */",
    ),
)


@pytest.mark.parametrize(("line", "expected"), CASES)
def test_a_line_is_broken_at_its_loosest_place(line, expected):
    assert wrap(line, 40) == expected
    assert wrap(expected, 40) == expected
    # No other character changes.
    assert "".join(expected.replace("\\\n", "").split()).replace("*", "") == "".join(
        line.split()
    ).replace("*", "")
