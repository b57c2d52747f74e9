"""Every equation that pages and C comments show, against the same one typed again from its source.

The thesis' equations are those of its text with the corrections that the pages list; ours are those
of the pages.  What the Blocks compute is held against the shown ones in test_equations.py and in
the Blocks' own tests.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from functools import cache
from random import Random

import pytest
from scipy.integrate import quad

from esea_gen.control.adaptation import adaptation
from esea_gen.control.governor import smoothed_setpoint, torque_lead
from esea_gen.control.impairment import impairment
from esea_gen.control.law_switch import law_switch
from esea_gen.control.limits import limits
from esea_gen.control.passivity import passivity
from esea_gen.control.redundancy import redundancy
from esea_gen.control.reference import reference
from esea_gen.control.setpoint import setpoint_rates
from esea_gen.control.sliding_mode import sliding_mode
from esea_gen.control.surface import surface_equations
from esea_gen.control.trend import trend
from esea_gen.device import Device, load_device, parse_device
from esea_gen.language.ports import Equation
from esea_gen.model.cubic import segment_equations
from esea_gen.model.elastomer import torque_sensor
from esea_gen.model.encoder import encoder
from esea_gen.model.family import FittedMember, Member, Rise, Term
from esea_gen.model.family_sensor import family_sensor
from esea_gen.model.filters import tracking_observer
from esea_gen.model.gear_encoder import gear_encoder
from esea_gen.model.inverse import exact_inverse
from esea_gen.model.joint import deflection
from esea_gen.model.published_inverse import published_inverse
from esea_gen.model.smoothing import smoothed_deflection
from esea_gen.model.velocity_properties import velocity_properties
from esea_gen.observe.cable import cable_observer
from esea_gen.observe.disturbance import drive_observer
from esea_gen.observe.extrapolation import parabola
from esea_gen.observe.human import extended_state, lag_observer
from esea_gen.observe.rates import motor_rate
from esea_gen.twin.plant import plant_block
from esea_host.wrist.rig import impaired_device

from .shown_equations import names, value

# In place of what an index or a prime makes no name of: an underscore.
TYPED = {
    # Elastomer, spec of the thesis' chapter 3; (3.3) by one exponential step of its linear
    # equation, whose phi_1 is cut after the third term.
    "(3.1)": "tau_s + tau_r + tau_h",
    "(3.2)": "k_1 * theta + k_3 * theta**3",
    "(3.2) dead": "k_1 * delta + k_3 * delta**3",
    "(3.3)": "(tau_r_k_1 + k_v * sigma * (theta_k - theta_k_1)) / (1 + x * sigma)",
    "(3.3) dead": "(tau_r_k_1 + k_v * sigma * (delta_k - delta_k_1)) / (1 + x * sigma)",
    "[series]": "1 + x / 2 + x * x / 6",
    "[step]": "h * k_v / eta",
    "(3.4)": "(A * abs(theta)**m + epsilon_1) / (B * abs(omega_m)**n + epsilon_2)",
    "(3.4) dead": "(A * abs(delta)**m + epsilon_1) / (B * abs(omega_delta)**n + epsilon_2)",
    "(3.5-3.7), play form": "clip(F_i_k_1, theta_k - r_i, theta_k + r_i)",
    "(3.5-3.7), play form dead": "clip(F_i_k_1, delta_k - r_i, delta_k + r_i)",
    "(3.9)": "N * p_i * E_i",
    "(3.10)": "alpha / exp(beta * r_i)",
    "(3.11)": "omega * i",
    "(8.7/8.8)": "theta - clip(theta, -theta_dz, theta_dz)",
    "[gate]": "omega_m if abs(theta_k_1) > theta_dz else 0",
    # Exact inverse: one segment of the cubic, and its root without cancellation.
    "[segment]": "k_3 * x**3 + a * x",
    "[breakpoint]": "r_i + F_i * s",
    "[a]": "k_1 + g + N * p_i",
    "[root 1]": "a / k_3 / 3",
    "[root 2]": "abs(d) / k_3 / 2",
    "[root 3]": "(b + (b**2 + a_3**3)**0.5)**(1 / 3)",
    "(4.13), stable form": "2 * b / (c**2 + a_3 + (a_3 / c)**2)",
    # Published inverse, chapter 4.
    "(4.7), as meant": "N * p_j * F_j",
    "(4.8)": "kappa / exp(phi * r_j)",
    "(4.9)": "j * chi",
    "(4.10, 4.11)": "clip(F_j_k_1, gamma - r_j, gamma + r_j)",
    "[DOB 1]": "tau_d - d",
    "[DOB 2]": "(N + 1) * q_i * e_k_1_i",
    "[DOB 3]": "tau_act - u",
    # Rates: docs/velocity.md.
    "[obs 1]": "v + h * a + beta * e",
    "[obs 2]": "v + a * h / 2",
    "[obs 3]": "1.5 * q**2 * (1 + p) / h",
    "[ahead]": "theta_s_k_1 + h * omega_m",
    "[near]": "clip(theta_a + kappa * (theta_k - theta_a), theta_k - q_c, theta_k + q_c)",
    "[obs 4]": "2 * pi * f * h",
    "[obs 5]": "h * W**2 * (1 + p) * (1 + 5 * p + 10 * p**2) / (4 * (1 - p)**3)",
    "[obs 6]": "h / 2 + h * W**2 * (1 + p)**3 / (1 - p)**3",
    "[obs 7]": "1 + W**2 * (2 + 5 * p + 11 * p**2) / (6 * (1 - p)**2)",
    "[obs 8]": "((1 - p)**3 * (13 + 50 * p + 49 * p**2) / (2 * (1 + p)**5))**0.5 / h",
    "[obs 9]": "(14 * (1 - p)**3 / (1 + p)**3)**0.5 / h",
    # Butterworth of fourth order, and the continued fraction of the tangent.
    "[rate 1]": "1 / (1 + k_1 * s / omega_c + (s / omega_c)**2)"
    " / (1 + k_2 * s / omega_c + (s / omega_c)**2)",
    "[rate 2]": "2 * cos(pi / 8)",
    "[rate 3]": "2 * cos(3 * pi / 8)",
    "[rate 4]": "(theta_k - theta_k_1) / h",
    "[rate 5]": "x / (1 - x**2 / (3 - x**2 / 5))",
    # Encoders: docs/encoder.md.
    "[wrap]": "d + F if d < -F / 2 else d - F if d > F / 2 else d",
    "[reach]": "(1 + k) * d_max",
    "[angle] encoder": "sigma * (2 * pi * (n + c / F)) - theta_0",
    "[angle] corrected": "sigma * (2 * pi * (n + c / F) + e_c) - theta_0",
    "[table]": "e_0 + r_i * clip(x, 0, N)",
    "[angle] gear": "2 * pi * n * w_k / F / i",
    "(5.4)": "theta_m - theta_l",
    # Plant, chapter 5; (5.2) and (5.6) as corrected.
    "(5.1) plant": "(u_c - u_a) / tau_c",
    "(5.2) plant": "n * u_a - f_v * omega_g - f_c * tanh(omega_g / w) - tau_cable + J * d_4",
    "(5.2) rigid": "n * u_a - f_v * omega_g - f_c * tanh(omega_g / w) - tau_e + J * d_4",
    "(5.3) plant": "tau_e + tau_h",
    "(5.1) rigid": "(u_c - u_a) / tau_c",
    "(5.3) rigid": "tau_e + tau_h",
    # Observers.
    "(5.1)": "u_c - u_a",
    "(5.2)": "(n * u_a - f_v * omega_m - f_c * tanh(omega_m / w_c) - tau_e) / J",
    "(5.5)": "d_4_k_1 + (1 - 1 / exp(L * h)) * ((omega_m_k - omega_m_k_1) / h - a_model - d_4_k_1)",
    "(5.10)": "tau_h_k_1 + (1 - 1 / exp(L * h))"
    " * (J_h * (omega_l_k - omega_l_k_1) / h - tau_e - tau_h_k_1)",
    "(5.3)": "tau_e + tau_h",
    "[eso 1]": "theta_enc - theta_l",
    "[eso 2]": "theta_l + l_1 * nu",
    "[eso 3]": "omega_l + l_2 * nu",
    "[eso 4]": "tau_h + l_3 * nu",
    "[eso 5]": "rho + l_4 * nu",
    "[eso 6]": "theta_l + h * omega_l + h**2 / 2 * (tau_e + tau_h) / J_h",
    "[eso 7]": "omega_l + h * (tau_e + tau_h) / J_h",
    "[eso 8]": "tau_h + T_d * (1 - 1 / exp(h / T_d)) * rho",
    "[eso 9]": "rho / exp(h / T_d)",
    "[parabola]": "c_0 + t * (c_1 + t * c_2)",
    "[cable 1]": "theta_g - theta_m - tau_e / k_c",
    "[cable 2]": "z_high if tau_e > tau_0 else z_low if tau_e < -tau_0 else clip(z, z_low, z_high)",
    "[cable 3]": "(1 - 1 / exp(L * h)) * (z - z_e)",
    "[cable 4]": "tau_e / k_c + z_e - (z_low + z_high) / 2",
    # Laws: docs/control.md, docs/stability.md, docs/predictive.md.
    "(5.24), sign of a stiffness": "tau_d + K_p * (theta_d - theta_l) + K_d * (omega_d - omega_l)",
    "[blend] reference": "tau_law + o_k_1 / exp(h / T_b)",
    "[blend] ahead": "tau_d + o / exp(t / T_b)",
    "[lead 1]": "tau_set + g * quad(lambda x: (r + a * x) * exp(-x / T_f), 0, T_l)",
    "[smooth]": "x / (1 + T_s * s / 3)**3",
    "[set 1]": "1 - p**3",
    "[set 2]": "1.5 * q**2 * (1 + p) / h",
    "[set 3]": "q**3 / h**2",
    "[set 4]": "delta_p + alpha * e",
    "[set 1] differences": "(delta_k - delta_k_1) / h",
    "[set 2] differences": "((delta_k - delta_k_1) - (delta_k_1 - delta_k_2)) / h / h",
    "(5.12)": "e_ + 2 * lambda_ * e + lambda_**2 * I",
    "[a_w]": "theta_d__ + 2 * lambda_ * e_ + lambda_**2 * e",
    "[tau_unc]": "k_1_unc * abs(delta) + k_3_unc * abs(delta)**3",
    "(5.16, 5.17)": "(J * (theta_d__ + 2 * lambda_ * e_ + lambda_**2 * e - d_4)"
    " + tau_e + f_v * omega_m + f_c * tanh(omega_m / w_c)) / n",
    "(5.20)": "(J_unc * (abs(a_w) + abs(d_4)) + tau_e_unc + f_v_unc * abs(omega_m)"
    " + f_c_unc * abs(tanh(omega_m / w_c)) + J_max * eta) / n",
    "(5.22)": "u_eq + k_smc * clip(s / phi, -1, 1)",
    "[lead]": "u_a + kappa * (u - u_a)",
    "[soft 1]": "max(sigma_1 * clip((q_2 - q_seen**2) / (q_full**2 - q_seen**2), 0, 1),"
    " sigma_k_1 / exp(h / T_s))",
    "[soft 2]": "0.5 * lambda_0 + 0.5 * lambda_0 * (1 - sigma_k_1)",
    "[soft 3]": "kappa_0 + 0.6 * sigma_k_1 * kappa_0",
    "[law]": "v_k + o_k",
    "[law 1]": "u_k_1 - v_k",
    "[law 2]": "o_k_1 / exp(T / tau)",
    "[trend 1]": "q_0 / (1 + nu / nu_h)",
    "[trend 2]": "p**3 * epsilon",
    "[trend 3]": "r + h * a + 1.5 * q**2 * (1 + p) / h * epsilon",
    "[trend 4]": "a + q**3 / h**2 * epsilon",
    "[trend 5]": "tau_d"
    " + quad(lambda x: (r + a * x) * exp(-x / T_f), 0, t) / (1 + (nu / (10 * nu_h))**2)",
    "(5.1) predictive": "(u_c - u_a) / tau_c",
    "(5.2) predictive": "(n * u_a - f_v * omega_m - f_c * tanh(omega_m / omega_w) - tau_e) / J"
    " + d_4",
    "(5.3) predictive": "(tau_e + tau_h) / J_h",
    "(5.24)": "tau_e - tau_d + K_p * (theta_l - theta_d) + K_d * (omega_l - omega_d)",
    "[error]": "tau_e - tau_d",
    "[cost]": "Q * e**2 + R * ((u_c - u_a) / tau_c)**2",
    # Passivity: energy that was given, and what a command may still add to it.
    "[pas 1]": "tau_e - tau_w - K_d * omega_l",
    "[pas 2]": "-P / N",
    "[pas 3]": "(gamma * (P + b_0 * N) + (b_1 - b) * n_0 / T_r) / (N + n_0)",
    "[pas 4]": "max(0, E + tau_e * Delta_theta_m - max(0, tau_w * Delta_theta_m))",
    "[pas 5]": "E + J * omega_m**2 / 2 + n * Omega * (T * v + h * kappa * m)",
    "[pas 6]": "(E_m - E - J * omega_m**2 / 2 - n * Omega * T * v)"
    " / (n * Omega * h * (1 + epsilon + kappa))",
    # Limits and comparison: docs/limits.md.
    "[lim 1]": "clip(U * min((b - theta_l) / m, (0.9 * W - omega) / (0.1 * W)), 0, U)",
    "[lim 2]": "clip(U * min((theta_l - a) / m, (0.9 * W + omega) / (0.1 * W)), 0, U)",
    "[lim 3]": "h * max(0, tau * omega_l)",
    "[red 1]": "theta_g - theta_m - tau_e / k_c - theta_0",
    "[red 2]": "theta_a + abs(tau_e) * (1 / k_min - 1 / k_c)",
    "[red 3]": "J * d_g",
    "[red 4]": "tau_a + c_tau * abs(tau_e) + c_J * J_a_g",
    "[adapt 1]": "tau_M + J_M * alpha + d_M * omega_l",
    "[adapt 2]": "x - clip(F, x - r, x + r)",
    "[adapt 3]": "tau_e - a * x - c * E - o",
    "[adapt 4]": "a + L * h * e * x / 2",
    "[adapt 5]": "c + L * h * e * E",
    "[adapt 6]": "o + L * h * e / 2",
    "[adapt 7]": "a * tau_d + c * E + o",
    # Impairment, chapter 7, with the sign of its damping put right.
    "(7.1)": "max(0, K_p * (theta - theta_w) + K_d * omega) if theta > theta_w else 0",
    "(7.2)": "clip(-K_v * omega - W, -tau_max, tau_max)",
    # Family: docs/identify.md.
    "[family]": "N * w_i * d_i * z_i",
    "[rise]": "x * a / (a + abs(x))",
    "[maxwell]": "F_k_1 + a * (q - F_k_1) + b * (q_k_1 - F_k_1)",
    "[stop]": "clip(F_k_1, q - r, q + r)",
    "[slip]": "1 - z / L if q > q_k_1 else 1 + z / L if q < q_k_1 else 1",
    "[strain]": "a / (a + m)",
    "[path]": "1 / exp(s / L)",
}

KNOWN = {
    "abs": abs,
    "clip": lambda x, low, high: max(low, min(x, high)),
    "cos": math.cos,
    "exp": math.exp,
    "max": max,
    "min": min,
    "pi": math.pi,
    "quad": lambda of, low, high: quad(of, low, high)[0],
    "tanh": math.tanh,
}
FITTED = FittedMember(Member("few", "few", (Term("spring", Rise("power", 1), ()),)), 0.2, (1.0,))


@cache
def device(name: str) -> Device:
    return load_device(name)


def drive() -> Device:
    return device("elbow_drive")


def corrected() -> Device:
    row = (
        "[encoder.motor]\n"
        'correction_rad = { values = [0.01, 0, 0, 0], status = "identified", source = "a test" }\n'
        'correction_orientation_rad = { value = 0, status = "assumed", source = "a test" }\n'
    )
    text = 'schema = 1\nextends = "elbow_drive"\nname = "bench"\ntitle = "bench"\n'
    return parse_device(text + row, "bench.toml")


def shipped(name: str, instance: str) -> tuple[Equation, ...]:
    return tuple(device(name).system.blocks[instance].equations)


# Whose equations, and in which form the table has those that several show.
SHOWN = {
    "sensor": (lambda: torque_sensor(device("elbow")).equations, ""),
    "sensor with a dead zone": (lambda: torque_sensor(device("knee")).equations, " dead"),
    "exact inverse": (lambda: exact_inverse(drive()).equations, ""),
    "segment": (segment_equations, ""),
    "published inverse": (lambda: published_inverse(drive()).equations, ""),
    "with its observer": (lambda: published_inverse(drive(), "a").equations, ""),
    "rate of the deflection": (lambda: tracking_observer(drive()).equations, ""),
    "smoothed deflection": (lambda: smoothed_deflection(device("elbow")).equations, ""),
    "its numbers": (lambda: velocity_properties(drive()).equations, ""),
    "rate of a side": (lambda: motor_rate(drive()).equations, ""),
    "encoder": (lambda: encoder(drive(), "motor").equations, " encoder"),
    "corrected encoder": (lambda: encoder(corrected(), "motor").equations, " corrected"),
    "motor's encoder": (lambda: gear_encoder(drive()).equations, " gear"),
    "joint": (lambda: deflection(drive()).equations, ""),
    "plant": (lambda: plant_block(drive()).equations, " plant"),
    "plant without a cable": (lambda: plant_block(drive(), cable=False).equations, " rigid"),
    "drive's disturbance": (lambda: drive_observer(drive()).equations, ""),
    "person by a lag": (lambda: lag_observer(drive()).equations, ""),
    "person": (lambda: extended_state(drive()).equations, ""),
    "person's past": (lambda: parabola(drive()).equations, ""),
    "cable": (lambda: cable_observer(device("elbow_mpc")).equations, ""),
    "set torque": (lambda: reference(drive()).equations, " reference"),
    "set torque ahead": (lambda: shipped("elbow_mpc", "ahead"), " ahead"),
    "governor": (lambda: torque_lead(drive()).equations, ""),
    "smoothed": (lambda: smoothed_setpoint(drive()).equations, ""),
    "set-point": (lambda: setpoint_rates(drive()).equations, ""),
    "plain differences": (
        lambda: setpoint_rates(drive(), "differences").equations,
        " differences",
    ),
    "sliding mode": (lambda: sliding_mode(drive()).equations, ""),
    "surface": (surface_equations, ""),
    "law in force": (lambda: law_switch(drive(), ["a", "b"]).equations, ""),
    "trend": (lambda: trend(drive()).equations, ""),
    "prediction": (lambda: shipped("elbow_mpc", "predictive"), " predictive"),
    "passivity": (lambda: passivity(drive()).equations, ""),
    "limits": (lambda: limits(drive()).equations, ""),
    "adaptation": (lambda: adaptation(drive()).equations, ""),
    "impairment": (lambda: impairment(impaired_device()).equations, ""),
    "comparison": (lambda: redundancy(drive()).equations, ""),
    "family": (lambda: family_sensor(device("elbow"), FITTED).equations, ""),
}


# Widths, lengths and limits.
POSITIVE = {"q_c", "F", "U", "W", "m", "n", "N", "theta_dz"}


def identifier(name: str) -> str:
    return re.sub(r"\W", "_", name) + "_" * (name == "lambda")


def draws(symbols: set[str]) -> Iterator[dict[str, float]]:
    """Values of both signs; what counts elements, or is a number of something, is 3."""
    rng = Random(7)
    for k in range(60):
        signs = [1] if k < 20 else [-1, 1]
        yield {
            s: 3
            if s in ("n", "N")
            else (1 if s in POSITIVE else rng.choice(signs)) * rng.uniform(0.2, 0.95)
            for s in sorted(symbols)
        }


def typed(number: str, form: str) -> str:
    return TYPED.get(number + form) or TYPED[number]


@pytest.mark.parametrize("whose", SHOWN)
def test_what_is_shown_is_what_is_typed_again(whose):
    make, form = SHOWN[whose]
    for e in make():
        code = compile(typed(e.number, form), e.number, "eval")
        compared = set()
        for x in draws(names(e)):
            spaces = {"__builtins__": {}, **KNOWN, **{identifier(k): v for k, v in x.items()}}
            try:
                expected = float(eval(code, spaces))
                shown = value(e, x)
            except (TypeError, ValueError):  # a root of what is below 0
                continue
            assert shown == pytest.approx(expected, rel=1e-9, abs=1e-12), (e.number, x)
            compared.add(expected)
        assert len(compared) > 10 or not names(e), e.number


def test_every_shipped_equation_is_in_the_table():
    every = {
        (b.name, e.number): e
        for name in ("elbow", "elbow_drive", "elbow_mpc", "knee", "knee_printed", "wrist")
        for b in device(name).system.blocks.values()
        for e in b.equations
    }
    tried = {e.mathml for make, _ in SHOWN.values() for e in make()}
    assert {k for k, e in every.items() if e.mathml not in tried} == set()
    assert len(every) > 80
    numbers = {e.number for make, _ in SHOWN.values() for e in make()}
    known = {re.split(r" [a-z]+$", k)[0] for k in TYPED} | set(TYPED)
    assert numbers <= known
