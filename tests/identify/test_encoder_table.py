"""Correction table of an encoder from a simulated recording."""

from __future__ import annotations

import json

import numpy as np
import pytest

from esea_gen.device import load_device
from esea_gen.errors import UserError
from esea_gen.identify.drive.encoder_table import fit_table
from tests.typed import typed

BITS, PLAY_rad, ZERO_rad = 14, 2e-3, 0.7
FULL = 1 << BITS


def drawn(seed, direction, span_rad=2 * np.pi):
    """Counts and reference of a simulated bench: to and fro, with play, noise, two harmonics."""
    rng = np.random.default_rng(seed)
    sizes, phases = rng.uniform([0.004, 0.001], [0.017, 0.004]), rng.uniform(0, 2 * np.pi, 2)

    def error(raw):
        waves = [a * np.sin(k * raw + p) for k, a, p in zip((1, 2), sizes, phases, strict=True)]
        return waves[0] + waves[1]

    t = np.linspace(0, 1, 6000)
    angle = span_rad * (1 - np.abs(6 * t % 2 - 1))
    way = np.sign(np.gradient(angle))
    turned = angle + rng.normal(0, 2e-4, len(t))
    raw = turned
    for _ in range(4):  # raw + error(raw) is where the magnet is
        raw = turned - error(raw)
    count = np.floor(raw / (2 * np.pi) * FULL) % FULL
    return count, direction * (angle + way * PLAY_rad / 2) - ZERO_rad, error


@pytest.mark.parametrize("direction", [1, -1])
def test_the_intervals_hold_the_encoder_s_error(direction):
    nodes, held = 2 * np.pi * np.arange(32) / 32, []
    for seed in range(2):
        count, reference, error = drawn(seed, direction)
        found = fit_table("motor", count, reference, FULL, 32)
        true = error(nodes) - np.mean(error(nodes))
        held += [v.low <= x <= v.high for v, x in zip(found.values, true, strict=True)]
        assert found.direction == direction
        assert found.zero_rad == pytest.approx(ZERO_rad, abs=5e-4)
        assert found.play_rad.low <= PLAY_rad <= found.play_rad.high
        assert found.play_rad.half < 1e-4
        # With the table, half a count and the noise are left.
        raw = count * 2 * np.pi / FULL
        table = np.interp(raw, nodes, found.filled(), period=2 * np.pi)
        left = np.exp(1j * (raw + table - direction * (reference + ZERO_rad)))
        assert np.std(np.angle(left)) < 1.1e-3  # the play alone has 1e-3
        assert found.after_rad < 3e-4
        assert found.before_rad > 2e-3
    assert np.mean(held) > 0.88
    assert max(v.half for v in found.values) < 3e-4


def test_where_the_joint_never_was_the_neighbours_stand():
    count, reference, _ = drawn(0, 1, span_rad=3.0)
    found = fit_table("load", count, reference, FULL, 16)
    assert [k for k, v in enumerate(found.values) if v is None] == list(range(9, 16))
    filled = found.filled()
    assert filled[8:16] == pytest.approx(np.linspace(filled[8], filled[0], 9)[:8], abs=1e-6)
    assert "never there" in "\n".join(found.table())


def test_the_command_writes_a_device_file_that_has_the_table(tmp_path):
    bits = round(load_device("elbow_drive").file.encoder.resolution_bits.value)
    count, reference, _ = drawn(1, -1)
    rows = zip((count // (1 << (BITS - bits))).astype(int), reference, strict=True)
    text = "count,reference_rad\n" + "".join(f"{c},{r:.12g}\n" for c, r in rows)
    (tmp_path / "bench.csv").write_text(text)
    options = ["--values", "16", "--out", "made", "--json", "t.json"]
    done = typed("encoder-table", "elbow_drive", "bench.csv", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    content = json.loads((tmp_path / "t.json").read_text())
    side = load_device(tmp_path / "made" / "elbow_drive.toml").file.encoder.motor
    assert list(side.correction_rad.values) == content["correction_rad"]
    assert side.correction_rad.status == "identified"
    assert "95 % intervals" in side.correction_rad.source
    assert side.orientation_rad == side.correction_orientation_rad
    assert content["after_rad"] < 0.2 * content["before_rad"]
    made = tmp_path / "made" / "elbow_drive.toml"
    made.write_text(f"# Mine.\n{made.read_text()}")
    done = typed("encoder-table", "elbow_drive", "bench.csv", *options, cwd=tmp_path)
    assert (done.returncode, made.read_text()[:7]) == (2, "# Mine.")


def test_too_little_is_refused():
    count, reference, _ = drawn(0, 1)
    with pytest.raises(UserError, match="20: not a table size"):
        fit_table("motor", count, reference, FULL, 20)
    with pytest.raises(UserError, match="100 samples"):
        fit_table("motor", count[:100], reference[:100], FULL, 16)
