"""The one reader of tables: hostile files by every command, and the rules of each kind."""

from __future__ import annotations

import io
import json
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from esea_gen.cli import app
from esea_gen.errors import UserError
from esea_gen.tables import TableFormat, read_table, structured
from tests.conftest import require_module

MAPPING = """schema = 1
device = { name = "trial", title = "Trial", rate_terms = false }
deflection = { column = "count", unit = "rad" }
torque = { column = "tau_Nm", unit = "Nm" }
sampling = { period_s = { value = 0.01, status = "assumed", source = "?" } }
recording = [{ files = ["t.csv"] }]
"""
# The columns that each command needs, and how it is called.
COMMANDS = {
    "identify": (("count", "tau_Nm"), ["identify", "map.toml"]),
    "encoder-table": (("count", "reference_rad"), ["encoder-table", "elbow", "t.csv"]),
    "reliability": (("left", "right"), ["reliability", "t.csv"]),
    "friction": (("omega_rad_s", "tau_Nm"), ["friction", "t.csv"]),
    "torque-check": (
        ("time_s", "tau_Nm"),
        ["torque-check", "elbow", "--mass", "1", "--arm", "0.2", "--recording", "t.csv"],
    ),
}


def spoilt(cell: str) -> str:
    """A good table whose cell in line 4, column 2 is another one."""
    return f"AA,BB\n0,1\n1,2\n2,{cell}\n3,4\n"


HOSTILE = {
    "open quote": (spoilt('"5 in') + "5,6\n", ["line 4, character 3", "quote"]),
    "two open quotes": (spoilt('"5') + '4,"5\n6,7\n', ["line 4, character 3"]),
    "quoted line break": (spoilt('"5\n6"'), ["line 4, character 3"]),
    "open quote with two": (spoilt('"5""6'), ["line 4, character 3", "quote"]),
    "a recording": (b"\x89MCAP0\r\n", ["is a recording (MCAP), not a table"]),
    "text after a quote": (spoilt('"5"6'), ["line 4, character 5", "quote"]),
    "long row": (spoilt("3,9"), ["line 4 has 3 cells for 2 names"]),
    "every row long": ("AA,BB\n0,1,2\n1,2,3\n", ["line 2 has 3 cells for 2 names"]),
    "every row long by a delimiter": ("AA,BB\n0,1,\n1,2,\n", ["line 2 has 3 cells for 2 names"]),
    "short row": ("AA,BB\n0,1\n1\n2,3\n", ["line 3 has 1 cells for 2 names"]),
    "one name twice": ("AA,BB,BB\n0,1,2\n", ["'BB' occurs 2 times"]),
    "text": (spoilt("abc"), ["line 4, column 'BB': 'abc' is not a number"]),
    "empty cell": (spoilt(""), ["line 4, column 'BB' is empty"]),
    "not a number": (spoilt("NaN"), ["line 4, column 'BB' is NaN"]),
    "infinity": (spoilt("-inf"), ["line 4, column 'BB' is -inf"]),
    "too large": (spoilt("1e400"), ["line 4, column 'BB'"]),
    "whole number": (spoilt("9007199254740993"), ["line 4, column 'BB'", "2^53"]),
    "zeros": (spoilt("0" * 5000 + "9007199254740993"), ["line 4, column 'BB'", "2^53"]),
    "underscore": (spoilt("1_234"), ["'1_234' is not a number", "Write 1234"]),
    "hexadecimal": (spoilt("0x10"), ["'0x10' is not a number"]),
    "other digits": (spoilt("١٢"), ["'١٢' is not a number"]),
    "grouped": (spoilt('"1,234"'), ["'1,234' is not a number", "grouping"]),
    "grouped by points": (
        "AA;BB\n0;1,5\n1;1.234,5\n",
        ["line 3, column 'BB': '1.234,5'", "grouping"],
    ),
    "decimal or grouped": (
        "AA;BB\n0;1,234\n1;5,678\n",
        ["line 2, column 'BB': '1,234'", "grouping"],
    ),
    "both marks": ("AA;BB\n0;1,5\n1;2.5\n", ["line 2, column 'BB': '1,5'", "decimal mark"]),
    "long cell": (spoilt("9" * 140_000), ["line 4 has a cell of more than 131072 characters"]),
    "NUL": (spoilt("3\0"), ["line 4, character 4 is a NUL"]),
    "latin-1": (b"AA,BB\n0,1\xe9\n", ["line 2, byte 4", "'utf-8'"]),
    "form feed": (spoilt("\f5"), ["line 4, column 'BB' has the control character U+000C"]),
    "unit separator": (spoilt("5\x1f"), ["line 4, column 'BB'", "U+001F"]),
    "separators alone": (spoilt("5\n\x1f,\x1f"), ["line 5", "U+001F"]),
    "spreadsheet's fault": ("AA,BB\n0,1\n#N/A,2\n", ["'#N/A' is not a number"]),
    "German fault": ("BB;AA\n0;1\n#WERT!;2\n", ["'#WERT!' is not a number"]),
    "UTF-16 without a mark": ("AA,BB\n0,1\n".encode("utf-16-le"), ["line 1, character 2 is a NUL"]),
    "preamble": ("made by a rig\nAA,BB\n0,1\n", ["t.csv"]),
    **{
        f"no header, {first}": (f"{first}\n1,2\n1;2\n", ["line 1 has numbers, no column names"])
        for first in ("0,1", "1,5;2,5", "nan,2.0", ",1", "1_0,0x10", "2024-01-02T03:04,1", "#N/A,1")
    },
    "two delimiters": ("AA,x;BB\n0,1;2\n", ["t.csv"]),
    "empty": ("", ["has no line 1"]),
    "MATLAB": (b"MATLAB 5.0 MAT-file, and then nothing", ["is not a MATLAB file"]),
    "spreadsheet": (b"PK\x03\x04\x14", ["is a spreadsheet"]),
    "Parquet": (b"PAR1", ["is not a Parquet file"]),
}


