"""Sections and keys of a device file, with their bounds."""

# Long: the whole device file in one place.

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BaseModel, Field

from esea_gen.devices.numbers import Quantity, Section, Series, number, optional, series, table
from esea_gen.devices.rubber import Elastomer, Family
from esea_gen.portability import check_file_name

SCHEMA = 1
SCHEMA_FILE = "esea-gen.schema.json"
NAME_PATTERN = r"^[a-z][a-z0-9_]{0,14}$"
AXIS_PATTERN = r"^[a-z]{1,12}$"  # letters only: a digit or underscore could read as part of a unit
MOST_AXES = 6  # their torques, rates and status words fit one telemetry frame
TABLE_SIZES = (4, 8, 16, 32, 64)  # of an encoder's correction: a turn's counts divide evenly


# A shipped law, or one of a Python file in the device file's folder.
LAW_PATTERN = r"^([a-z][a-z0-9_]{0,14}|[^:\x00-\x1f]+\.py:[A-Za-z_][A-Za-z0-9_]*)$"
MOST_LAWS = 8
# Sections that laws take their numbers from, with what else of the file they need.
LAW_SECTIONS = {"sliding_mode": ("inverse",), "predictive": ()}


class Domain(Section):
    """Where the parameters were identified; outside it the firmware sets a flag and continues."""

    theta_max_rad: Quantity = number(1e-3, 3.2, "Largest identified |deflection|.")
    omega_max_rad_s: Quantity = number(1e-3, 100, "Largest identified |deflection rate|.")
    tau_full_scale_Nm: Quantity = number(1e-3, 1000, "Full scale for errors in % of full scale.")


class Limits(Section):
    """Physical ranges of the ports; a value outside is an invalid input."""

    theta_rad: Quantity = number(1e-3, 3.2, "Largest plausible |deflection|.")
    omega_rad_s: Quantity = number(1e-2, 1000, "Largest plausible |deflection rate|.")
    tau_Nm: Quantity = number(1e-2, 2000, "Largest plausible |torque|.")


class Timing(Section):
    """Task rates."""

    sense_rate_Hz: Quantity = number(50, 10000, "Rate of the sensing task.")
    control_rate_Hz: Quantity | None = optional(
        10, 10000, "Rate of the control task; it divides the sensing task's."
    )
    control_release_s: Quantity | None = optional(
        1e-4,
        0.1,
        "From the start of the control task to the release of its command; leave it out for a "
        "whole period.",
    )


class Velocity(Section):
    """Velocity estimate for every Block that needs a rate."""

    bandwidth_Hz: Quantity = number(2, 100, "Bandwidth of the tracking observer's triple pole.")


class EncoderSide(Section):
    """One encoder: its mounting, its zero, and its identified errors."""

    direction: Quantity | None = optional(
        -1,
        1,
        "1 where the count rises with the joint angle, -1 where it falls; 1 when left out.",
        whole=True,
    )
    zero_rad: Quantity | None = optional(
        -math.pi,
        math.pi,
        "Corrected angle of the encoder, times direction, with the joint at 0.  Without the key "
        "the encoder cannot be used until it is zeroed.",
    )
    step_max_rad: Quantity | None = optional(
        1e-4,
        1.5,
        "Largest plausible |step| between two samples; left out, the joint's speed limit times "
        "the period, 0.5 deg for noise, and one count.",
    )
    held_max: Quantity | None = optional(
        1,
        10,
        "Bad frames in a row that are bridged with the last good angle; 3 when left out.",
        whole=True,
    )
    orientation_rad: Quantity | None = optional(
        -math.pi,
        math.pi,
        "Angle at which the encoder is mounted now, from a mark on its part; any fixed mark will "
        "do.  0 when left out.",
    )
    correction_rad: Series | None = series(
        -0.09,
        0.09,
        TABLE_SIZES,
        "Correction of the raw angle, at 4, 8, 16, 32 or 64 equal steps of the encoder's turn "
        "from count 0 on.",
    )
    correction_orientation_rad: Quantity | None = optional(
        -math.pi,
        math.pi,
        "Angle at which the encoder was mounted when the correction was characterised; needed with "
        "correction_rad, and must be orientation_rad.",
    )


