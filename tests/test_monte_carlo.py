"""Many cases: same numbers for any workers and any interruption, nothing hidden."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.analysis.monte_carlo import (
    Configuration,
    Journal,
    file_digest,
    percentiles,
    run_cases,
    seeded,
)
from esea_gen.analysis.plots import percentile_bars
from esea_gen.errors import UserError

CONFIG = Configuration({"controller": "abc", "plant": "def"})


def draw(seed, gain=1.0):
    value = np.random.default_rng(seed).normal()
    if value > 1.5:
        raise RuntimeError(f"tripped at {gain}")
    return {"rms": abs(value) * gain, "odd": np.inf if value < -1.8 else value}


def counted(folder):
    def case(seed):
        (folder / f"{seed}-{time.monotonic_ns()}").touch()
        return {"x": seed % 1000 / 7}

    return case


def test_any_number_of_workers_gives_the_same(tmp_path):
    cases = seeded(40, root=3, gain=2.0)
    one = run_cases(draw, cases, configuration=CONFIG)
    two = run_cases(draw, cases, configuration=CONFIG, workers=2, folder=tmp_path)
    assert one.to_dict() == two.to_dict()
    assert [r.case for r in one.results] == cases
    again = run_cases(draw, cases, configuration=CONFIG, folder=tmp_path)
    assert again.to_dict() == one.to_dict()


def test_failures_are_counted_and_told(tmp_path):
    result = run_cases(draw, seeded(60, root=1), configuration=CONFIG, folder=tmp_path)
    normal = {s["seed"]: np.random.default_rng(s["seed"]).normal() for s in seeded(60, root=1)}
    bad = {s for s, v in normal.items() if v > 1.5 or v < -1.8}
    assert {r.case["seed"] for r in result.failures} == bad
    assert bad
    words = {r.failure for r in result.failures}
    assert words <= {"RuntimeError: tripped at 1.0", "odd is inf"}
    table = result.table()
    assert table[0] == f"60 cases, {len(bad)} failed"
    assert sum("FAILED" in line for line in table) == min(len(bad), 10)
    p = result.summary()["rms"]
    assert (p.count, p.failed) == (60 - len(bad), len(bad))
    good = sorted(abs(v) for s, v in normal.items() if s not in bad)
    assert p.largest == good[-1]
    assert p.values[50.0] == pytest.approx(np.median(good))
    json.dumps(result.to_dict(), allow_nan=False)
    with pytest.raises(UserError, match="Choose from odd, rms"):
        result.values("tau")
    nothing = run_cases(lambda seed: {}, seeded(2), configuration=CONFIG)
    assert [r.failure for r in nothing.failures] == ["gave no numbers"] * 2
    assert nothing.summary() == {}
    text = run_cases(lambda seed: {"a": "x"}, seeded(1), configuration=CONFIG)
    assert "could not convert" in text.failures[0].failure


def test_failed_cases_run_again_on_request(tmp_path):
    cases, broken = seeded(5), [True]

    def case(seed):
        if broken[0]:
            raise ValueError("not yet")
        return {"x": 1.0}

    kinds = []
    for broken[0], retry in ((True, False), (False, False), (False, True)):
        result = run_cases(case, cases, configuration=CONFIG, folder=tmp_path, retry_failed=retry)
        kinds.append(len(result.failures))
    assert kinds == [5, 5, 0]


def test_a_resumed_run_does_only_what_is_missing(tmp_path):
    done, journal, seen = tmp_path / "done", tmp_path / "journal", []
    done.mkdir()
    cases = seeded(12)
    run_cases(counted(done), cases[:7], configuration=CONFIG, folder=journal)
    result = run_cases(
        counted(done),
        cases,
        configuration=CONFIG,
        folder=journal,
        progress=lambda *a: seen.append(a),
    )
    assert len(list(done.iterdir())) == 12
    assert seen[0] == (7, 12, 0)
    assert seen[-1] == (12, 12, 0)
    assert [r.case for r in result.results] == cases
    other = Configuration({"controller": "abc", "plant": "changed"})
    run_cases(counted(done), cases[:2], configuration=other, folder=journal)
    assert len(list(done.iterdir())) == 14  # another configuration shares nothing
    assert len(list(journal.iterdir())) == 2


@pytest.mark.parametrize("cut", [1, 9, 60])
def test_a_torn_last_line_is_repaired(tmp_path, cut):
    folder = tmp_path / "journal"
    cases = seeded(6)
    whole = run_cases(draw, cases, configuration=CONFIG, folder=folder)
    path = Journal(folder, CONFIG).path
    content = path.read_bytes()
    last = len(content.splitlines(keepends=True)[-1])
    path.write_bytes(content[: len(content) - min(cut, last - 1)])
    seen = []
    again = run_cases(
        draw, cases, configuration=CONFIG, folder=folder, progress=lambda *a: seen.append(a)
    )
    assert seen[0][0] == 5
    assert again.to_dict() == whole.to_dict()
    assert path.read_bytes() == content


def test_damage_elsewhere_is_told_and_not_repaired(tmp_path):
    run_cases(draw, seeded(4), configuration=CONFIG, folder=tmp_path)
    path = Journal(tmp_path, CONFIG).path
    content = path.read_text()
    digit = content.index('"rms":') + 8
    for damaged, words in (
        (content[:digit] + ("1" if content[digit] != "1" else "2") + content[digit + 1 :], "check"),
        (content.replace('"case"', '"cas', 1), "line 2: damaged"),
        (content.replace("abc", "abd", 1), "line 1: not the head"),
    ):
        path.write_text(damaged)
        with pytest.raises(UserError, match=words):
            run_cases(draw, seeded(4), configuration=CONFIG, folder=tmp_path)
        assert path.read_text() == damaged


def test_two_runs_do_not_share_a_journal(tmp_path):
    with Journal(tmp_path, CONFIG).opened(), pytest.raises(UserError, match="another run"):
        run_cases(draw, seeded(1), configuration=CONFIG, folder=tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match="cannot be written"):
        run_cases(draw, seeded(1), configuration=CONFIG, folder=tmp_path / "file")


SCRIPT = """
import sys, time
from pathlib import Path
import numpy as np
from esea_gen.analysis.monte_carlo import Configuration, run_cases, seeded
folder = Path(sys.argv[1])
def case(seed):
    (folder / "started" / f"{seed}-{time.monotonic_ns()}").touch()
    time.sleep(float(sys.argv[2]))
    return {"x": float(np.random.default_rng(seed).normal())}
