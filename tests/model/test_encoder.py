"""Encoder front end: against a model in whole numbers, np.interp, and deliberate faults."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import esea_gen
from esea_gen.device import Device, parse_device
from esea_gen.errors import UserError
from esea_gen.hostlib.library import CRunner, compile_system
from esea_gen.language.block import Block
from esea_gen.language.system import System, Task
from esea_gen.model.encoder import FrameError, encoder, step_max_counts
from tests.own_device import own_text, q

BITS = {
    name: 1 << i
    for i, name in enumerate(
        [
            "INPUT_INVALID",
            "STATE_REPAIRED",
            "FRAME_ERROR",
            "IMPLAUSIBLE_STEP",
            "HELD_TOO_LONG",
            "SETTLING",
            "NOT_ZEROED",
            "REFERENCE_LOST",
        ]
    )
}
TURN = 2 * math.pi


def device_text(bits: int = 12, motor: str = "", load: str = "", more: str = "") -> str:
    sections = f"[encoder.motor]\n{motor}\n[encoder.load]\n{load}\n{more}"
    return own_text(f"[encoder]\nresolution_bits = {q(bits)}\n{sections}", name="bench")


def make(bits: int = 12, motor: str = "", load: str = "", more: str = "") -> Device:
    return parse_device(device_text(bits, motor, load, more), "bench.toml")


def row(values, at: float = 0.0) -> str:
    return (
        f'correction_rad = {{ values = {[float(v) for v in values]}, status = "identified", '
        f'source = "a test" }}\ncorrection_orientation_rad = {q(at)}'
    )


def reading(device: Device, *blocks: Block) -> System:
    names = [b.name for b in blocks]
    return System(
        device.name,
        device.period_s,
        dict(zip(names, blocks, strict=True)),
        (Task("read", tuple(names)),),
        {},
        {f"{b.name}_{p.name}": (f"{b.name}.{p.name}",) for b in blocks for p in b.inputs},
        {f"{n}_{p}": f"{n}.{p}" for n in names for p in ("theta_rad", "usable", "status")},
    )


def compiled(device: Device, real: str, side: str = "motor") -> CRunner:
    block = encoder(device, side)
    return compile_system(reading(device, block), real).block(block.name)


ZEROED = f"zero_rad = {q(0.25)}"
VARIANTS = {
    "plain": (12, ZEROED),
    "turned": (12, f"zero_rad = {q(-2.9)}\ndirection = {q(-1)}"),
    "fine": (14, f"zero_rad = {q(3.1)}\nheld_max = {q(5)}\nstep_max_rad = {q(0.03)}"),
    "coarse": (8, f"zero_rad = {q(0.0)}\nheld_max = {q(1)}\ndirection = {q(-1)}"),
}


@cache
def variant(name: str, real: str) -> tuple[Device, CRunner]:
    device = make(*VARIANTS[name])
    return device, compiled(device, real)


class Whole:
    """The front end in Python's whole numbers, from its description; turns are never counted."""

    MIDDLE = (-0.6 + 3.0) / 2

    def __init__(self, device: Device) -> None:
        own = device.file.encoder.motor
        self.full = 2 ** int(device.file.encoder.resolution_bits.value)
        self.sign = -1 if own.direction and own.direction.value < 0 else 1
        self.zero = own.zero_rad.value
        self.held_max = int(own.held_max.value) if own.held_max else 3
        if own.step_max_rad:
            self.step = int(own.step_max_rad.value / TURN * self.full)
        else:
            self.step = math.ceil((12e-3 + math.radians(0.5)) / TURN * self.full) + 1
        self.position: int | None = None  # counts since count 0 of turn 0, over all turns
        self.bad = self.agreeing = 0
        self.lost = False

    def begin(self, count: int) -> None:
        middle = Fraction(self.MIDDLE + self.zero) / Fraction(TURN) * self.full * self.sign
        self.position = count + self.full * round((middle - count) / self.full)
        self.agreeing = 1

    def read(self, count: int, error: int) -> tuple[float, int]:
        status = 0
        good = False
        if error:
            status |= BITS["FRAME_ERROR"]
        elif self.agreeing == 0:
            good = not self.lost
            if good:
                self.begin(count)
        else:
            ahead = (count - self.position) % self.full
            step = ahead if ahead <= self.full // 2 else ahead - self.full
            if abs(step) <= self.step * (self.bad + 1):
                good = not self.lost
                if good:
                    self.position += step
                    self.agreeing = min(self.agreeing + 1, 4)
            else:
                status |= BITS["IMPLAUSIBLE_STEP"]
                if self.agreeing < 4 and not self.lost:
                    good = True
                    self.begin(count)
        if good:
            self.bad = 0
        else:
            self.bad = min(self.bad + 1, self.held_max + 1)
        if self.bad > self.held_max:
            status |= BITS["HELD_TOO_LONG"]
            if status & BITS["IMPLAUSIBLE_STEP"] and self.agreeing == 4:
                self.lost = True
            self.agreeing = 0
        if self.agreeing < 4:
            status |= BITS["SETTLING"]
        if self.lost:
            status |= BITS["REFERENCE_LOST"]
        position = 0 if self.position is None else self.position
        return self.sign * position * TURN / self.full - self.zero, status