# Every one by one command, of each other command a few: they share the reader.
FEW = ("open quote", "long row", "text", "grouped", "latin-1", "empty")
PAIRS = [("friction", h) for h in HOSTILE] + [(c, h) for c in COMMANDS for h in FEW]


@pytest.mark.parametrize(("command", "hostile"), dict.fromkeys(PAIRS))
def test_every_command_refuses_it_alike(tmp_path, monkeypatch, command, hostile):
    (first, second), words = COMMANDS[command]
    content, said = HOSTILE[hostile]
    content = content.encode() if isinstance(content, str) else content
    content = content.replace(b"AA", first.encode()).replace(b"BB", second.encode())
    monkeypatch.chdir(tmp_path)
    (tmp_path / "map.toml").write_text(MAPPING)
    (tmp_path / "t.csv").write_bytes(content)
    done = CliRunner().invoke(app, words)
    assert isinstance(done.exception, UserError), done.output
    for part in ("t.csv", *said):
        assert part.replace("BB", second) in str(done.exception)
    assert len(str(done.exception)) < 500


def read(raw: bytes | str, *wanted: str, **more):
    raw = raw.encode() if isinstance(raw, str) else raw
    return read_table(Path("rig.csv"), wanted or None, raw=raw, **more)


READ = {
    "plain": b"a,b\n0,1.5\n-1e3,2\n",
    "byte order mark": b"\xef\xbb\xbfa,b\n0,1.5\n-1e3,2\n",
    "UTF-16": "a,b\n0,1.5\n-1e3,2\n".encode("utf-16"),
    "line ends": b"a,b\r\n\r\n0,1.5\r-1e3,2",
    "blanks": b"  a   b\n  0   1.5\n-1e3 2  \n",
    "tabs": b"a\tb\n0\t1.5\n-1e3\t2\n",
    "decimal comma": b"a;b\n0;1,5\n-1e3;2\n",
    "quoted": b'"a","b"\n"0", "1.5"\n-1e3,"2"\n',
    "quotes within": b'a,b,"5"" x"\n0,1.5,5" bolt\n-1e3,2,"5"" bolt"\n',
    "comments": b'# made by a rig\na,b\n# "\n0,1.5\n-1e3,2\n',
    "rows without a value": b"a,b\n0,1.5\n,\n-1e3,2\n",
}


@pytest.mark.parametrize("name", READ)
def test_a_table_is_read_and_says_what_was_left_out(name):
    table = read(READ[name])
    assert table.numbers("a").tolist() == [0, -1000]
    assert table.numbers("b").tolist() == [1.5, 2]
    left = {
        "comments": ("2 comment lines (lines 1, 3)",),
        "rows without a value": ("1 row without a value (line 3)",),
    }
    assert table.left_out == left.get(name, ())
    for part in table.left_out or ("left out: nothing",):
        assert part in table.report()