class Encoder(Section):
    """Encoders on either side of the coupling."""

    resolution_bits: Quantity = number(8, 24, "Counts per turn, as a power of two.", whole=True)
    motor: EncoderSide | None = table("The one on the motor's side.")
    load: EncoderSide | None = table("The one on the load's side.")

    def unzeroed(self) -> Encoder:
        """The same encoders on another machine, where nobody has zeroed them yet."""
        sides = {"motor": self.motor, "load": self.load}
        return self.model_copy(
            update={n: e and e.model_copy(update={"zero_rad": None}) for n, e in sides.items()}
        )


class Inverse(Section):
    """Inverse of the elastomer model: which one turns a desired torque into a deflection."""

    kind: Literal["exact", "published"] = Field(
        description="exact: solves the discrete sensor itself; published: play operators of "
        "chapter 4 with the disturbance observer that 'filter' names."
    )
    filter: Literal["none", "a", "a_normalised", "b", "b_normalised", "b_rounding"] = Field(
        default="none",
        description="Filter of the published inverse's disturbance observer; 'none' omits it.",
    )
    kappa_rad: Quantity | None = optional(0, 5, "Weight kappa of the play operators, eq. 4.9.")
    phi_1_rad: Quantity | None = optional(0, 5, "Decay phi of the play operators' weight, eq. 4.9.")
    chi_rad: Quantity | None = optional(1e-6, 1, "Spacing chi of the play operators, eq. 4.11.")


class Actuator(Section):
    """Motor and cable drive, equations 5.1 and 5.2; torques at the motor shaft times the ratio."""

    gear_ratio: Quantity = number(1, 1000, "Gear ratio n from motor shaft to joint, eq. 5.2.")
    J_kgm2: Quantity = number(1e-4, 100, "Inertia J of motor and drive at the joint, eq. 5.2.")
    fv_Nms_rad: Quantity = number(0, 100, "Viscous friction fv at the joint, eq. 5.2.")
    fc_Nm: Quantity = number(0, 100, "Coulomb friction fc at the joint, eq. 5.2.")
    coulomb_width_rad_s: Quantity = number(
        1e-3, 10, "Width of the smoothed Coulomb friction, tanh(omega/width)."
    )
    tau_c_s: Quantity = number(1e-4, 1, "Lag tau_c of the motor's torque, eq. 5.1.")
    u_max_Nm: Quantity = number(1e-3, 100, "Largest |motor torque| at the motor shaft.")
    omega_max_rad_s: Quantity = number(1e-2, 1000, "Largest plausible |motor side's speed|.")
    encoder_bits: Quantity = number(
        8, 32, "Counts per turn of the motor shaft, as a power of two.", whole=True
    )
    rotor_kgm2: Quantity | None = optional(
        1e-9, 1, "Rotor's inertia from its data sheet; checks J_kgm2, and nothing computes with it."
    )
    # What a recording of the drive tells beside these; no controller computes with it.
    stribeck_Nm: Quantity | None = optional(
        0, 100, "Rise of the Coulomb friction towards rest, at the joint."
    )
    stribeck_rad_s: Quantity | None = optional(
        1e-6, 100, "Speed of the joint over which that rise fades."
    )
    backlash_rad: Quantity | None = optional(
        0, 0.5, "Whole backlash between motor and motor side, at the joint."
    )
    cogging_Nm: Quantity | None = optional(
        0, 100, "Effective torque of gear and cogging over the angle, at the joint."
    )


class Joint(Section):
    """The joint and its load side."""

    Jh_kgm2: Quantity = number(1e-4, 100, "Inertia Jh of load side and limb, eq. 5.3.")
    theta_min_rad: Quantity = number(-6.4, 6.4, "Smallest angle of the joint's range of motion.")
    theta_max_rad: Quantity = number(-6.4, 6.4, "Largest angle of the joint's range of motion.")
    omega_max_rad_s: Quantity = number(1e-2, 1000, "Largest plausible |joint speed|.")
    tau_human_max_Nm: Quantity = number(1e-2, 1000, "Largest plausible |human torque|.")
    motor_velocity_Hz: Quantity = number(
        2, 400, "Cut-off of the motor side's velocity filter (Butterworth, 4th order)."
    )
    load_velocity_Hz: Quantity = number(
        2, 400, "Cut-off of the load side's velocity filter (Butterworth, 4th order)."
    )


