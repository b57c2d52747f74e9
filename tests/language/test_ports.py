"""Ports: names with their units, the nearest float32 ends, names that C has taken."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from esea_gen.language.component import check_ports, start_functions
from esea_gen.language.ports import Constant, Flag, Port, Tunable, f32_inside, threshold, unit_of

UNITS = {
    "rad": "rad",
    "deg": "deg",
    "rad_s": "rad/s",
    "rad_s2": "rad/s^2",
    "rad_s3": "rad/s^3",
    "Nm": "Nm",
    "Nm_rad": "Nm/rad",
    "Nm_rad3": "Nm/rad^3",
    "Nms_rad": "Nm s/rad",
    "Nm_s": "Nm/s",
    "Nm_s2": "Nm/s^2",
    "Nm_s_rad": "Nm/(rad s)",
    "1_rad": "1/rad",
    "1_s": "1/s",
    "1_s2": "1/s^2",
    "s": "s",
    "Hz": "Hz",
    "bits": "bit",
    "kgm2": "kg m^2",
    "J": "J",
    "W": "W",
    "C": "degC",
    "per_K": "1/K",
}


@pytest.mark.parametrize(("suffix", "unit"), UNITS.items())
def test_a_name_ends_in_its_unit(suffix, unit):
    name = f"some_{suffix}"
    assert unit_of(name) == unit
    assert Port(name, 0, 1, "made up").unit == unit
    assert Tunable(name, 0, 0, 1, "made up").unit == unit
    assert Constant(name, 1.0, "made up", "assumed").unit == unit
    assert unit_of(f"{name}_more") == "1"
    assert Port(name, 0, 1, "made up", flags=(Flag("BAD", "made up"),)).unit == "bits"


@settings(max_examples=40)
@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_ends_are_the_nearest_float32_numbers_inside(low, width):
    high = low + width
    found = f32_inside(low, high)
    port = Port("x", low, high, "made up") if found[0] < found[1] else None
    if port:
        assert (port.low, port.high) == found
    for end, given_end, way in zip(found, (low, high), (-1, 1), strict=True):
        assert float(np.float32(end)) == end
        assert way * end <= way * given_end
        beyond = float(np.nextafter(np.float32(end), np.float32(way * np.inf)))
        assert way * beyond > way * given_end
    assert threshold(width) == f32_inside(0.0, width)[1]


TAKEN = """
int,xor,co_await,char8_t,typeof,_Bool,_x,a__b,NAN,INFINITY,EOF,errno,assert,I,abs,B0,F,PI,DEC,bit,
round,sq,radians,word,min,1x,theta-rad,größe,,a b"""


@pytest.mark.parametrize("name", TAKEN.replace("\n", "").split(","))
@pytest.mark.parametrize(
    "define",
    [
        lambda n: Port(n, 0, 1, "meaning"),
        lambda n: Tunable(n, 0.5, 0, 1, "meaning", "source", "assumed"),
        lambda n: check_ports(n, "title", 1e-3),
    ],
    ids=["port", "tunable", "block"],
)
def test_a_name_that_c_or_arduino_has_taken_is_rejected(define, name):
    """And the name that the message proposes is none of them."""
    with pytest.raises(ValueError, match=r"(port|tunable|block) name ") as told:
        define(name)
    define(str(told.value).rpartition("; use ")[2].split("'")[1])


X = Port("x", 0, 1, "meaning")


def tuned(derived) -> None:
    gain = Tunable("gain", 1, 0, 1, "gain")
    start_functions("a", (gain,), (X,), (), lambda t: {"x": derived(t.gain)})


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: check_ports("a", "*/ title", 1e-3), "comment of the C"),
        (lambda: check_ports("a", "title", 0.0), "must be positive, got 0"),
        (lambda: check_ports("a", "title", 1e-3, (X, replace(X, name="X"))), "name occurs twice"),
        (lambda: replace(X, size=0), "size 0 is below 1"),
        (lambda: replace(X, flags=(Flag("Bad", "meaning"),)), "not all different .* capitals"),
        (lambda: replace(X, flags=2 * (Flag("BAD", "meaning"),)), "not all different"),
        (lambda: Port.count("x", 2**24, "meaning"), r"below 2\^24"),
        (lambda: tuned(lambda g: 2 * g), r"x is 2 at gain = 1, outside \[0, 1\]"),
        (lambda: tuned(lambda g: ca.log(g - 0.5)), "x is -0.6.* at gain = 1"),
        (lambda: tuned(lambda g: ca.sqrt(g - 0.5)), "x is nan at gain = 0"),
    ],
)
def test_a_wrong_port_or_block_is_refused(make, said):
    with pytest.raises(ValueError, match=said):
        make()