def counts_of(device: Device, theta) -> np.ndarray:
    """Counts of an ideal encoder at joint angles."""
    own, full = device.file.encoder.motor, 2 ** int(device.file.encoder.resolution_bits.value)
    sign = -1 if own.direction and own.direction.value < 0 else 1
    return (
        np.floor(sign * (np.asarray(theta) + own.zero_rad.value) / TURN * full).astype(int) % full
    )


# A joint's motion and what goes wrong, in pieces.
PIECES = st.lists(
    st.tuples(
        st.floats(-12, 12),  # speed, rad/s: up to the joint's limit
        st.integers(1, 80),
        st.sampled_from(["clean", "clean", "errors", "single", "corrupt", "noise", "slip"]),
    ),
    min_size=1,
    max_size=12,
)


def recording(device: Device, pieces, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    full = 2 ** int(device.file.encoder.resolution_bits.value)
    theta, slip = rng.uniform(-0.6, 3.0), 0
    counts, errors = [], []
    for speed, steps, kind in pieces:
        for k in range(steps):
            # Turns back at the ends of four turns either way.
            theta = float(np.clip(theta + speed * 1e-3, -20, 20))
            if kind == "slip" and k == 0:
                slip += int(rng.integers(full))
            count = (int(counts_of(device, theta)) + slip) % full
            if kind == "noise":
                count = (count + int(rng.integers(-2, 3))) % full
            if kind == "corrupt" and rng.random() < 0.4:
                count = int(rng.integers(full))
            wrong = (kind == "errors" and rng.random() < 0.6) or (kind == "single" and k == 0)
            counts.append(int(rng.integers(full)) if wrong else count)
            errors.append(int(rng.integers(1, 128)) if wrong else 0)
    return np.array(counts), np.array(errors)


@pytest.mark.parametrize("name", VARIANTS)
@settings(max_examples=40)
@given(PIECES, st.integers(0, 999))
def test_it_does_what_the_whole_numbers_say(name, pieces, seed):
    device, runner = variant(name, "f32")
    counts, errors = recording(device, pieces, seed)
    runner.reset()
    got, _ = runner.run({"count": counts, "frame_error": errors}, trace=False)
    model = Whole(device)
    expected = [model.read(int(c), int(e)) for c, e in zip(counts, errors, strict=True)]
    assert got["status"].astype(int).tolist() == [s for _, s in expected]
    # [angle]: three roundings of at most 2^-24 of 40 rad.
    assert got["theta_rad"] == pytest.approx([a for a, _ in expected], abs=8e-6)
    doubt = BITS["HELD_TOO_LONG"] | BITS["SETTLING"] | BITS["REFERENCE_LOST"] | BITS["NOT_ZEROED"]
    assert np.array_equal(got["usable"] == 1, (got["status"].astype(int) & doubt) == 0)
    assert set(np.unique(got["usable"])) <= {0.0, 1.0}


@pytest.mark.parametrize("name", VARIANTS)
def test_the_joint_angle_through_turns_at_the_speed_limit(name):
    device, runner = variant(name, "f64")
    t = np.arange(4000) * 1e-3
    theta = 1.2 + 12 / (TURN * 0.4) * 0.99 * np.sin(TURN * 0.4 * t)  # 4.7 rad either way
    runner.reset()
    counts = counts_of(device, theta)
    got, _ = runner.run({"count": counts, "frame_error": 0 * counts}, trace=False)
    assert np.ptp(theta) > 1.4 * TURN
    full = 2 ** int(device.file.encoder.resolution_bits.value)
    # A count is the lower end of its interval in the encoder's own direction.
    assert np.max(np.abs(got["theta_rad"] - theta)) <= TURN / full * 1.0000001
    assert np.all(got["usable"][3:] == 1)
    assert not np.any(got["usable"][:3])
    assert not np.any(got["status"][3:])


# -- single faults ----------------------------------------------------------------------------


def still(steps: int, count: int = 1000) -> dict[str, np.ndarray]:
    return {"count": np.full(steps, float(count)), "frame_error": np.zeros(steps)}


def status_of(got) -> np.ndarray:
    return got["status"].astype(int)


@pytest.mark.parametrize(
    ("bad", "error", "flag"),
    [
        (1200, 0, "IMPLAUSIBLE_STEP"),
        (1000 + 2048, 0, "IMPLAUSIBLE_STEP"),
        (1001, FrameError.PARITY, "FRAME_ERROR"),
        (1001, FrameError.FIELD_WEAK | FrameError.OVERFLOW, "FRAME_ERROR"),
        (np.nan, 0, "INPUT_INVALID"),
        (np.inf, 0, "INPUT_INVALID"),
        (-1, 0, "INPUT_INVALID"),
        (4096, 0, "INPUT_INVALID"),
        (1001, np.nan, "INPUT_INVALID"),
        (1001, -np.inf, "INPUT_INVALID"),
        (1001, 128, "INPUT_INVALID"),
    ],
)
def test_a_bad_frame_leaves_the_angle_alone(bad, error, flag):
    _, runner = variant("plain", "f32")
    for length in (1, 3, 4):
        runner.reset()
        inputs = still(60)
        inputs["count"][20 : 20 + length] = bad
        inputs["frame_error"][20 : 20 + length] = error
        got, _ = runner.run(inputs)
        assert np.all(got["theta_rad"] == got["theta_rad"][10])
        here = status_of(got)[20 : 20 + length]
        assert np.all(here[:3] == BITS[flag])
        assert np.all(got["usable"][4 : 20 + min(length, 3)] == 1)
        assert runner.state[f"n_{flag.lower()}"][0] >= length
        if length <= 3:
            assert not np.any(status_of(got)[20 + length :])
        else:
            assert got["usable"][23] == 0
            assert here[3] & BITS["HELD_TOO_LONG"]


def test_a_slip_is_not_followed_until_init():
    device, runner = variant("plain", "f32")
    reach = 4 * step_max_counts(device, "motor")
    for slip, seen in ((reach + 1, True), (-reach - 1, True), (2048, True), (reach, False)):
        runner.reset()
        inputs = still(500)
        inputs["count"][100:] = (1000 + slip) % 4096
        got, _ = runner.run(inputs, trace=False)
        word = status_of(got)
        assert (got["usable"][-1] == 0) == seen
        assert bool(word[-1] & BITS["REFERENCE_LOST"]) == seen
        if seen:
            assert np.all(got["theta_rad"][100:] == got["theta_rad"][50])
            runner.reset()
            after, _ = runner.run({k: v[100:] for k, v in inputs.items()}, trace=False)
            assert np.all(after["usable"][3:] == 1)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e9, -1e9])