class Disturbance(Section):
    """Disturbance observers, equations 5.5 and 5.10, and the extended-state human-torque one."""

    drive_1_s: Quantity = number(0, 200, "Bandwidth L of the drive's disturbance observer, 5.5.")
    human_1_s: Quantity = number(0, 50, "Bandwidth L of the human-torque observer, eq. 5.10.")
    decay_s: Quantity = number(0.01, 10, "Decay time of the human torque's rate.")
    gain_theta: Quantity = number(0, 1, "Innovation gain on the load angle.")
    gain_omega_1_s: Quantity = number(0, 1000, "Innovation gain on the load speed.")
    gain_tau_Nm_rad: Quantity = number(0, 1e5, "Innovation gain on the human torque.")
    gain_rate_Nm_s_rad: Quantity = number(0, 1e6, "Innovation gain on the human torque's rate.")


class SlidingMode(Section):
    """Sliding mode torque control, equations 5.12 to 5.22."""

    lambda_1_s: Quantity = number(
        1,
        25,
        "Slope lambda of the sliding surface, eq. 5.12; beyond, the motor's lag makes the loop "
        "swing, or it does not follow.",
    )
    phi_rad_s: Quantity = number(1e-3, 100, "Width phi of the boundary layer, 5.22.")
    fv_share: Quantity = number(0, 1, "Uncertain share of the viscous friction, eq. 5.20.")
    fc_share: Quantity = number(0, 1, "Uncertain share of the Coulomb friction, eq. 5.20.")
    J_unc_kgm2: Quantity = number(0, 10, "Uncertain inertia, eq. 5.20.")
    k1_unc_Nm_rad: Quantity = number(0, 1000, "Uncertain torque per deflection, eq. 5.20.")
    k3_unc_Nm_rad3: Quantity = number(0, 2500, "Uncertain torque per deflection cubed, 5.20.")
    eta_rad_s2: Quantity = number(0, 100, "Reaching rate eta, eq. 5.20.")
    setpoint_filter_Hz: Quantity | None = optional(
        2,
        400,
        "Cut-off of the Butterworth filter (4th order) before the set-point's differentiation; "
        "leave it out for an observer without delay.",
    )
    setpoint_acceleration: Literal["zero", "model"] = Field(
        description="Acceleration of the set-point: zero as published, or from the model."
    )
    load_share: Quantity | None = optional(
        0, 1, "Share of the load's estimated acceleration in it; without: 1, as published 0."
    )


class Predictive(Section):
    """Model predictive control in place of sliding mode; its horizon, weights and estimates."""

    intervals: Quantity = number(2, 100, "Intervals of the horizon.", whole=True)
    interval_s: Quantity = number(1e-3, 10, "Length of an interval.")
    substeps: Quantity = number(1, 50, "Integration steps in an interval.", whole=True)
    long_intervals: Quantity | None = optional(
        0, 99, "So many of the intervals, the last, are twice as long.", whole=True
    )
    Q: Quantity = number(0.01, 1e5, "Weight of the torque error, (Nm)^-2.")
    R: Quantity = number(1e-4, 1e4, "Weight of the motor torque's rate, (Nm/s)^-2.")
    future: Literal["given", "extrapolated", "held"] = Field(
        default="extrapolated",
        description="given: the desired values at the end of every interval are inputs; "
        "extrapolated: the desired torque follows its trend; held: it stays as it is now.",
    )
    impedance: Literal["one_layer", "cascade"] = Field(
        default="one_layer",
        description="one_layer: the cost contains the law; cascade: the law sets a torque.",
    )
    person: Literal["extended_state", "parabola"] = Field(
        default="extended_state",
        description="Prediction of the person's torque: extended-state observer, or as published: "
        "observer (5.10), a parabola through its past, rates from filtered differences.",
    )
    drive: Literal["auto", "rigid", "cable"] = Field(
        default="auto",
        description="rigid: gear and motor side are one inertia, as in (5.2); cable: with elastic "
        "cable and backlash between them, by the motor's own encoder; auto: cable where the "
        "file has [cable] and person is extended_state.",
    )