@given(
    rows=st.lists(st.tuples(st.floats(-1e9, 1e9), st.integers(-(2**53), 2**53)), min_size=2),
    delimiter=st.sampled_from(";\t| "),
    decimal=st.sampled_from(".,"),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
)
def test_every_digit_comes_back(rows, delimiter, decimal, end):
    lines = [f"x{delimiter}k", *(f"{x!r}{delimiter}{k}".replace(".", decimal) for x, k in rows)]
    table = read(end.join(lines), form=TableFormat(decimal=decimal))
    assert list(zip(table.numbers("x").tolist(), table.numbers("k").tolist(), strict=True)) == rows
    assert table.lines.tolist() == list(range(2, len(rows) + 2))


@given(st.binary(max_size=60) | st.text(alphabet='ab01,;\t\n\r".# -e_', max_size=60))
def test_whatever_a_file_holds_it_is_read_or_refused(raw):
    with suppress(UserError):
        table = read(raw)
        for name in filter(None, table.names):
            assert np.isfinite(table.numbers(name)).all()


def test_the_kind_is_told_by_the_content():
    table = read(parquet(T, names=["x"]))
    assert (table.form.kind, table.numbers("x").tolist()) == ("parquet", T.tolist())
    assert read(mat(x=X)).numbers("x").tolist() == X.tolist()  # from a process of its own
    file = io.BytesIO()
    scipy.io.savemat(file, {"x": X}, format="4")  # which has no mark: by the name
    assert read_table(Path("rig.mat"), raw=file.getvalue()).numbers("x").tolist() == X.tolist()
    for kind, said in (("csv", "is a parquet file, but it is read as csv"), ("json", "as json")):
        with pytest.raises(UserError, match=said):
            read(b"PAR1", form=TableFormat(kind=kind))
    with pytest.raises(UserError, match="has no line 9 with column names"):
        read("a\n1\n", form=TableFormat(header_line=9))


def test_quoting_off_header_and_ragged_logs():
    text = 'rig\nms;Nm\n0;1;"5/8 in\n1;2;x\n7\n2;;y\n'
    form = TableFormat(quote="", header_line=0, first_data_line=3, delimiter=";")
    table = read(text, "2", "1", form=form, drop_ragged=True)
    assert table.left_out == (
        "2 lines before the first data line",
        "1 row of other than 3 cells (line 5)",
    )
    assert table.timed("2").numbers("1").tolist() == [0, 1]
    assert table.timed("2").left_out[2] == "1 row with no '2' (line 6)"
    assert np.isnan(table.numbers("2", holes=True)[2])
    assert table.numeric(["2"]).numbers("1").tolist() == [0, 1, 2]
    assert read("a,b\n1,x\n2,3\n").numeric(["b"]).left_out == (
        "1 row with no number in 'b' (line 2)",
    )
    with pytest.raises(UserError, match="Line 3 has the names"):
        read("rig\nmade today\n t, x\n0,1\n", "t", "x")
    with pytest.raises(UserError, match=r"set quote = \"\" \(quoting off\) in \[format\] of m"):
        read('a,b\n0,"1\n', settings="[format] of m")


# Other kinds.


def hdf5(**content) -> bytes:
    file = io.BytesIO()
    require_module("h5py")
    import h5py

    with h5py.File(file, "w") as made:
        for path, value in content.items():
            made[path.replace("__", "/")] = value
    return file.getvalue()


@pytest.fixture
def here(monkeypatch):
    """MATLAB files are read in this process: starting another one takes a second."""
    monkeypatch.setattr(structured, "apart", structured.mat_content)


def mat(**content) -> bytes:
    file = io.BytesIO()
    scipy.io.savemat(file, content)
    return file.getvalue()


def parquet(*columns, names) -> bytes:
    require_module("pyarrow")
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = io.BytesIO()
    pq.write_table(pa.Table.from_arrays([pa.array(c) for c in columns], names), file)
    return file.getvalue()


def as_json(content) -> bytes:
    return b" " + json.dumps(content).encode()


