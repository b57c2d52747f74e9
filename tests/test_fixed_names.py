"""Names in q31: a field keeps its name when its range changes; the header says its scale."""

from __future__ import annotations

import re
import subprocess

import pytest

import esea_gen
from esea_gen.device import Device, parse_device
from esea_gen.emit.build import render_device, write_bundles

from .conftest import require_tool

# As its user writes it: no number of bits in it.
PROGRAM = """
#include <stdio.h>
#include "esea_elbow.h"
#include "esea_q31.h"
#include "esea_q31_units.h"

int main(void)
{
    esea_elbow_params_t params;
    esea_elbow_coeffs_t coeffs;
    esea_elbow_state_t state;
    esea_elbow_sense_in_t in;
    esea_elbow_sense_out_t out;
    int k;

    esea_elbow_default_params(&params);
    params.velocity.bandwidth_Hz =
        ESEA_Q31_FROM(20.0, ESEA_ELBOW_VELOCITY_PARAMS_BANDWIDTH_HZ_FRACTION);
    if (esea_elbow_prepare(&params, &coeffs) != 0u)
        return 1;
    esea_elbow_init(&coeffs, &state);
    for (k = 0; k <= 100; ++k) {
        in.theta_rad = ESEA_Q31_FROM(0.001 * k, ESEA_ELBOW_SENSE_IN_THETA_RAD_FRACTION);
        esea_elbow_sense_step(&coeffs, &state, &in, &out);
    }
    printf("%.9f %.9f\\n", ESEA_Q31_TO(out.tau_Nm, ESEA_ELBOW_SENSE_OUT_TAU_NM_FRACTION),
           (double)esea_q31_to_float(out.omega_rad_s, ESEA_ELBOW_SENSE_OUT_OMEGA_RAD_S_FRACTION));
    return 0;
}
"""
THETA = "ESEA_ELBOW_SENSE_IN_THETA_RAD_FRACTION"


@pytest.fixture(scope="module")
def wider(elbow) -> Device:
    """The elbow with 1.2 rad of deflection in place of 0.35: no longer below 1."""
    text, count = re.subn(
        r"(?m)^theta_rad = \{ value = 0.35", "theta_rad = { value = 1.2", elbow.toml()
    )
    assert count == 1
    return parse_device(text, "wider.toml")


def header(device: Device, real: str = "q31") -> str:
    return render_device(device, [real])[0].files["esea_elbow.h"]


def structs(text: str) -> dict[str, list[str]]:
    """Field names by struct."""
    bare = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    found = re.findall(r"typedef struct \{(.*?)\} (\w+);", bare, flags=re.S)
    return {name: re.findall(r"(\w+)(?:\[\d+\])?;", body) for body, name in found}


def scales(text: str) -> dict[str, int]:
    return {n: int(v) for n, v in re.findall(r"#define (\w+_FRACTION) (\d+)\b", text)}


@pytest.mark.ci
def test_names_stay_and_the_macro_goes_with_the_range(elbow, wider):
    before, after = header(elbow), header(wider)
    assert structs(after) == structs(before)
    # 0.35 needs no integer bit, 1.2 one.
    assert (scales(before)[THETA], scales(after)[THETA]) == (31, 30)
    assert scales(before).keys() == scales(after).keys()


def test_fields_are_called_as_in_single_precision(elbow):
    assert structs(header(elbow)) == structs(header(elbow, "f32"))


@pytest.mark.parametrize("name", ["elbow", "elbow_drive"])
def test_every_number_has_its_scale_where_its_comment_says_it(name):
    """The macro, the comment of the field, and the range in the comment agree."""
    text = render_device(esea_gen.load_device(name), ["q31"])[0].files[f"esea_{name}.h"]
    known, seen = scales(text), set()
    for body, c_name in re.findall(r"typedef struct \{(.*?)\} (\w+)_t;", text, flags=re.S):
        for comment, field in re.findall(
            r"/\*((?:(?!\*/).)*?)\*/\s*int32_t (\w+)", body, flags=re.S
        ):
            words = " ".join(comment.replace("*", " ").split())
            macro = f"{c_name}_{field}_fraction".upper()
            form = re.search(r"Q(\d+)\.(\d+), one unit", words)
            assert known[macro] == (int(form[2]) if form else 0), macro
            assert form or "whole number" in words, macro
            least, most = map(float, re.search(r"range (\S+) to ([^;\s]+)", words).groups())
            raw = [int(x) for x in re.search(r"raw (-?\d+) to (-?\d+)", words).groups()]
            if "cut to it by prepare" not in words:
                for end, whole in zip((least, most), raw, strict=True):
                    unit = 2.0 ** -known[macro]
                    assert abs(end - whole * unit) <= max(unit, 1e-8 * abs(end)), macro
            seen.add(macro)
    assert len(seen) > 10
    assert known.keys() == seen


def answer(device: Device, folder) -> list[float]:
    gcc = require_tool("gcc")
    write_bundles(render_device(device, ["q31"]), folder)
    (folder / "q31" / "main.c").write_text(PROGRAM)
    strict = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror"]
    sources = sorted(str(p) for p in (folder / "q31").glob("*.c"))
    subprocess.run([gcc, *strict, *sources, "-o", str(folder / "user")], check=True)
    done = subprocess.run([str(folder / "user")], capture_output=True, text=True, check=True)
    return [float(x) for x in done.stdout.split()]


def exact(device: Device) -> list[float]:
    simulator = device.system.simulator({"velocity": {"bandwidth_Hz": 20.0}})
    for k in range(101):
        out = simulator.step("sense", theta_rad=0.001 * k)
    return [float(out["tau_Nm"]), float(out["omega_rad_s"])]


@pytest.mark.ci
def test_a_program_goes_on_compiling_and_means_the_same(elbow, wider, tmp_path):
    for device in (elbow, wider):
        assert answer(device, tmp_path / device.origin) == pytest.approx(exact(device), abs=2e-4)


def test_without_the_macro_the_same_program_is_wrong(wider, tmp_path, monkeypatch):
    """The test above can fail: the number of bits from before the change."""
    monkeypatch.setattr(f"{__name__}.PROGRAM", PROGRAM.replace(THETA, "31"))
    assert abs(answer(wider, tmp_path)[0] - exact(wider)[0]) > 0.1
