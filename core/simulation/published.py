"""Published lateral-directional models as stability derivatives, with their sources.

Signs follow the sources: positive beta is wind from the right, p right wing down, r nose right.
Derivatives are dimensional and include inertia terms: L_p = d(p_dot)/dp [1/s].
"""

from dataclasses import dataclass
from math import radians
from typing import Literal

FOOT = 0.3048
"""[m]"""
STANDARD_GRAVITY = 9.80665
"""[m/s2]"""
GRAVITY_IN_FEET = 32.174 * FOOT
"""32.174 ft/s2 in [m/s2], as in sources that use feet; relative difference 1.5e-6."""

RESPONSES = ("Y", "L", "N")
"""Rows: side force (beta_dot), rolling moment (p_dot), yawing moment (r_dot)."""
CAUSES = ("beta", "p", "r", "da", "dr")
"""Columns: the three aerodynamic states, then aileron and rudder."""
DERIVATIVES = tuple(f"{response}_{cause}" for response in RESPONSES for cause in CAUSES)

SIGMA_FRACTION = {
    "Y_beta": 0.10, "Y_p": 0.30, "Y_r": 0.30, "Y_da": 0.30, "Y_dr": 0.15,
    "L_beta": 0.15, "L_p": 0.10, "L_r": 0.25, "L_da": 0.10, "L_dr": 0.25,
    "N_beta": 0.10, "N_p": 0.30, "N_r": 0.20, "N_da": 0.30, "N_dr": 0.10,
}  # fmt: skip
"""One sigma of each derivative as a fraction of its nominal value.

The scatter between two repeat flight records of one aircraft identified by output error;
Cramer-Rao bounds understate it about tenfold. See also Cobleigh, NASA/TP-1998-206544.
"""

ModelName = Literal[
    "f16_sl_h0_v502",
    "f104a_sl_m0p8",
    "nt33a_fc1_pa",
    "f4c_35k_m0p6",
    "dc8_15k_m0p44",
    "b747_40k_m0p8",
    "attas_id_16kft",
]


AircraftClass = Literal["fighter", "transport", "light"]
"""The overall shape of an aircraft, for display."""


@dataclass(frozen=True)
class UsualTest:
    """The usual first test of an aircraft: a rudder doublet; about a quarter of the draws exceed.

    control_law: its name in CONTROL_LAWS.   doublet_deg: amplitude of the usual doublet [deg].
    limit_g: limit of the lateral acceleration [g].
    """

    control_law: str
    doublet_deg: float
    limit_g: float


@dataclass(frozen=True)
class PublishedModel:
    """Stability derivatives of one aircraft in one straight and level flight condition.

    altitude: [m], 0 for sea level.   speed: true airspeed [m/s].
    alpha0, theta0: trim angle of attack and pitch [rad].
    Y, L, N: derivatives by (beta [1/rad], p [s/rad], r [s/rad], delta_a [1/rad], delta_r [1/rad])
        of beta_dot [rad/s], p_dot [rad/s2], r_dot [rad/s2]; Y is divided by m V, so it is in 1/s.
    phi_to_beta, r_to_phi: g cos(theta0) / V [1/s] and tan(theta0) as rounded by the source, if its
        own V and theta0 do not give the printed digits.
    usual_test: default test of recipes, forms and the command line.
    """

    title: str
    aircraft_class: AircraftClass
    condition: str
    reference: str
    checked: str
    usual_test: UsualTest
    altitude: float
    speed: float
    alpha0: float
    theta0: float
    Y: tuple[float, float, float, float, float]
    L: tuple[float, float, float, float, float]
    N: tuple[float, float, float, float, float]
    gravity: float = STANDARD_GRAVITY
    phi_to_beta: float | None = None
    r_to_phi: float | None = None


