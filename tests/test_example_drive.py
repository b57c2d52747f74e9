"""When a System has a drive's example, and what it asks of latches that do it or do not."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from esea_gen.emit import example as example_module
from esea_gen.emit.example import _axis, _default, _latch_fails, _wave, drive_example, has_drive
from esea_gen.errors import UserError

NONE, STOP = 0.0, 4.0
WAIT = 5


def named(name: str) -> SimpleNamespace:
    return SimpleNamespace(name=name)


def example(driven: bool = True) -> SimpleNamespace:
    """Of two axes; rearm stands at 1 after the recording."""
    axes = tuple(SimpleNamespace(command=named(f"u{k}"), fault=named(f"fault{k}")) for k in (1, 2))
    return SimpleNamespace(
        modes=[named("mode1"), named("mode2")],
        axes=axes,
        stop=named("stop"),
        rearm=named("rearm"),
        rearmed=1,
        wait=WAIT,
        driven=driven,
    )


class Latch:
    """One latch of two axes: a stop closes it, another number of rearm in mode 0 opens it.

    wrong: (phase, tick of the phase from 1, what is told there instead); phases are the six things
        that are asked, in turn.
    """

    LENGTHS = (1, WAIT, WAIT, WAIT, 1, WAIT)

    def __init__(self, wrong=None):
        self.given = {"stop": 0.0, "rearm": 1.0, "mode1": 1.0, "mode2": 1.0}
        self.latched, self.rearm = False, 1.0
        self.asked: list[dict[str, float]] = []
        self.wrong = wrong
        self.out: dict[str, float] = {}

    def tick(self, given):
        self.asked.append(dict(given))
        self.given |= given
        off = self.given["mode1"] == self.given["mode2"] == 0.0
        if self.given["stop"]:
            self.latched = True
        elif off and self.given["rearm"] != self.rearm:
            self.latched = False
        self.rearm = self.given["rearm"]
        fault = STOP if self.latched else NONE
        out = {"fault1": fault, "fault2": fault}
        for k, u in ((1, 0.25), (2, -0.5)):
            out[f"u{k}"] = 0.0 if self.latched or not self.given[f"mode{k}"] else u
        phase, within = 1, len(self.asked)
        for length in self.LENGTHS:
            if within <= length:
                break
            phase, within = phase + 1, within - length
        if self.wrong and self.wrong[:2] == (phase, within):
            out |= self.wrong[2]
        self.out = out
        return out


def test_a_latch_that_does_as_it_is_asked():
    latch = Latch()
    assert _latch_fails(example(), latch) == ""
    asked = ({"stop": 1.0}, {"stop": 0.0}, {"rearm": 2.0}, {"mode1": 0.0, "mode2": 0.0},
             {"rearm": 3.0}, {"mode1": 1.0, "mode2": 1.0})  # fmt: skip
    lengths = Latch.LENGTHS
    expected = [g for g, n in zip(asked, lengths, strict=True) for _ in range(n)]
    assert latch.asked == expected


SAID = {
    1: "a stop does not latch",
    2: "the latch opens when the stop is over",
    3: "rearm opens it in torque mode",
    4: "mode 0 opens it",
    5: "rearm in mode 0 does not open it",
    6: "torque mode closes it again",
}


@pytest.mark.parametrize("phase", SAID)
@pytest.mark.parametrize("axis", [1, 2])
def test_a_latch_that_tells_another_fault_at_any_tick_is_found(phase, axis):
    told = {f"fault{axis}": NONE if phase < 5 else STOP}
    for tick in {1, 2, Latch.LENGTHS[phase - 1]}:
        if tick <= Latch.LENGTHS[phase - 1]:
            assert _latch_fails(example(), Latch((phase, tick, told))) == SAID[phase]
    # Another fault than that of the stop is none of it.
    told = {f"fault{axis}": 7.0}
    assert _latch_fails(example(), Latch((phase, 1, told))) == SAID[phase]


@pytest.mark.parametrize("phase", SAID)
@pytest.mark.parametrize("axis", [1, 2])
def test_a_command_while_it_is_closed_is_found(phase, axis):
    latch = Latch((phase, 1, {f"u{axis}": -0.001}))
    assert _latch_fails(example(), latch) == (SAID[phase] if phase < 5 else "")


def test_after_it_was_opened_every_motor_is_driven_again_where_it_was_before():
    said = "after the latch was opened again, the motor is not driven"
    for axis in (1, 2):
        still = (6, WAIT, {f"u{axis}": 0.0})
        assert _latch_fails(example(), Latch(still)) == said
        assert _latch_fails(example(driven=False), Latch(still)) == ""
        assert _latch_fails(example(), Latch((6, WAIT - 1, {f"u{axis}": 0.0}))) == ""


# -- what a System has -----------------------------------------------------------------------------


def external(signal: str, *more: str) -> SimpleNamespace:
    signals = [
        SimpleNamespace(instance=i, port=p) for i, p in (s.split(".") for s in (signal, *more))
    ]
    return SimpleNamespace(name=signal, signals=signals)


INPUTS = ("encoder_motor.count", "encoder_load_flexion.count", "encoder_gear.count",
          "control.mode", "limits_flexion.stop", "limits_flexion.rearm")  # fmt: skip
OUTPUTS = ("limits_flexion.u_Nm", "limits_flexion.fault", "sensor.tau_Nm")
KINDS = {"limits_flexion": "limits", "encoder_load_flexion": "encoder", "control": "smc"}


def having(inputs=INPUTS, outputs=OUTPUTS, latches=("one",)) -> SimpleNamespace:
    instances = {s.split(".")[0] for s in (*INPUTS, *OUTPUTS)}
    limits = (SimpleNamespace(name="tau_max_Nm", default=8.0), SimpleNamespace(name="x", default=3))
    blocks = {i: SimpleNamespace(name=KINDS.get(i, i), tunables=()) for i in sorted(instances)}
    blocks["limits_flexion"].tunables = limits
    return SimpleNamespace(
        name="mine",
        inputs=[external(s) for s in inputs],
        outputs=[external(s) for s in outputs],
        latches=latches,
        blocks=blocks,
        kinds=list(blocks.values()),
    )


def test_a_drive_has_encoders_limits_a_mode_and_a_latch():
    assert has_drive(having())
    assert not has_drive(having(latches=()))
    for missing in (*INPUTS, *OUTPUTS):
        inputs, outputs = ([s for s in all_ if s != missing] for all_ in (INPUTS, OUTPUTS))
        needed = missing not in ("encoder_gear.count", "sensor.tau_Nm")
        assert has_drive(having(inputs, outputs)) is not needed


def test_an_axis_is_what_follows_its_kind_in_a_name():
    system = having()
    fault = external("sensor.tau_Nm", "limits_flexion.fault")
    assert _axis(system, fault, "limits") == "_flexion"
    assert _axis(system, fault, "sensor") == ""
    with pytest.raises(AssertionError, match=r"sensor\.tau_Nm has nothing to do with smc"):
        _axis(system, fault, "smc")
    assert (_default(system, "limits", "tau_max_Nm"), _default(system, "limits", "x")) == (8.0, 3.0)


def test_a_wave_is_zero_at_0_and_2_and_one_between():
    assert [_wave(x) for x in (0.0, 0.5, 1.0, 1.5, 2.0)] == [0.0, 0.75, 1.0, 0.75, 0.0]


@pytest.mark.parametrize("fails", [0, 1, 2, 3])
def test_smaller_torques_are_tried_until_one_is_shown(fails, monkeypatch):
    asked, system = [], having()

    def tried(given, most_Nm):
        assert given is system
        asked.append(most_Nm)
        return ("made", "") if len(asked) > fails else (None, f"reason {len(asked)}")

    monkeypatch.setattr(example_module, "_tried", tried)
    # 4, 1.5 and half a percent of 8 Nm.
    shares = [0.32, 0.12, 0.04]
    if fails < 3:
        assert drive_example(system) == "made"
        assert asked == pytest.approx(shares[: fails + 1])
        return
    with pytest.raises(UserError, match=r"mine: .* cannot show the drive at work: reason 3\."):
        drive_example(system)
    assert asked == pytest.approx(shares)
