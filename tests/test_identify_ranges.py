"""What an identification searches over and accepts, written down a second time."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from esea_gen.identify.mapping import ConditionTable
from esea_gen.identify.peers import PEERS


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