def test_corrupt_states_start_afresh(bad):
    _, runner = variant("plain", "f32")
    for name in ("count_last", "turn", "held", "settled", "lost"):
        runner.reset()
        before, _ = runner.run(still(20), trace=False)
        runner.put_state({name: bad})
        got, states = runner.run(still(20))
        assert status_of(got)[0] == BITS["STATE_REPAIRED"] | BITS["SETTLING"]
        assert got["usable"].tolist() == [0] * 3 + [1] * 17
        assert np.all(got["theta_rad"] == before["theta_rad"][-1])
        assert all(np.all(np.isfinite(v)) for v in states.values())


# -- zero, direction, settings ------------------------------------------------------------------


def test_without_a_calibration_it_is_not_usable():
    runner = compiled(esea_gen.load_device("elbow"), "f32", "load")
    got, _ = runner.run(still(20), trace=False)
    assert not np.any(got["usable"])
    assert np.all(status_of(got)[3:] == BITS["NOT_ZEROED"])
    # What a calibration does: the angle where the joint is at 0, then init.
    runner.prepare({"zero_rad": float(got["theta_rad"][-1]), "zeroed": 1.0})
    after, _ = runner.run(still(20), trace=False)
    assert after["theta_rad"] == pytest.approx(np.zeros(20), abs=1e-6)
    assert np.all(after["usable"][3:] == 1)
    # On the other side of the turn's end the joint still stands near its range.
    runner.prepare({"zero_rad": -3.0, "zeroed": 1.0})
    after, _ = runner.run(still(20, 4000), trace=False)
    assert after["theta_rad"][-1] == pytest.approx(4000 / 4096 * TURN + 3.0 - TURN, abs=1e-6)


# -- correction ---------------------------------------------------------------------------------


