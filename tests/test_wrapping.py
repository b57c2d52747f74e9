"""Where long lines of C are broken: forty columns, every break chosen by hand."""

from __future__ import annotations

import pytest

from esea_gen.emit.wrapping import WIDTH, wrap

#        ....|....1....|....2....|....3....|....4
CODE = {
    "a sum before its last term that fits, not inside a product": (
        "    x = aaaaaaaaaa + bbbbbbbbbb * cccccccccc + dddddddd;",
        "    x = aaaaaaaaaa\n            + bbbbbbbbbb * cccccccccc\n            + dddddddd;",
    ),
    "a product where there is no sum": (
        "    x = aaaaaaaaaaaaaa * bbbbbbbbbbbb * ccccccccc;",
        "    x = aaaaaaaaaaaaaa * bbbbbbbbbbbb\n            * ccccccccc;",
    ),
    "and before comparisons": (
        "    if (aaaaaaaa < bbbbbbbbbb && ccccc < dddddddd) {",
        "    if (aaaaaaaa < bbbbbbbbbb\n            && ccccc < dddddddd) {",
    ),
    "or before and": (
        "    x = aaaaaaaaaaaaaa || bbbbbbbb && ccccc || dddddd;",
        "    x = aaaaaaaaaaaaaa\n            || bbbbbbbb && ccccc\n            || dddddd;",
    ),
    "a choice before all": (
        "    y = aaaaaaaaaaaaa || bbbbbbbb ? cccc : ddddddddd;",
        "    y = aaaaaaaaaaaaa || bbbbbbbb ? cccc\n            : ddddddddd;",
    ),
    "a line that fits to its last column": (
        "    y = aaaaaaaaaaaaaaaa < bbbbbbbbbbbbb ? ccccccccc : ddddddd;",
        "    y = aaaaaaaaaaaaaaaa < bbbbbbbbbbbbb\n            ? ccccccccc : ddddddd;",
    ),
    "bits of a word one by one": (
        "    x = aaaaaaaaaaaa | bbbbbbbbbbbb | cccccccc;",
        "    x = aaaaaaaaaaaa | bbbbbbbbbbbb\n            | cccccccc;",
    ),
    "arguments behind their comma": (
        "    call(aaaaaaaaaaaa, bbbbbbbbbbbbb, ccccccccccccc, ddd);",
        "    call(aaaaaaaaaaaa, bbbbbbbbbbbbb,\n            ccccccccccccc, ddd);",
    ),
    "a sum outside of brackets before one inside": (
        "    v = (aaaaaaaaaa + bbbbbb) + (ccccc + dddd + eeee);",
        "    v = (aaaaaaaaaa + bbbbbb)\n            + (ccccc + dddd + eeee);",
    ),
    "what stands deeper goes deeper": (
        "    v = aaaaaaaaa + f(bbbbbbbbbbbbbbbbbbb, cccccccccccccccccc);",
        "    v = aaaaaaaaa\n            + f(bbbbbbbbbbbbbbbbbbb,\n"
        "                cccccccccccccccccc);",
    ),
    "behind an equals sign where nothing else helps": (
        "    a_name_of_twenty_letters = one_of_twenty_four_letters;",
        "    a_name_of_twenty_letters =\n            one_of_twenty_four_letters;",
    ),
    "behind a bracket where nothing else helps": (
        "    a_function_of_twenty_s(one_of_twenty_four_letters);",
        "    a_function_of_twenty_s(\n            one_of_twenty_four_letters);",
    ),
    "behind the outer of two brackets": (
        "    outer_function_name(inner(a_long_argumen));",
        "    outer_function_name(\n            inner(a_long_argumen));",
    ),
    "not within the first third, where there is a later place": (
        "    aaaaaaaa || bbbbbbbbbb * cccccccccc * dddd;",
        "    aaaaaaaa || bbbbbbbbbb * cccccccccc\n            * dddd;",
    ),
    "but right behind it": (
        "    aaaaaaaaa || bbbbbbbbbb * cccccccccc * dddd;",
        "    aaaaaaaaa\n            || bbbbbbbbbb * cccccccccc\n            * dddd;",
    ),
    "what stands deeper goes deeper, three times at most": (
        "    a(b, c(d, e(f, g(h, i(jjjjjjjjjjjj, kkkkkkkkkkkkkkk)))));",
        "    a(b, c(d,\n                e(f,\n                    g(h, i(jjjjjjjjjjjj,\n"
        "                        kkkkkkkkkkkkkkk)))));",
    ),
    "a macro carries on": (
        "#define NAME (aaaaaaaaaaaaa + bbbbbbbb + ccccccccccc)",
        "#define NAME (aaaaaaaaaaaaa + bbbbbbbb \\\n        + ccccccccccc)",
    ),
    "with room for its backslash": (
        "#define NAME (aaaaaaaaaaaaa + bbbbbbbbb + ccccccccccc)",
        "#define NAME (aaaaaaaaaaaaa \\\n        + bbbbbbbbb + ccccccccccc)",
    ),
    "an index is no call": (
        "    an_array_of_names[another_array_of_names[iiiii]];",
        "    an_array_of_names[another_array_of_names[iiiii]];",
    ),
    "a string stays whole": (
        '    say("a + b, c && d || e \\" f+g", x, yyyyyyyy);',
        '    say("a + b, c && d || e \\" f+g", x,\n            yyyyyyyy);',
    ),
    "commas inside a string are none": (
        '    say(xxxxxxxxxx, "aaaa, bbbb, cccccc, dddd");',
        '    say(xxxxxxxxxx,\n            "aaaa, bbbb, cccccc, dddd");',
    ),
    "a quote between quotes of the other kind begins no string": (
        "    put(xxxxxxxxxx, '\"', aaaa, bbbbbbbbbbbbbb, cc);",
        "    put(xxxxxxxxxx, '\"', aaaa,\n            bbbbbbbbbbbbbb, cc);",
    ),
    "a negative number is no difference": (
        "    x = call(aaaaaaaaaaaaaaaaaa, -bbbb) + - ccccc;",
        "    x = call(aaaaaaaaaaaaaaaaaa, -bbbb)\n            + - ccccc;",
    ),
}


