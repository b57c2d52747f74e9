"""Studies and their windows, for tests of both."""

from __future__ import annotations

import pytest

from esea_host.study.protocol import load_protocol
from tests.conducted import EXAMPLE, beginning, opening, study_of


@pytest.fixture(scope="session")
def protocol():
    return load_protocol(EXAMPLE)


@pytest.fixture
def study(tmp_path, protocol):
    return study_of(tmp_path / "s", protocol)


@pytest.fixture
def begin(tmp_path):
    yield from beginning(tmp_path / "s")


@pytest.fixture
def windows(qtbot):
    return opening(qtbot)