def measured_error(phi):
    """A part's integral nonlinearity: 1 deg, eccentricity and four poles."""
    return np.radians(0.7 * np.sin(phi + 0.4) + 0.3 * np.sin(4 * phi - 1))


def test_correction_takes_out_a_parts_nonlinearity():
    phi = np.linspace(0, TURN, 4096, endpoint=False)
    left = {}
    for size in (16, 64):
        # The raw angle is the true one and its error; characterised at the nodes.
        nodes = np.arange(size) * TURN / size
        true = nodes.copy()
        for _ in range(60):
            true = nodes - measured_error(true)
        runner = compiled(make(14, f"zero_rad = {q(0.0)}\n" + row(true - nodes)), "f32")
        raw = phi + measured_error(phi)
        counts = np.floor(raw / TURN * 2**14 + 0.5).astype(int) % 2**14
        got, _ = runner.run({"count": counts, "frame_error": 0 * counts}, trace=False)
        error = (got["theta_rad"] - phi + math.pi) % TURN - math.pi
        left[size] = math.degrees(np.max(np.abs(error)))
    # docs/encoder.md: of 1 deg, interpolation leaves 0.3 deg (1 - cos(4 pi / N)) and half a count.
    assert np.degrees(np.max(np.abs(measured_error(phi)))) > 0.95
    for size, degrees in left.items():
        bound = 0.3 * (1 - math.cos(4 * math.pi / size)) + 0.7 * (1 - math.cos(math.pi / size))
        assert degrees < 1.15 * bound + 0.5 * 360 / 2**14 + 0.003
        assert degrees > 0.5 * bound
    assert left[64] < 0.025


# -- device files -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("motor", "message"),
    [
        (f"direction = {q(0)}", "direction = 0 is neither 1 nor -1"),
        (f"direction = {q(0.5)}", "not a whole number"),
        (f"zero_rad = {q(4)}", "zero_rad = 4 rad is above its limit 3.14159 rad"),
        (f"zero_deg = {q(4)}", "in 'rad'. Convert the number and name the key zero_rad"),
        (f"held_max = {q(11)}", "held_max = 11 is above its limit 10"),
        (row([0, 0, 0]), "has 3 values; it takes 4, 8, 16, 32, 64"),
        (row([0, 0.01, 0, -0.2]), "value 3 (counted from 0) is -0.2 rad, outside -0.09 to 0.09"),
        (row([0.03, -0.03] * 32), "no encoder's error is as steep"),
        (row([0.0] * 63 + [0.05]), "from value 62 to the next"),
        (row([0.05 * i / 63 for i in range(64)]), "from value 63 to the next"),
        (row([0.01, 0, 0, 0], 0.5), "mounted at orientation_rad = 0 rad, 0.5 rad away"),
        (
            f"orientation_rad = {q(0.1)}\n" + row([0.01, 0, 0, 0], 0.15),
            "Characterise it again as it is mounted",
        ),
        (row([0, 0, 0, 0]).split("\n")[0], "without correction_orientation_rad"),
        (f"correction_orientation_rad = {q(0)}", "without correction_rad"),
        ("correction_rad = [0, 0, 0, 0]", "A row of numbers is written { values ="),
        (row([0, 0, 0, 0]).replace("[0.0, ", '["0", '), "must be a valid number"),
        (row([0, 0, 0, 0]).replace("[0.0, ", "[nan, "), "finite number"),
        (row([0, 0, 0, 0]).replace('"a test" }\n', '"*/" }\n'), "end or break a comment"),
    ],
)
def test_bad_settings_are_refused(motor, message):
    with pytest.raises(UserError) as error:
        make(12, motor)
    assert message in str(error.value)
    assert "bench.toml" in str(error.value)


def test_what_cannot_be_told_apart_is_refused():
    with pytest.raises(UserError, match=r"largest believable step, 912 counts .*half a turn"):
        encoder(make(12, f"step_max_rad = {q(1.4)}"), "motor")
    # The last one that can, with two bad frames bridged: 3 * 682 = 2046 counts.
    encoder(make(12, f"step_max_rad = {q(682.5 / 4096 * TURN)}\nheld_max = {q(2)}"), "motor")
    with pytest.raises(UserError, match="683 counts"):
        encoder(make(12, f"step_max_rad = {q(683.5 / 4096 * TURN)}\nheld_max = {q(2)}"), "motor")
    wide = f"[joint]\ntheta_min_rad = {q(-2.6)}\n"
    with pytest.raises(UserError, match=r"spans 6\.3 rad, not below one turn"):
        encoder(make(12, more=wide), "motor")