class Impedance(Section):
    """Impedance control: a PD law on the joint gives the desired torque."""

    Kp_Nm_rad: Quantity = number(0, 20, "Stiffness Kp.")
    Kd_Nms_rad: Quantity = number(0, 5, "Damping Kd.")


class Safety(Section):
    """Maxima of the limits Block; compiled in, no message can widen them."""

    u_max_Nm: Quantity = number(1e-3, 100, "Largest |motor command|, at the motor shaft.")
    u_rate_Nm_s: Quantity = number(1e-2, 1e4, "Fastest change of the motor command.")
    tau_max_Nm: Quantity = number(1e-2, 1000, "Interaction torque that trips.")
    theta_max_rad: Quantity = number(1e-3, 3.2, "Deflection that trips.")
    rom_min_rad: Quantity = number(-6.4, 6.4, "Joint angle below which nothing pushes further.")
    rom_max_rad: Quantity = number(-6.4, 6.4, "Joint angle above which nothing pushes further.")
    rom_margin_rad: Quantity = number(
        1e-3, 3.2, "How far beyond the range of motion the joint may be before it trips."
    )
    omega_max_rad_s: Quantity = number(1e-2, 100, "Joint or drive speed that trips.")
    energy_J: Quantity = number(1e-3, 1e4, "Energy given to the limb in the window that trips.")
    energy_window_s: Quantity = number(1e-2, 60, "Window of the energy limit.")


class Redundancy(Section):
    """How far the motor's encoder, the joint's encoders and the motor's torque may disagree."""

    cable_Nm_rad: Quantity = number(1, 1e5, "Usual stiffness of the cable, at the joint.")
    cable_least_Nm_rad: Quantity = number(1, 1e5, "Stiffness of the softest cable.")
    apart_rad: Quantity = number(
        1e-3, 1, "Angle between drive and motor side that backlash and encoder errors explain."
    )
    torque_Nm: Quantity = number(
        1e-2, 100, "Torque at the drive that friction and the gear's disturbance explain."
    )
    torque_share: Quantity = number(
        0, 1, "Share of the interaction torque that the elastomer's model may be wrong by."
    )
    inertia_share: Quantity = number(
        0, 1, "Share of the drive's recent inertial torque, for a wrong inertia and lag."
    )
    rate_1_s: Quantity = number(1, 200, "Bandwidth of the observer of the unexplained torque.")


class Monitor(Section):
    """Monitor of encoders and loop; the limits latch on behaviour that a sound one never shows."""

    noise_rad: Quantity = number(0, 0.1, "Noise of a sound joint encoder, effective value.")
    window_s: Quantity = number(1e-2, 10, "Time over which an angle's roughness is averaged.")
    swings_1_s: Quantity = number(
        1, 1000, "Swings of the command from limit to limit in a second that are too many."
    )


class MotorThermal(Section):
    """Winding and case of the motor as two thermal nodes, by its data sheet."""

    k_t_Nm_A: Quantity = number(1e-4, 100, "Torque constant at the motor's shaft.")
    resistance_Ohm: Quantity = number(1e-4, 1e3, "Terminal resistance at 25 degC.")
    winding_case_K_W: Quantity = number(0.2, 100, "Thermal resistance from winding to case.")
    case_ambient_K_W: Quantity = number(0.1, 100, "Thermal resistance from case to ambient.")
    winding_s: Quantity = number(1, 1e4, "Thermal time constant of the winding.")
    case_s: Quantity = number(100, 1e5, "Thermal time constant of the motor.")
    ambient_C: Quantity = number(-20, 80, "Hottest surroundings.")
    derate_C: Quantity = number(30, 200, "Winding temperature above which the torque limit falls.")
    max_C: Quantity = number(40, 220, "Largest winding temperature; above it the limits latch.")
    start_C: Quantity | None = optional(
        -20, 220, "Both nodes at a start; without the key the most that they may have reached."
    )


