"""What an identification searches over and accepts, written down a second time."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError

from esea_gen.identify.compare import CompareRow, ModelComparison
from esea_gen.identify.peers import PEERS
from esea_gen.identify.population import polished
from esea_gen.identify.quality import spikes
from esea_gen.identify.recording import _spiked
from esea_gen.identify.tables import (
    ConditionTable,
    Cycles,
    Deflection,
    DeviceTable,
    Mapping,
    Sampling,
    Search,
    TableFormat,
    Torque,
)


def test_peers_are_searched_over_these_ranges():
    # Yield in rad, exponent, share of the path's direction; relaxation times in seconds.
    low, high = PEERS["Bouc-Wen (SciPy)"][1:]
    assert [np.exp(low[0]), *low[1:]] == pytest.approx([0.01, 0.3, 0.0])
    assert [np.exp(high[0]), *high[1:]] == pytest.approx([3.0, 4.0, 1.0])
    low, high = PEERS["Maxwell + Coulomb (SciPy)"][1:]
    assert np.exp(low) == pytest.approx([0.03, 0.3, 3.0])
    assert np.exp(high) == pytest.approx([3.0, 30.0, 1000.0])


def test_a_condition_has_a_name_if_of_one_letter_and_a_file():
    assert ConditionTable(name="a", files=["b"]).files == ["b"]
    for wrong in ({"name": "", "files": ["b"]}, {"name": "a", "files": []}):
        with pytest.raises(ValidationError):
            ConditionTable(**wrong)


# Of every number in a mapping: the least and the largest that is taken, and whether the end itself
# is; None: no end.
NUMBERS = {
    DeviceTable: {"limit_factor": (1, 10)},
    Sampling: {"min_step_s": ("above", 0, 10), "fit_rate_Hz": (50, 10000)},
    Cycles: {
        "skip_first": (0, 1000),
        "hold_out_last": (1, 1000),
        "hysteresis": ("above", 0, "below", 0.5),
        "block_tolerance": ("above", 0, "below", 1),
    },
    Search: {"seed": (0, None), "population": (16, 65536)},
    TableFormat: {"header_line": (0, 1000), "first_data_line": (1, 1000)},
}
QUANTITIES = {
    DeviceTable: {
        "stops": (1, 32),
        "sense_rate_Hz": (50, 10000),
        "bandwidth_Hz": (2, 100),
        "resolution_bits": (8, 24),
    },
    Deflection: {
        "scale_rad_per_m": (1e-6, 1e6),
        "backlash_rad": (0, 1),
        "dead_zone_rad": (0, np.deg2rad(6)),
    },
    Torque: {"scale_Nm_per_N": (1e-9, 1e6), "lag_s": (-1.0, 1.0)},
    Sampling: {"period_s": (1e-6, 100)},
    Mapping: {"full_scale_Nm": (1e-3, 1000)},
}
WANTED = {"name": "a", "title": "A", "rate_terms": False}


@pytest.mark.parametrize("table", NUMBERS, ids=lambda t: t.__name__)
def test_ends_of_a_mappings_plain_numbers(table):
    base = WANTED if table is DeviceTable else {}
    for name, ends in NUMBERS[table].items():
        words = [e for e in ends if isinstance(e, str)]
        low, high = (e for e in ends if not isinstance(e, str))
        for end, open_, way in ((low, "above" in words, -1), (high, "below" in words, 1)):
            if end is None:
                continue
            whole = table.model_fields[name].annotation in (int, int | None)
            out = end + way * (1 if whole else 1e-9 * max(1, end))
            inside = end if not open_ else end - way * 1e-9
            assert getattr(table(**base, **{name: inside}), name) == inside
            for wrong in (end if open_ else out, out):
                with pytest.raises(ValidationError):
                    table(**base, **{name: wrong})


def test_ends_of_a_mappings_numbers_with_a_status():
    for table, fields in QUANTITIES.items():
        for name, ends in fields.items():
            told = table.model_fields[name].json_schema_extra
            assert (told["low"], told["high"]) == ends, name
    # None is left out.
    for table in {*NUMBERS, *QUANTITIES}:
        limited = {n for n, f in table.model_fields.items() if f.json_schema_extra}
        assert limited == set(QUANTITIES.get(table, {}))
        bounded = {n for n, f in table.model_fields.items() if any(
            hasattr(m, k) for m in f.metadata for k in ("ge", "gt", "le", "lt"))}  # fmt: skip
        assert bounded == set(NUMBERS.get(table, {}))
    assert (DeviceTable(**WANTED).limit_factor, Cycles().hysteresis) == (1.5, 0.05)
    assert (Cycles().skip_first, Cycles().held_out_last, Cycles().block_tolerance) == (1, 1, 0.1)
    found = DeviceTable(**WANTED)
    quantities = found.stops, found.sense_rate_Hz, found.bandwidth, found.resolution_bits
    assert [q.value for q in quantities] == [10, 1000, 15, 14]
    fine = {"resolution_bits": found.stops.model_copy(update={"value": 24})}
    assert found.model_copy(update=fine).bandwidth.value == 60
    assert found.model_copy(update=fine | {"bandwidth_Hz": found.stops}).bandwidth.value == 10
    # Nobody wrote a bandwidth: it keeps to its own limit at a slow rate.
    slow = fine | {"sense_rate_Hz": found.stops.model_copy(update={"value": 500})}
    assert found.model_copy(update=slow).bandwidth.value == 50


def test_a_polish_starts_a_millionth_of_the_box_inside_either_end():
    low, high = np.array([-3.0, 10.0]), np.array([-1.0, 50.0])
    for corner, off in ((low, [2e-6, 4e-5]), (high, [-2e-6, -4e-5])):
        asked = []
        polished(lambda x, seen=asked: seen.append(x.copy()) or x - 20, corner, low, high)
        assert asked[0] - corner == pytest.approx(off, rel=1e-6)


def test_spikes_are_counted_in_plain_words():
    tau = np.zeros(10000)
    tau[[5, 70]] = 3.0, -12.5
    told = [_spiked(np.arange(10000) == 5, tau), _spiked(np.abs(tau) > 1, tau)]
    assert [f.text for (f,) in told] == [
        "1 spike in the torque, up to 3 Nm, neither train nor judge",
        "2 spikes in the torque, up to 12.5 Nm, neither train nor judge",
    ]
    assert not any(f.stops for (f,) in told)
    assert _spiked(tau > 99, tau) == ()


def test_a_comparison_in_the_terminal():
    rows = (
        CompareRow("published", "slow", 1.25, 2.5, 810.4),
        CompareRow("published", "a long name of one", 0.5, 10.0, 810.4),
        CompareRow("peer", "slow", 1.0, 2.0, None),
        CompareRow("peer", "a long name of one", 1.5, 9.0, None),
    )
    title = SimpleNamespace(mapping=SimpleNamespace(device=SimpleNamespace(title="Rubber")))
    found = ModelComparison(title, 6.5, rows, "published", "peer", 0.123, {}, ("mind",))
    assert found.table() == [
        "Rubber: held out / training, RMS in % of full scale (6.5 Nm)",
        "           " + "slow".rjust(20) + "a long name of one".rjust(20) + "  instructions",
        "* published" + "2.50 / 1.25".rjust(20) + "10.00 / 0.50".rjust(20) + "810".rjust(14),
        "  peer     " + "2.00 / 1.00".rjust(20) + "9.00 / 1.50".rjust(20) + "-".rjust(14),
        "* chosen: the cheapest that is as good as the best (peer) within one standard error of "
        "the difference (0.12 %)",
        "note: mind",
    ]


def test_no_spike_is_where_the_deflection_turns_as_sharply():
    ramp = np.linspace(0, 1, 200)
    for apart in range(7):
        theta, tau = ramp.copy(), 10 * ramp
        theta[100] += 0.3
        tau[100 + apart] += 4.0
        # Three samples either way; without a turn every one of them.
        assert np.flatnonzero(spikes(theta, tau)).tolist() == ([] if apart <= 3 else [100 + apart])
        assert np.flatnonzero(spikes(ramp, tau)).tolist() == [100 + apart]
    # As wide as three samples, and no wider; a share of the range off, and no less.
    for width, found in ((3, 3), (4, 0)):
        tau = np.zeros(200)
        tau[:20] = 10.0  # the range
        tau[90 : 90 + width] = 1.0
        assert np.count_nonzero(spikes(ramp, tau)) == found
    for size, found in ((0.79, 0), (0.81, 1)):
        tau = np.zeros(200)
        tau[:20], tau[90] = 10.0, size
        assert np.count_nonzero(spikes(ramp, tau)) == found
