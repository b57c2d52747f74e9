"""Faults of the wiring: of a System small enough to list every one by hand."""

from __future__ import annotations

import numpy as np
import pytest

from esea_gen.emit.formats import FORMATS
from esea_gen.language.block import Block
from esea_gen.language.ports import Flag, Port, Tunable, flag_word
from esea_gen.language.system import Latched, System, Task
from esea_gen.verify.mutation.wiring import wiring_faults


def test_x():
    pass