@pytest.mark.parametrize("name", CODE)
def test_code_is_broken_at_its_loosest_place(name):
    line, expected = CODE[name]
    assert len(line) > 40
    assert wrap(line, 40) == expected
    assert wrap(line + "\nint x;\n", 40) == expected + "\nint x;\n"
    assert wrap(expected, 40) == expected
    # No other character changes.
    assert "".join(expected.replace("\\\n", "").split()) == "".join(line.split())


def test_a_line_of_the_width_stays_and_one_more_does_not():
    assert WIDTH == 100
    for width in (30, 40):
        fits = "x = " + "a" * (width - 8) + " + b"
        assert len(fits) == width
        assert wrap(fits, width) == fits
        assert wrap(fits + ";", width) == "x = " + "a" * (width - 8) + "\n        + b;"
    line = "x = " + "a" * 92 + " + b"
    assert wrap(line) == line
    assert "\n" in wrap(line + ";")


COMMENTS = {
    "behind code it goes above": (
        "    int aaaaaaaaaaaaaaaaaaaa; /* what it is for */",
        "    /* what it is for */\n    int aaaaaaaaaaaaaaaaaaaa;",
    ),
    "above it may be broken itself, and so may the code": (
        "    int aaaaaaaaaaaaaaaaaaaa, bbbbbbbbbbbbbb; /* what both of them are for, and more */",
        "    /* what both of them are for, and\n     * more */\n"
        "    int aaaaaaaaaaaaaaaaaaaa,\n            bbbbbbbbbbbbbb;",
    ),
    "its stars stand below each other": (
        "  /* one two three four five six seven eight */",
        "  /* one two three four five six seven\n   * eight */",
    ),
    "inside one the star is there already": (
        "/* short\n *   one two three four five six seven eight\n */",
        "/* short\n *   one two three four five six seven\n *   eight\n */",
    ),
    "a column goes on below itself": (
        "/* name    one two three four five six seven */",
        "/* name    one two three four five six\n *         seven */",
    ),
    "up to the middle of the line": (
        "/* name             one two three four five six */",
        "/* name             one two three four\n *                  five six */",
    ),
    "and no further": (
        "/* name              one two three four five six */",
        "/* name              one two three four\n * five six */",
    ),
    "of three columns below the last": (
        "/* a    b   one two three four five six seven */",
        "/* a    b   one two three four five six\n *          seven */",
    ),
    "a word longer than a line stays whole": (
        f"/* one two {'x' * 45} three */",
        f"/* one two\n * {'x' * 45}\n * three */",
    ),
    "long-named words are not cut": (
        "/* one two three-four-five-six-seven-eighty */",
        "/* one two\n * three-four-five-six-seven-eighty */",
    ),
}


@pytest.mark.parametrize("name", COMMENTS)
def test_comments_are_broken_between_words(name):
    line, expected = COMMENTS[name]
    assert wrap(line, 40) == expected
    assert wrap(expected, 40) == expected


def test_inside_a_comment_nothing_is_code():
    said = "/*\n * aaaaaaaaaa + bbbbbbbbbb * cccccccccc + ddd\n */\n"
    assert wrap(said + "    x = aaaaaaaaaaaaaaaaaaa + bbbbbbbbbbbbbbb;", 40).splitlines() == [
        "/*",
        " * aaaaaaaaaa + bbbbbbbbbb * cccccccccc",
        " * + ddd",
        " */",
        "    x = aaaaaaaaaaaaaaaaaaa",
        "            + bbbbbbbbbbbbbbb;",
    ]
