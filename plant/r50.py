"""Yamaha R-50: constants of the helicopter model, with the standing of each.

[R] recalled from B. Mettler, M. Tischler, T. Kanade, CMU-RI-TR-00-03, not re-opened; [E] engineering
estimate; [D] derived from these; [S] stated by Singh and Lapp. Inertias, stiffness and drag areas are
estimates: this is an R-50-like helicopter, not an identified one.
"""

import math
from typing import Literal, NamedTuple

Preset = Literal["r50", "r50_no_bar", "r50_no_tail", "r50_bare"]
Bounds = Literal["paper", "realistic"]
CommandForm = Literal["actuator", "attitude"]


class Constants(NamedTuple):
    """Every number of the dynamics; SI units, radians, G = multiples of the nominal weight."""

    g: float = 9.80665
    rho: float = 1.225  # kg/m3, ISA sea level
    mass: float = 68.0  # kg, fully instrumented [R]
    weight: float = 68.0 * 9.80665  # N, what 1 G of command is worth; nominal, whatever the mass
    radius: float = 1.535  # m [R]
    chord: float = 0.108  # m [E]
    blades: float = 2.0
    Omega: float = 89.0  # rad/s, 850 rpm [R]
    a0: float = 5.5  # 1/rad, lift slope [E]
    c_d0: float = 0.012  # [E]
    kappa: float = 1.15  # induced power factor [E]
    tau_f: float = 0.046  # s, flapping [R]
    tau_s: float = 0.342  # s, stabiliser bar [R]
    A_c: float = 0.644  # bar to longitudinal flap [R]
    B_d: float = 0.71  # bar to lateral flap [R]
    A_b: float = -0.189  # cross-coupling [R]
    B_a: float = 0.368  # cross-coupling [R]
    k_a: float = 0.375  # share of the direct path [D]
    k_b: float = 0.42  # share of the direct path [D]
    bar: float = 1.0  # 1 with stabiliser bar, 0 without
    Ixx: float = 4.6  # kg m2 [E]
    Iyy: float = 9.3
    Izz: float = 9.0
    Ixz: float = 0.3
    h: float = 0.57  # m, hub above the centre of gravity [E]
    x_h: float = 0.0  # m, hub forward of the centre of gravity
    K_b: float = 385.0  # N m/rad, hub stiffness [D]
    tau_T: float = 0.10  # s, thrust lag [E]
    K_mu: float = 0.2  # flap-back factor; 1 is a bare rotor [R]
    l_t: float = 1.87  # m, tail rotor behind the centre of gravity [E]
    h_t: float = 0.10  # m, above it [E]
    T_v: float = 1.9  # N s/m, tail-rotor damping [D]
    K_gyro: float = 0.0  # G s/rad, yaw gyro
    TQFF: float = 0.0  # torque feed-forward, 0 or 1
    S_x: float = 0.30  # m2, fuselage drag areas [E]
    S_y: float = 0.90
    S_z: float = 0.60
    S_v: float = 0.12  # m2, vertical fin [E]
    C_Lv: float = 3.0  # 1/rad
    l_v: float = 1.85  # m
    h_v: float = 0.05  # m
    S_h: float = 0.03  # m2, horizontal tail [E]
    C_Lh: float = 3.0  # 1/rad
    l_h: float = 1.3  # m
    CT_sigma_max: float = 9.9  # blade loading limit, off for the paper's thrust range
    ROT: float = -1.0  # rotor turns clockwise seen from above [E]
    # bounds of the four actuators [S]
    thrust_min: float = 0.0
    thrust_max: float = 3.5
    tilt_max: float = math.radians(20.0)
    tail_max: float = 0.5
    # attitude stabiliser: actuator = direct c + trim + K (c - angle) - K_rate rate
    direct: float = 1.0  # 1 actuator form, 0 attitude form
    a_trim: float = 0.0
    b_trim: float = 0.0
    tail_trim: float = 0.0
    K_theta: float = 0.0
    K_phi: float = 0.0
    K_psi: float = 0.0  # G/rad
    K_q: float = 0.0  # s
    K_p: float = 0.0  # s
    K_r: float = 0.0  # G s/rad


STABILISER_GAINS = {
    "direct": 0.0, "K_theta": 0.4, "K_phi": 0.4, "K_psi": 0.12, "K_q": 0.05, "K_p": 0.05, "K_r": 0.06,
}  # fmt: skip
_VARIANTS: dict[str, dict[str, float]] = {
    "r50": {},
    "r50_no_bar": {"bar": 0.0, "k_a": 1.0, "k_b": 1.0},
    "r50_no_tail": {"S_h": 0.0},
    "r50_bare": {"bar": 0.0, "k_a": 1.0, "k_b": 1.0, "S_h": 0.0, "K_mu": 1.0},
}
_BOUNDS: dict[str, dict[str, float]] = {
    "paper": {},
    "realistic": {
        "thrust_min": 0.2, "thrust_max": 1.6, "tilt_max": math.radians(10.0), "CT_sigma_max": 0.16,
    },
}  # fmt: skip


def constants(preset: Preset = "r50", bounds: Bounds = "paper") -> Constants:
    """Return the constants of a preset, in actuator form.

    Notes
    -----
    3.5 G is beyond the blade loading and five times the power of the real helicopter: ``paper`` bounds
    are the paper's, ``realistic`` ones are 0.2 to 1.6 G, 10 degrees and a blade-loading limit of 0.16.
    """
    return Constants()._replace(**_VARIANTS[preset], **_BOUNDS[bounds])