T, X = np.arange(3.0), np.array([1.5, 2, 4])
ROWS = [{"t": t, "x": x} for t, x in zip(T.tolist(), X.tolist(), strict=True)]


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("kind", "raw", "path"),
    [
        ("mat", lambda: mat(s={"t": T, "x": X}, n=5), "s."),
        ("mat", lambda: mat(t=T, x=X), ""),
        ("hdf5", lambda: hdf5(s__t=T, s__x=X), "s."),
        ("hdf5", lambda: hdf5(s__t=T, s__x=X), "s/"),
        ("hdf5", lambda: hdf5(s=np.rec.fromarrays([T, np.float32(X)], names="t,x")), "s."),
        ("parquet", lambda: parquet(ROWS, names=["s"]), "s."),
        ("json", lambda: as_json([{"s": r} for r in ROWS]), "s."),
        ("json", lambda: as_json({"s": {"t": T.tolist(), "x": X.tolist()}}), "s."),
    ],
)
def test_fields_of_structs_are_columns(kind, raw, path):
    table = read(raw(), f"{path}t", f"{path}x", form=TableFormat(kind=kind))
    assert table.numbers(f"{path}t").tolist() == T.tolist()
    assert table.numbers(f"{path}x").tolist() == X.tolist()
    if path and kind != "json":
        with pytest.raises(UserError, match=r"'s' is a .*'s[./]t', 's[./]x'"):
            read(raw(), "s", form=TableFormat(kind=kind))


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("kind", "raw"),
    [
        ("mat", lambda: mat(t=1.0, x=2.0)),
        ("hdf5", lambda: hdf5(t=[1.0], x=[2.0])),
        ("parquet", lambda: parquet([1.0], [2.0], names=["t", "x"])),
        ("json", lambda: as_json([{"t": 1.0, "x": 2.0}])),
        ("json", lambda: as_json({"t": [1.0], "x": [2.0]})),
    ],
)
def test_one_row_is_a_table(kind, raw):
    for wanted in ((), ("t", "x")):
        table = read(raw(), *wanted, form=TableFormat(kind=kind))
        assert (len(table), table.numbers("x").tolist(), table.left_out) == (1, [2], ())


@pytest.mark.usefixtures("here")
def test_a_single_value_beside_vectors_is_no_column():
    table = read(mat(x=X, n=5.0, on=X > 2, m=np.eye(3)))  # nor are flags and matrices
    assert (table.names, table.left_out) == (("x",), ("'n', 'on', 'm', not columns",))
    with pytest.raises(UserError, match="'n' has 1 value"):
        read(mat(x=X, n=5.0), "n")


def test_a_name_with_a_point_is_read():
    assert read(hdf5(**{"a.b": X}), "a.b").numbers("a.b").tolist() == X.tolist()


def packed_mat(**content) -> bytes:
    file = io.BytesIO()
    scipy.io.savemat(file, content, do_compression=True)
    return file.getvalue()


def test_a_channel_of_a_lower_rate_is_reported(tmp_path):
    """At a third of the rows' rate; no channel that is quantised, at rest, or moved in steps."""
    t = np.arange(3000) / 200
    x, steps = np.sin(t), np.repeat(np.random.default_rng(1).normal(size=20), 150)
    others = np.round(x, 1), np.round(x, 3), np.round(np.abs(t % 4 - 2), 2), 0 * t, steps
    columns = zip("abcdef", (np.repeat(x[::3], 3), *others), strict=True)
    raw = json.dumps({name: values.tolist() for name, values in columns}).encode()
    table = read_table(tmp_path / "t.json", raw=raw)
    for name in table.names:
        table.numbers(name)
    assert table.held == {"a": 3}
    assert "3000 rows, column 'a' with a new value in every 3. only (" in table.report()


def test_what_unpacks_to_too_much_is_refused(monkeypatch):
    monkeypatch.setattr(structured, "MOST_TEXT_BYTES", 10**6)
    texts = ["x" * 1000] * 1001
    for raw in (parquet(texts, names=["x"]), parquet([{"x": t} for t in texts], names=["s"])):
        with pytest.raises(UserError, match=r"more than the limit of 1e\+06 bytes in texts"):
            read(raw)
    with pytest.raises(UserError, match=r"more than the limit of 1e\+06 bytes in texts"):
        read(hdf5(x=texts))
    assert read(parquet(texts[:999], names=["x"])).texts("x") == tuple(texts[:999])
    monkeypatch.setattr(structured, "MOST_BYTES", 1000)
    for content in ({"x": np.zeros(200)}, {"s": {"t": np.zeros(100), "x": np.zeros(100)}}):
        with pytest.raises(UserError, match=r"more than the limit of 1e\+03 bytes"):
            read(packed_mat(**content))
    monkeypatch.setattr(structured, "LONGEST_S", 1e-3)
    with pytest.raises(UserError, match="not read within the limit"):
        read(mat(x=X))