class PassiveInteraction(Section):
    """Passivity of every law: limits the energy given to a hand beyond the desired interaction."""

    damping_Nms_rad: Quantity = number(1e-3, 5, "Largest damping added; Kd counts as a part of it.")
    fade_Hz: Quantity | None = optional(
        0.1, 100, "Above this frequency of the motion it fades to 30 %; without the key nowhere."
    )
    least_Nms_rad: Quantity = number(0, 1, "Damping that a hand feels at least.")
    window_s: Quantity = number(1e-2, 10, "Time over which power and speed are averaged.")
    energy_J: Quantity = number(0.1, 1e3, "Energy that drive and command may contain.")
    Kp_max_Nm_rad: Quantity = number(0, 20, "Largest stiffness that is passive; compiled in.")
    Kd_max_Nms_rad: Quantity = number(1e-3, 5, "Largest damping that is passive; compiled in.")


class SimulatedImpairment(Section):
    """Wall with damping and resistance to speed that impair a healthy wrist, chapter 7."""

    wall_rad: Quantity = number(-3.14, 3.14, "Where the wall begins, from the neutral position.")
    Kp_Nm_rad: Quantity = number(0, 200, "Stiffness of the wall where it begins.")
    Kp3_Nm_rad3: Quantity | None = optional(
        0, 2000, "Torque over the cube of the depth, beside Kp; without the key 0."
    )
    Kd_Nms_rad: Quantity = number(0, 20, "Damping in the wall.")
    Kv_Nms_rad: Quantity = number(0, 5, "Resistance to speed everywhere.")
    bandwidth_Hz: Quantity = number(2, 100, "Bandwidth of the estimate of the joint's rate.")
    resistance_Nms_rad: Quantity | None = optional(
        0, 5, "Resistance to speed on axes without a wall; without the key Kv_Nms_rad."
    )
    wall: Literal["given", "published"] = Field(
        "given",
        description="given: gains as above; published: those of thesis section 7.2.4 in their "
        "place, which swing on the virtual drive.",
    )
    wall_axes: tuple[Annotated[str, Field(pattern=AXIS_PATTERN)], ...] = Field(
        default=(),
        max_length=MOST_AXES,
        description="Axes that have a wall; empty: all.  The others have resistance only.",
    )


class Cable(Section):
    """The cable between gear and motor side; its stiffness is the usual one of the redundancy."""

    backlash_rad: Quantity = number(0, 0.2, "Complete gap at the start.")
    backlash_most_rad: Quantity = number(1e-3, 0.2, "Largest gap that is learned.")
    loss: Quantity = number(0, 0.5, "Share of the |cable's torque| that its friction takes.")
    contact_Nm: Quantity = number(
        1e-3, 10, "Interaction torque above which the cable is at an end of its gap."
    )
    rate_1_s: Quantity = number(0, 200, "Rate at which the ends of the gap are learned.")
    drive_1_s: Quantity = number(
        0, 200, "Bandwidth L of the drive's disturbance observer on the motor's own encoder."
    )


class Fatigue(Section):
    """Fatigue curve of the coupling: N = cycles (range_rad / range)^exponent cycles to its end."""

    range_rad: Quantity = number(1e-3, 6.4, "Range of the deflection, peak to peak, of the test.")
    cycles: Quantity = number(1, 1e12, "Cycles of that range that end its life.")
    exponent: Quantity = number(1, 20, "Exponent of the range in the number of cycles.")
    warn_share: Quantity = number(0.01, 1, "Share of the life, by Miner's sum, that warns.")


ADAPTATION_STOP_NM = 0.8
"""Threshold of the stop operator that stands for the loss: of trials from 0.1 to 0.8 the best."""