# Extra digits of a Y derivative make beta_dot and N_y = Y V / g both agree with the source's six
# decimals; they carry no information.
MODELS: dict[ModelName, PublishedModel] = {
    "f16_sl_h0_v502": PublishedModel(
        title="F-16",
        aircraft_class="fighter",
        condition="502 ft/s, sea level, 1 g, centre of gravity at 0.35 c, alpha 2.11 deg",
        reference="Stevens, Lewis and Johnson, Aircraft Control and Simulation, 3rd ed., "
        "Example 5.3-1 (data base of NASA TP-1538)",
        checked="rows of A and B reproduced to 3-4 digits by an independent linearisation",
        usual_test=UsualTest("f16_damper", doublet_deg=9.5, limit_g=0.5),
        altitude=0.0,
        speed=502 * FOOT,
        alpha0=0.03691,
        theta0=0.03691,
        #      beta      p            r          delta_a     delta_r
        Y=(-0.3220, -0.00050162, 0.00761889, 0.01718874, 0.04583661),
        L=(-30.6492, -3.6784, 0.6646, -42.014995, 7.534395),
        N=(8.5396, -0.0254, -0.4764, -1.827735, -3.552338),
        gravity=GRAVITY_IN_FEET,
    ),
    "f104a_sl_m0p8": PublishedModel(
        title="F-104A",
        aircraft_class="fighter",
        condition="Mach 0.8, sea level, theta 2 deg",
        reference="Cook, Flight Dynamics Principles, Assignment 3 (data of NASA CR-2144)",
        checked="transcribed; modes not checked against a published value",
        usual_test=UsualTest("f104a_damper", doublet_deg=3.9, limit_g=0.5),
        altitude=0.0,
        speed=893.152 * FOOT,
        alpha0=radians(2.0),
        theta0=radians(2.0),
        Y=(-0.452, 0.0, 0.0, 0.0, 0.0719),
        L=(-146.0, -4.64, 3.67, 49.6, 41.5),
        N=(13.6, -0.188, -0.498, 3.51, -7.07),
        gravity=GRAVITY_IN_FEET,
    ),
    "nt33a_fc1_pa": PublishedModel(
        title="NT-33A",
        aircraft_class="light",
        condition="power approach, 228 ft/s, Mach 0.204, sea level, 11,800 lb, bare airframe",
        reference="Heffley and Jewell, NASA CR-2144 (1972), Tables II-1, II-2, II-7",
        checked="spiral, roll and Dutch roll agree with NASA CR-2144, Table II-8",
        usual_test=UsualTest("nt33a_damper", doublet_deg=8.9, limit_g=0.1),
        altitude=0.0,
        speed=228 * FOOT,
        alpha0=radians(2.2),
        theta0=radians(2.2),
        Y=(-0.125, 0.0, 0.0, 0.0, 0.0295),
        L=(-5.49, -2.03, 0.641, 6.01, -0.0125),
        N=(0.667, -0.116, -0.207, 0.0286, -1.24),
        gravity=GRAVITY_IN_FEET,
    ),
    "f4c_35k_m0p6": PublishedModel(
        title="F-4C Phantom",
        aircraft_class="fighter",
        condition="178 m/s, Mach 0.6, 35,000 ft, theta 9.4 deg, body axes",
        reference="Cook, Flight Dynamics Principles, Example 4.2 (from NASA CR-2144)",
        checked="magnitudes within 1 % of the published state matrix; the sign of L_r is not "
        "confirmed",
        usual_test=UsualTest("f4c_damper", doublet_deg=9.2, limit_g=0.1),
        altitude=35_000 * FOOT,
        speed=178.0,
        alpha0=radians(9.4),
        theta0=radians(9.4),
        Y=(-0.0565233, 0.0, 0.0, -0.00150438, 0.0112876),
        L=(-10.682954, -0.797897, 0.299624, 4.698184, 0.770286),
        N=(1.657687, -0.017937, -0.133869, 0.088713, -1.357468),
    ),
    "dc8_15k_m0p44": PublishedModel(
        title="Douglas DC-8",
        aircraft_class="transport",
        condition="468.2 ft/s, Mach 0.44, 15,000 ft, stability axes",
        reference="Cook, Flight Dynamics Principles, Example 7.1 (data of Teper, 1969)",
        checked="modes agree with the published characteristic polynomial; the numbers were "
        "recalled, not copied from the page",
        usual_test=UsualTest("none", doublet_deg=5.0, limit_g=0.1),
        altitude=15_000 * FOOT,
        speed=468.2 * FOOT,
        alpha0=0.0,
        theta0=0.0,
        Y=(-0.1008, 0.0, 0.0, 0.0, 0.0288),
        L=(-2.710878, -1.232, 0.397, -1.62, 0.392),
        N=(1.301596, -0.0346, -0.257, -0.01875, -0.864),
        gravity=GRAVITY_IN_FEET,
    ),
    "b747_40k_m0p8": PublishedModel(
        title="Boeing 747",
        aircraft_class="transport",
        condition="235.9 m/s, Mach 0.8, 40,000 ft",
        reference="Heffley and Jewell, NASA CR-2144, as printed in MathWorks Control System "
        'Toolbox, "Yaw Damper Design for a 747 Jet Aircraft"',
        checked="poles agree with those published with the matrices",
        usual_test=UsualTest("b747_yaw_damper_mathworks", doublet_deg=12.2, limit_g=0.1),
        altitude=40_000 * FOOT,
        speed=235.9,
        alpha0=0.0802,
        theta0=0.0802,
        # Y_p, Y_r: what rounding to 0.0802 and -0.9968 leaves; zero within the printed digits.
        Y=(-0.0558, 8.5947e-05, -1.42966e-05, 0.0, 0.00729),
        L=(-3.05, -0.465, 0.388, 0.143, 0.153),
        N=(0.598, -0.0318, -0.115, 0.00775, -0.475),
        phi_to_beta=0.0415,
        r_to_phi=0.0805,
    ),
    "attas_id_16kft": PublishedModel(
        title="VFW-614 ATTAS",
        aircraft_class="transport",
        condition="131 m/s, 15,770 ft, alpha 2.15 deg, theta 1.6 deg",
        reference="identified from the flight data of Jategaonkar, Flight Vehicle System "
        "Identification, 2nd ed., AIAA 2015",
        checked="output error on two flight records; R2 0.97-0.998 on five channels",
        usual_test=UsualTest("attas_damper", doublet_deg=6.4, limit_g=0.2),
        altitude=15_770 * FOOT,
        speed=131.0,
        alpha0=radians(2.15),
        theta0=radians(1.6),
        Y=(-0.19482295, 0.0030992, 0.01750225, 0.00663259, 0.04657036),
        L=(-3.8335, -2.2617, 0.7182, -6.6244, 1.2418),
        N=(2.9719, -0.1693, -0.1478, -0.4037, -1.7453),
    ),
}