if __name__ == "__main__":
    result = run_cases(case, seeded(16), configuration=Configuration({"a": 1}),
                       folder=folder / "journal", workers=int(sys.argv[3]))
    print(result.to_dict()["results"])
"""


def test_kill_9_loses_only_what_is_running(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(textwrap.dedent(SCRIPT))
    (tmp_path / "started").mkdir()
    command = [sys.executable, str(script), str(tmp_path)]
    run = subprocess.Popen([*command, "0.1", "2"])
    journal = Journal(tmp_path / "journal", Configuration({"a": 1})).path
    try:
        for _ in range(600):
            if journal.exists() and journal.read_bytes().count(b"\n") >= 6:
                break
            time.sleep(0.05)
    finally:
        # The run alone: its workers see that it is gone, and its tracker tidies up behind it.
        run.kill()
        run.wait()
    time.sleep(0.3)
    kept = journal.read_bytes().count(b"\n") - 1
    started = len(list((tmp_path / "started").iterdir()))
    assert 5 <= kept < 16
    assert started - kept <= 4  # two running, and two that had ended but were not yet taken
    out = subprocess.run([*command, "0", "1"], capture_output=True, text=True, check=True).stdout
    assert len(list((tmp_path / "started").iterdir())) == started + 16 - kept
    expected = [
        {"case": c, "values": {"x": float(np.random.default_rng(c["seed"]).normal())}}
        for c in seeded(16)
    ]
    assert out.strip() == str(expected)


def crash(seed):
    if seed == seeded(4)[2]["seed"]:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"x": 1.0}


def test_a_worker_that_dies_is_told(tmp_path):
    with pytest.raises(UserError, match="worker process died"):
        run_cases(crash, seeded(4), configuration=CONFIG, folder=tmp_path, workers=2)


# -- seeds, keys, percentiles ---------------------------------------------------------------------


def test_seeds_grow_without_changing():
    assert seeded(100)[:10] == seeded(10)
    assert len({c["seed"] for c in seeded(1000)}) == 1000
    assert seeded(3, root=1) != seeded(3, root=2)
    with pytest.raises(UserError):
        seeded(0)


def test_a_key_depends_on_content_only(tmp_path):
    assert Configuration({"a": 1, "b": [2.5]}).key == Configuration({"b": [2.5], "a": 1}).key
    keys = {Configuration(p).key for p in ({"a": 1}, {"a": 2}, {"a": "1"}, {"b": 1})}
    assert len(keys) == 4
    (tmp_path / "x").write_bytes(b"abc")
    assert file_digest(tmp_path / "x").startswith("ba7816bf")  # FIPS 180-2, example 1
    for wrong in ({"a": np.nan}, {"a": object()}):
        with pytest.raises(UserError, match="JSON"):
            _ = Configuration(wrong).key
    with pytest.raises(UserError, match="occurs twice"):
        run_cases(draw, [{"seed": 1}, {"seed": 1}], configuration=CONFIG)
    for arguments in ({"workers": 0}, {"workers": -2}):
        with pytest.raises(UserError, match="workers"):
            run_cases(draw, seeded(1), configuration=CONFIG, **arguments)
    with pytest.raises(UserError, match="none"):
        run_cases(draw, [], configuration=CONFIG)


def test_percentiles_of_known_numbers():
    p = percentiles("x", np.arange(101)[::-1])
    assert p.values == {5.0: 5, 25.0: 25, 50.0: 50, 75.0: 75, 95.0: 95}
    assert p.largest == 100
    # A percentile q of n uniform values lies at q +- 1.96 sqrt(q (1 - q) / n).
    for level in (25.0, 50.0, 75.0):
        half = 196 * np.sqrt(level / 100 * (1 - level / 100) / 101)
        assert p.low[level] == pytest.approx(level - half, abs=2)
        assert p.high[level] == pytest.approx(level + half, abs=2)
    with pytest.raises(UserError):
        percentiles("x", [])
    with pytest.raises(UserError):
        percentiles("x", [1.0, np.nan])


@settings(max_examples=15, deadline=None)
@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=40), st.randoms(use_true_random=False))
def test_percentiles_do_not_know_an_order(values, random):
    first = percentiles("x", values)
    random.shuffle(values)
    assert percentiles("x", values).to_dict() == first.to_dict()
    points = [*first.values.values(), first.largest]
    assert all(a <= b + 1e-12 for a, b in itertools.pairwise(points))
    for level, value in first.values.items():
        assert first.low[level] <= value + 1e-9
        assert value <= first.high[level] + 1e-9


def test_the_bootstrap_interval_covers():
    hits = sum(
        p.low[50.0] <= 0 <= p.high[50.0]
        for p in (percentiles("x", np.random.default_rng(s).normal(size=60)) for s in range(100))
    )
    assert 88 <= hits <= 100


def test_the_picture_says_what_failed():
    rows = [(n, percentiles(n, np.arange(50.0) + 1, failed=f)) for n, f in (("a", 0), ("b", 3))]
    figure = percentile_bars(rows, {"a": 40.0})
    assert [t.get_text() for t in figure.axes[0].get_yticklabels()] == ["a", "b\n3 of 53 failed"]
    texts = [t.get_text() for t in figure.legends[0].get_texts()]
    assert texts == ["5 to 95 %", "25 to 75 %", "95 % interval of the 95 %", "largest", "limit"]