class Adaptation(Section):
    """How far the wish may be adapted to a rubber that is not its model."""

    scale_least: Quantity = number(0.5, 0.99, "Softest rubber: true torque over the model's.")
    scale_most: Quantity = number(1.01, 2, "Stiffest rubber: true torque over the model's.")
    loss_most: Quantity = number(0.01, 1, "Largest share of the stop operator of the loss.")
    offset_Nm: Quantity = number(0.01, 10, "Largest offset.")


class DeviceFile(Section):
    """A device file, as written."""

    schema_version: Literal[1] = Field(alias="schema", description="Version of this format.")
    name: Annotated[str, AfterValidator(check_file_name)] = Field(
        pattern=NAME_PATTERN, description="Lower case C identifier, prefix of the C."
    )
    title: str = Field(min_length=1, description="One line for reports.")
    axes: tuple[Annotated[str, Field(pattern=AXIS_PATTERN)], ...] = Field(
        default=(),
        max_length=MOST_AXES,
        description="Axes of equal couplings, each with inputs and outputs of its own, such as "
        "theta_flexion_rad; leave the key out for one axis without a name.",
    )
    laws: tuple[Annotated[str, Field(pattern=LAW_PATTERN)], ...] = Field(
        default=(),
        max_length=MOST_LAWS,
        description="Control laws of a device with a drive, the first one in force after the "
        "start; predictive where the file has that section, else sliding_mode, when left out.  "
        "One of your own is written FILE.py:LAW.",
    )
    elastomer: Elastomer | None = table(
        "Torque model of the rubber coupling, equations 3.1 to 3.11; needed where "
        "there is no [family]."
    )
    family: Family | None = table(
        "Torque model of the rubber coupling: a member of the family, in place of [elastomer]."
    )
    domain: Domain
    limits: Limits
    timing: Timing
    velocity: Velocity
    encoder: Encoder
    inverse: Inverse | None = None
    actuator: Actuator | None = None
    joint: Joint | None = None
    disturbance: Disturbance | None = None
    sliding_mode: SlidingMode | None = None
    predictive: Predictive | None = None
    impedance: Impedance | None = None
    safety: Safety | None = None
    redundancy: Redundancy | None = table(
        "Comparison of all encoders and the motor's torque; without it, a joint encoder "
        "that is wrong but plausible is not detected."
    )
    monitor: Monitor | None = table(
        "Roughness and stuck bits of the joint encoders, and a motor that swings between its "
        "limits; without it, these faults are not detected."
    )
    motor_thermal: MotorThermal | None = table(
        "Winding and case of the motor, which limit its torque; without it, heating is not limited."
    )
    passivity: PassiveInteraction | None = table(
        "Damping that a law lacks, and a bound of the energy that the drive gives; "
        "without it, a law may swing a limp hand up."
    )
    impairment: SimulatedImpairment | None = table(
        "Simulated impairment of every axis: desired torque on the joint, from an encoder "
        "there; off until its parameter is set."
    )
    cable: Cable | None = table("The cable, for predictive control with the motor's own encoder.")
    fatigue: Fatigue | None = table(
        "Fatigue curve of the coupling, from tests; without it, the used share of its life "
        "is not known."
    )
    adaptation: Adaptation | None = table(
        "Adaptation of the desired torque to the rubber, by two known masses; without "
        "it, a wrong rubber is not detected."
    )


def section_at(names: Iterable[str]) -> type[BaseModel] | None:
    model: type[BaseModel] = DeviceFile
    for name in names:
        field = model.model_fields.get(name.partition("[")[0])
        kinds = [field.annotation, *get_args(field.annotation)] if field else []
        found = [k for k in kinds if isinstance(k, type) and issubclass(k, Section)]
        if not found:
            return None
        model = found[0]
    return model


def field_facts(key: str) -> dict[str, Any]:
    """Facts about a number of the file: ``low``, ``high``, ``whole``, ``text``.

    return: its bounds, whether it is a whole number, and its description.
    """
    *sections, last = key.split(".")
    model = section_at(sections)
    assert model is not None, key
    field = model.model_fields[last]
    extra: Any = field.json_schema_extra
    return {**extra, "text": field.description}
