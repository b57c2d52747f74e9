"""Kernels given node by node, and their C to the letter."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.emit.formats import FORMATS
from esea_gen.emit.formats.floating import print_kernel
from esea_gen.emit.walker import (
    Kernel,
    Node,
    StatusWord,
    UnsupportedOperationError,
    status_words,
    use_counts,
)

F32, F64 = FORMATS["f32"], FORMATS["f64"]
INPUTS = tuple(Node("input", source=(k, 0)) for k in range(3))  # x, y, z: nodes 0, 1, 2


def constant(value: float) -> Node:
    return Node("const", value=value)


def printed(nodes, *results, fmt=F64, labels=None, words=(), others=None):
    kernel = Kernel("f", (*INPUTS, *nodes), results or ((len(nodes) + 2,),))
    made = print_kernel(
        kernel, fmt, lambda a, e: ("xyz"[a], f"in->{'xyz'[a]}"), labels or {}, words, others
    )
    said = [f"{s.c_type} {s.name} = {s.expression}" for s in made.statements]
    reads = [f"{fmt.c_type} {c} = in->{c}" for c in "xyz"]
    assert said[:3] == reads
    assert made.used_arguments == frozenset({0, 1, 2})
    return said[3:], made.results


LESS, LEAST = Node("lt", (0, 1)), Node("le", (2, 1))
LINES = {
    "a condition that is asked twice has a name": (
        [LESS, Node("select", (3, 0, 1)), Node("select", (3, 1, 2)), Node("sub", (4, 5))],
        ["bool v3 = x < y", "double v4 = v3 ? x : y", "double v5 = v3 ? y : z",
         "double v6 = v4 - v5"],
    ),
    "conditions are numbers where they are added": (
        [LESS, LEAST, Node("add", (3, 4))],
        ["double v5 = ((x < y) ? 1.0 : 0.0) + ((z <= y) ? 1.0 : 0.0)"],
    ),
    "and compared": (
        [LESS, Node("eq", (3, 2)), Node("if_else_zero", (4, 0))],
        ["double v5 = (((x < y) ? 1.0 : 0.0) == z) ? x : 0.0"],
    ),
    "and chosen": (
        [LESS, LEAST, Node("select", (3, 4, 2)), Node("select", (3, 2, 4)), Node("mul", (5, 6))],
        ["bool v3 = x < y", "bool v4 = z <= y", "double v5 = v3 ? (v4 ? 1.0 : 0.0) : z",
         "double v6 = v3 ? z : (v4 ? 1.0 : 0.0)", "double v7 = v5 * v6"],
    ),
    "numbers are conditions where they are not zero": (
        [Node("and", (0, 1)), Node("or", (3, 2)), Node("not", (4,)), Node("select", (5, 1, 0))],
        ["double v6 = (!(((x != 0.0) && (y != 0.0)) || (z != 0.0))) ? y : x"],
    ),
    "a number chooses": ([Node("select", (2, 1, 0))], ["double v3 = (z != 0.0) ? y : x"]),
    "a sum goes on from its left": (
        [Node("add", (0, 1)), Node("add", (3, 2))], ["double v4 = x + y + z"],
    ),
    "and not from its right": (
        [Node("add", (0, 1)), Node("add", (2, 3))], ["double v4 = z + (x + y)"],
    ),
    "differences and products keep their brackets": (
        [Node("sub", (0, 1)), Node("sub", (3, 2)), Node("mul", (0, 4)), Node("mul", (5, 1))],
        ["double v6 = (x * ((x - y) - z)) * y"],
    ),
    "so does a sum in a difference": (
        [Node("add", (0, 1)), Node("sub", (3, 2))], ["double v4 = (x + y) - z"],
    ),
    "a chain of conditions has none": (
        [LESS, LEAST, Node("ne", (0, 2)), Node("and", (3, 4)), Node("and", (5, 6)),
         Node("if_else_zero", (7, 1))],
        ["double v8 = ((x != z) && (x < y) && (z <= y)) ? y : 0.0"],
    ),
    "but one in another": (
        [LESS, LEAST, Node("ne", (0, 2)), Node("or", (3, 4)), Node("and", (6, 5)),
         Node("if_else_zero", (7, 1))],
        ["double v8 = (((x < y) || (z <= y)) && (x != z)) ? y : 0.0"],
    ),
    "a quotient, a square and a function have names": (
        [Node("div", (0, 1)), Node("sq", (2,)), Node("fabs", (0,)), Node("add", (3, 4)),
         Node("add", (6, 5))],
        ["double v3 = x / y", "double v4 = z * z", "double v5 = esea_fabs(x)",
         "double v7 = v3 + v4 + v5"],
    ),
    "a sign stands where it is used": (
        [Node("neg", (0,)), Node("mul", (1, 3)), Node("div", (2, 4))],
        ["double v5 = z / (y * (-x))"],
    ),
    "what is used twice has a name": (
        [Node("mul", (0, 1)), Node("sub", (3, 2)), Node("mul", (4, 3))],
        ["double v3 = x * y", "double v5 = (v3 - z) * v3"],
    ),
    "numbers below zero stand in brackets": (
        [constant(-2.0), constant(0.5), Node("fmin", (0, 3)), Node("fmax", (5, 4))],
        ["double v5 = esea_fmin(x, (-2.0))", "double v6 = esea_fmax(v5, 0.5)"],
    ),
    "order of operands": (
        [Node("pow", (1, 0)), Node("fmax", (2, 3)), Node("twice", (4,)), Node("inv", (5,)),
         Node("sign", (6,))],
        ["double v3 = pow(y, x)", "double v4 = esea_fmax(z, v3)", "double v5 = 2.0 * v4",
         "double v6 = 1.0 / v5", "double v7 = esea_sign(v6)"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LINES)
def test_lines_of_c(name):
    nodes, lines = LINES[name]
    said, results = printed(nodes)
    assert said == lines
    assert results == ((lines[-1].split()[1],),)


def test_results_are_names_numbers_and_conditions_as_numbers():
    nodes = [LESS, constant(-1.5), Node("mul", (0, 1)), Node("sub", (5, 2))]
    said, results = printed(nodes, (3, 4), (5,), (0,), (6,))
    # Each result has its name, whatever else takes it.
    assert said == ["bool v3 = x < y", "double v5 = x * y", "double v6 = v5 - z"]
    assert results == (("(v3 ? 1.0 : 0.0)", "(-1.5)"), ("v5",), ("x",), ("v6",))
    single, results = printed(nodes, (3, 4), fmt=F32)
    assert single[0] == "bool v3 = x < y"
    assert results == (("(v3 ? 1.0f : 0.0f)", "(-1.5f)"),)


def test_a_label_gives_a_name_to_what_would_stand_where_it_is_used():
    nodes = [Node("mul", (0, 1)), LESS, Node("add", (3, 2)), Node("if_else_zero", (4, 5))]
    said, _ = printed(nodes)
    # The sum is an arm that is used once.
    assert said == ["double v6 = (x < y) ? ((x * y) + z) : 0.0"]
    labels = {3: ("area", "its size"), 4: ("less", "")}
    said, results = printed(nodes, labels=labels, others={5: "never", 6: "chosen", 3: "no"})
    assert said == [
        "double area = x * y",
        "bool less = x < y",
        "double chosen = less ? (area + z) : 0.0",
    ]
    assert results == (("chosen",),)
    # A name that is read already gets another ending.
    for name in "xyz":
        said, _ = printed(nodes, labels={3: (name, "")})
        assert said == [f"double {name}_ = x * y", f"double v6 = (x < y) ? ({name}_ + z) : 0.0"]


WORD = [
    LESS, LEAST, constant(1.0), constant(4.0), Node("if_else_zero", (3, 5)),
    Node("if_else_zero", (4, 6)), Node("add", (7, 8)),
]  # fmt: skip


def test_bits_of_a_word():
    said, results = printed(WORD, (9,), (0,), fmt=F32, words=(0,), others={9: "status"})
    assert said == ["uint32_t status = esea_bit(x < y, 0u) | esea_bit(z <= y, 2u)"]
    assert results == (("status",), ("x",))
    # No word where none is said to be, and none in double precision.
    for fmt, words, end in ((F32, (1,), "f"), (F64, (0,), "")):
        said, _ = printed(WORD, (9,), (0,), fmt=fmt, words=words)
        c_type = fmt.c_type
        assert said == [
            f"{c_type} v7 = (x < y) ? 1.0{end} : 0.0{end}",
            f"{c_type} v8 = (z <= y) ? 4.0{end} : 0.0{end}",
            f"{c_type} v9 = v7 + v8",
        ]
    # A condition that something else takes too has its name.
    said, _ = printed([*WORD, Node("not", (4,))], (9,), (10,), fmt=F32, words=(0,))
    assert said == [
        "bool v4 = z <= y",
        "uint32_t v9 = esea_bit(x < y, 0u) | esea_bit(v4, 2u)",
        "bool v10 = !v4",
    ]
    kernel = Kernel("f", (*INPUTS, *WORD), ((9,),))
    word = StatusWord(((3, 0), (4, 2)), frozenset({7, 8}))
    assert status_words(kernel, (0,), use_counts(kernel)) == {9: word}


# -- numbers of single precision -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "text"),
    [
        # A ten-thousandth is below itself in single precision; what is above stands in full.
        (1e-4, "1.0e-04f"),
        (1.005e-4, "0.0001005f"),
        (-1.005e-4, "-0.0001005f"),
        (9.99e-5, "9.99e-05f"),
        (-9999999.0, "-9999999.0f"),
        (-1e7, "-1.0e+07f"),
        (-0.0, "-0.0f"),
        (3.4028235e38, "3.4028235e+38f"),
        (2.0**-149, "1.0e-45f"),  # the least there is
        (1 / 3, "0.33333334f"),
    ],
)
def test_a_number_is_written_as_short_as_it_reads_back(value, text):
    assert F32.literal(value) == text
    assert np.float32(text.removesuffix("f")) == np.float32(value)


@pytest.mark.parametrize("value", [3.5e38, -1e39, 2.0**-150, -1e-46, 5e-324])
def test_a_number_that_single_precision_has_not_is_refused(value):
    with pytest.raises(UnsupportedOperationError, match=r"is outside float32's range"):
        F32.literal(value)
    assert float(F64.literal(value)) == value


def test_of_a_power_the_exponent_is_the_second():
    said, _ = printed([Node("pow", (1, 0)), constant(0.5), Node("pow", (3, 4))], fmt=F32)
    assert said == [
        "float v3 = esea_f32_pow(y, x)",
        f"float v5 = esea_f32_powk(v3, INT32_C({2**26}) /* 0.5 */)",
    ]
    with pytest.raises(UnsupportedOperationError, match=r"^f: "):
        printed([constant(1e9), Node("pow", (0, 3))], fmt=F32)
