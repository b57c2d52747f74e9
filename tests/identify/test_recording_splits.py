"""Which recordings train and which judge, at a device's rate, and their errors; all by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from esea_gen.errors import UserError
from esea_gen.identify.recording.conditions import conditions_of, divided, splits_of
from esea_gen.identify.recording.cycles import DataSet
from esea_gen.identify.recording.reading import recorded_deflections
from esea_gen.identify.recording.recorded import Misfits, Recording
from esea_gen.identify.recording.tables import Cycles

BOTH, ONLY, JUDGE, UNUSED = ([0, 1], [2]), ([0, 1, 2], []), ([], [0, 1, 2]), ([], [])


def data(label: str, use: tuple[list, list], amplitude: float = 0.1) -> DataSet:
    training, held_out = (np.array(v, dtype=np.intp) for v in use)
    return DataSet(label, amplitude, training, held_out, {}, None, None, None)


def recording(*sets: DataSet, conditions=(), temperature=None) -> Recording:
    x = np.arange(3.0)
    head = (sets[0].label, f"{sets[0].label}.csv", "ab" * 8)
    more = {"conditions": conditions, "temperature_C": temperature}
    return Recording(*head, x, x, x, True, 0, (), sets, **more)


def used(recordings) -> dict[str, str]:
    """By data set: whether all that was used trains or judges."""
    out = {}
    for r in recordings:
        for s in r.sets:
            both = sorted([*s.training.tolist(), *s.held_out.tolist()])
            assert s.training.dtype == s.held_out.dtype == np.intp
            kind = "train" if len(s.training) == len(both) else "judge"
            out[s.label] = kind if len(s.held_out) in (0, len(both)) else "both"
            out[s.label] += "" if both == [0, 1, 2] else f" {both}"
    return out


def told(splits) -> list[tuple[str, bool, bool]]:
    return [(s.condition, s.declared, s.whole) for s in splits]


def test_each_condition_judges_once_beside_the_files_own_cycles():
    made = [
        recording(data("a", BOTH), data("b", BOTH)),
        recording(data("c", BOTH), conditions=("x", "y")),
        recording(data("d", BOTH), conditions=("y",)),
        recording(data("e", UNUSED)),
    ]
    splits = splits_of(made)
    assert told(splits) == [
        ("last cycles", True, False),
        *[(c, False, True) for c in ("a", "b", "x", "y")],
    ]
    assert [conditions_of(r, r.sets[0]) for r in made[1:]] == [("x", "y"), ("y",), ("e",)]
    assert used(splits[0].recordings) == dict.fromkeys("abcd", "both") | {"e": "train []"}
    assert used(splits[2].recordings) == {"e": "train []", "b": "judge"} | dict.fromkeys(
        "acd", "train"
    )
    assert used(splits[4].recordings) == {
        "a": "train", "b": "train", "c": "judge", "d": "judge", "e": "train []"}  # fmt: skip


def amplitudes(*sizes: float, use=BOTH, **more) -> list[Recording]:
    return [recording(data(k, use, a), **more) for k, a in zip("abcdef", sizes, strict=False)]


def test_of_three_conditions_the_one_of_middle_amplitude_judges():
    for sizes, middle in (
        ((0.3, 0.1, 0.2), "c"),
        ((0.1, 0.2, 0.3), "b"),
        ((0.4, 0.1, 0.3, 0.2), "c"),
        ((0.5, 0.4, 0.3, 0.2, 0.1), "c"),
    ):
        found = used(divided(amplitudes(*sizes), Cycles()))
        assert {k for k, v in found.items() if v == "judge"} == {middle}
        assert {v for k, v in found.items() if k != middle} == {"train"}
    # Of a condition of several sets the mean counts.
    made = amplitudes(0.1, 0.2, 0.3)
    made += [recording(data(k, BOTH, 0.05), conditions=("own",)) for k in "xy"]
    made += [recording(data("z", BOTH, 0.65), conditions=("own",))]  # 0.25
    assert {k for k, v in used(divided(made, Cycles())).items() if v == "judge"} == set("xyz")


def test_a_condition_that_is_asked_for_judges_if_it_can_be_left_out():
    made = amplitudes(0.1, 0.2)
    assert used(divided(made, Cycles(hold_out="b"))) == {"a": "train", "b": "judge"}
    warm = [replace(r, temperature_C=c) for r, c in zip(made, (20.0, 30.0), strict=True)]
    assert used(divided(warm, Cycles(hold_out="20 degC"))) == {"a": "judge", "b": "train"}
    for recordings, name in ((made, "bb"), (made[:1], "a")):
        with pytest.raises(UserError, match=f"cycles.hold_out = '{name}' is not a condition"):
            divided(recordings, Cycles(hold_out=name))


# At a device's rate.


def test_replays_of_a_mapping_are_by_its_own_folder_or_another(tmp_path, elbow):
    angle = 2 * np.pi * np.arange(501) / 100
    rows = zip(angle / (2 * np.pi), np.sin(angle), 2 * np.sin(angle), strict=True)
    (tmp_path / "data").mkdir()
    lines = ["t,x,y", *(",".join(f"{v:.12g}" for v in r) for r in rows)]
    (tmp_path / "data" / "rig.csv").write_text("\n".join(lines))
    (tmp_path / "map.toml").write_text(
        'schema = 1\n[device]\nname = "rig"\ntitle = "Rig"\nrate_terms = false\n'
        '[deflection]\ncolumn = "x"\nunit = "mrad"\n[torque]\ncolumn = "y"\nunit = "mNm"\n'
        '[sampling]\ntime_column = "t"\n[[recording]]\nfiles = ["rig.csv"]\n'
    )
    found = recorded_deflections(elbow, tmp_path / "map.toml", tmp_path / "data")
    assert list(found) == ["rig"]
    assert len(found["rig"]) == 5000  # 5 s at 1 kHz
    assert found["rig"][250] == pytest.approx(1e-3)
    (tmp_path / "data" / "map.toml").write_text((tmp_path / "map.toml").read_text())
    assert len(recorded_deflections(elbow, tmp_path / "data" / "map.toml")["rig"]) == 5000


# Errors.


def test_errors_are_by_data_set_their_mean_over_data_sets_and_in_per_cent_of_full_scale():
    made = [recording(data("a", BOTH), data("b", ONLY)), recording(data("c", JUDGE))]
    errors = [np.array([3.0, -4.0, -1.0]), np.array([0.0, 0.0, -6.0])]
    found = Misfits.of("Nm", zip(made, errors, strict=True))
    # a: 3 and -4, then -1; b: all three; c: two nothings and 6.
    trained, judged = (math.sqrt(12.5) + math.sqrt(26 / 3)) / 2, (1 + math.sqrt(12)) / 2
    assert (found.mean_rms(False), found.mean_rms(True)) == pytest.approx((trained, judged))
    means = found.means(50.0)
    assert means["training_percent"] == pytest.approx(2 * trained)
    assert means["held_out_Nm"] == pytest.approx(judged)
    (_, a), _, (_, c) = found.rows(20.0)
    rms_Nm = math.sqrt(12.5)
    told = {"rms_Nm": rms_Nm, "rms_percent": 5 * rms_Nm, "max_Nm": 4.0, "max_percent": 20.0}
    assert a["training"] == pytest.approx(told)
    assert (c["training"], c["held_out"]["max_Nm"]) == (None, 6.0)
