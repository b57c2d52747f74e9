"""Kernels written as nested tuples over four inputs and numbers, and random ones."""

from __future__ import annotations

from hypothesis import strategies as st

from esea_gen.emit.walker import Node

INPUTS = ("x", "y", "z", "n")


def built(*trees, nodes=None) -> tuple[list[Node], list[int]]:
    """Nodes of nested tuples over x, y, z, n and numbers, and the place of each tree."""
    nodes = [Node("input", source=(0, k)) for k in range(4)] if nodes is None else nodes

    def put(tree) -> int:
        if isinstance(tree, str):
            return INPUTS.index(tree)
        if not isinstance(tree, tuple):
            nodes.append(Node("const", value=float(tree)))
        else:
            nodes.append(Node(tree[0], tuple(put(t) for t in tree[1:])))
        return len(nodes) - 1

    return nodes, [put(t) for t in trees]


@st.composite
def trees(draw, truth: bool = False, depth: int = 4):
    """A value made of x, y, z, n and numbers; or a truth value."""
    if truth:
        op = draw(st.sampled_from(["lt", "le", "eq", "ne", "and", "or", "not"]))
        logic = op in ("and", "or", "not") and depth > 1
        if not logic:
            op = op if op in ("lt", "le", "eq", "ne") else "lt"
        of = trees(logic, depth - 1)
        return (op, *(draw(of) for _ in range(1 if op == "not" else 2)))
    if depth <= 0 or draw(st.integers(0, 3)) == 0:
        return draw(st.sampled_from(["x", "y", "z", "n", 0, 1, -1, 2, 0.5, 2.5, -3]))
    op = draw(
        st.sampled_from(
            ["add", "sub", "mul", "neg", "fabs", "sq", "twice", "fmin", "fmax"]
            + 2 * ["select", "if_else_zero"]
        )
    )
    value = trees(False, depth - 1)
    if op in ("select", "if_else_zero"):
        arms = 2 if op == "select" else 1
        return (op, draw(trees(True, depth - 1)), *(draw(value) for _ in range(arms)))
    return (op, *(draw(value) for _ in range(1 if op in ("neg", "fabs", "sq", "twice") else 2)))
