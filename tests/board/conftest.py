"""The drivers of encoders and amplifiers, on a workbench of chip models."""

from __future__ import annotations

import pytest

from esea_gen.board.chips import Drivers, Workbench
from tests.conftest import require_tool


@pytest.fixture(scope="session")
def built_drivers():
    require_tool("gcc")
    return Drivers(Workbench())


@pytest.fixture
def drivers(built_drivers):
    """On an empty bench."""
    built_drivers.bench.__init__()
    return built_drivers