BIG = 2**53 + 1


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("kind", "raw", "said"),
    [
        ("mat", lambda: mat(x=np.eye(3)), "shape (3, 3)"),
        ("mat", lambda: mat(x=X + 1j), "not a vector of real numbers"),
        ("mat", lambda: mat(x=X > 2), "not a vector"),
        ("mat", lambda: mat(x=np.array([BIG, 1])), "2^53"),
        ("mat", lambda: mat(x=[1, np.nan]), "row 2, column 'x' is nan"),
        ("mat", lambda: mat(y=X), "no column 'x'"),
        ("mat", lambda: mat(x=np.array([["a"]], object)), "'x' is a cell"),
        ("mat", lambda: mat(**{"x.b": X, "x": {"b": X}}), "'x.b' occurs 2 times"),
        (
            "mat",
            lambda: mat(x=np.zeros(2, [("a", "f8")])),
            "array of 2 structs with the fields 'x.a'",
        ),
        ("hdf5", lambda: hdf5(x=np.zeros((2, 2), [("a", "f8")])), "a compound with 'x.a'"),
        ("hdf5", lambda: hdf5(**{"x.b": X, "x__b": X}), "'x.b' occurs 2 times"),
        ("parquet", lambda: parquet(X, [{"b": 1.0}] * 3, names=["x.b", "x"]), "'x.b' occurs 2"),
        ("json", lambda: as_json({"x.b": [1, 2], "x": {"b": [3, 4]}}), "'x.b' occurs 2 times"),
        ("json", lambda: as_json([{"x.b": 1}, {"x": {"b": 2}}]), "'x.b' occurs 2 times"),
        ("hdf5", lambda: hdf5(x=["a", "b"]), "'a' is not a number"),
        ("hdf5", lambda: hdf5(x=np.array([True, False])), "not a vector"),
        ("hdf5", lambda: hdf5(x=np.uint64([BIG, 1])), "2^53"),
        ("parquet", lambda: parquet(T, X, names=["x", "x"]), "'x' occurs 2 times"),
        ("parquet", lambda: parquet(["1", "2"], names=["x"]), "'1' is not a number"),
        ("parquet", lambda: parquet([True, False], names=["x"]), "type bool"),
        ("parquet", lambda: parquet([[1.0], [2.0]], names=["x"]), "type list"),
        ("parquet", lambda: parquet([BIG, None], names=["x"]), "2^53"),
        ("parquet", lambda: parquet([1.0, None], names=["x"]), "row 2, column 'x' is"),
        ("json", lambda: as_json({"x": [1, True]}), "row 2, column 'x': 'True' is not a number"),
        ("json", lambda: as_json({"x": [1, "2"]}), "'2' is not a number"),
        ("json", lambda: as_json({"x": [BIG, 2]}), "2^53"),
        ("json", lambda: as_json({"x": [1, 10**400]}), "row 2, column 'x': 1000"),
        ("json", lambda: as_json({"x": [1, None]}), "row 2, column 'x' is empty"),
        ("json", lambda: as_json({"x": [1, np.nan]}), "row 2, column 'x' is nan"),
        ("json", lambda: as_json([{"x": 1}, {"y": 2}]), "row 2, column 'x' is empty"),
        ("json", lambda: b'{"x": [1, 2], "x": [3, 4]}', "'x' occurs 2 times"),
        ("json", lambda: as_json({"x": [[1, 2], [3, 4]]}), "'[1, 2]' is not a number"),
        ("json", lambda: as_json({"x": 5}), "neither columns by name nor a list of rows"),
        ("json", lambda: b"[" * 100_000, "is not JSON"),
    ],
)
def test_other_kinds_have_the_same_rules(kind, raw, said):
    with pytest.raises(UserError) as refused:
        read(raw(), "x", form=TableFormat(kind=kind)).numbers("x")
    assert said in str(refused.value)
    assert "rig.csv" in str(refused.value)
