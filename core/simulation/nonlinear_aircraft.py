"""Nonlinear aircraft: the generic global aerodynamic model, and the F-16's polynomials.

Numbers are in SI units, converted from the sources' slugs and feet. delta_e > 0 is nose down,
delta_a > 0 rolls left, delta_r > 0 yaws left.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from math import isfinite
from typing import Annotated, NamedTuple

import numpy as np

from core.bounds import Bounds, check_bounds
from core.kernels.six_dof import F16_POLYNOMIAL, GENERIC, Body
from core.recipe import family
from core.simulation.published import FOOT, SIGMA_FRACTION, AircraftClass
from core.simulation.simulator import Parameters
from core.simulation.uncertain_plant import Uncertainty
from core.types import Array

POUND, SLUG = 0.45359237, 14.593903
"""[kg]"""
POSITIVE = Bounds(above=0)
LIFT, CONTROL, DAMPING = 0.05, 0.10, 0.20
"""Assumed one-sigma scatter of longitudinal parameters: 5 % of lift due to alpha, 10 % of pitching
moment due to alpha and of the elevator's effects, 20 % of damping and drag. No flight data behind
them; the lateral ones are those of `published.SIGMA_FRACTION`."""

TERMS: dict[str, tuple[str, ...]] = {
    "C_D": ("0", "alpha", "alpha q", "alpha de", "alpha2", "alpha2 q", "alpha2 de", "alpha3",
            "alpha3 q", "alpha4"),
    "C_Y": ("beta", "p", "r", "da", "dr"),
    "C_L": ("0", "alpha", "q", "de", "alpha q", "alpha2", "alpha3", "alpha4"),
    "C_l": ("beta", "p", "r", "da", "dr"),
    "C_m": ("0", "alpha", "q", "de", "alpha q", "alpha2 q", "alpha2 de", "alpha3 q", "alpha3 de",
            "alpha4"),
    "C_n": ("beta", "p", "r", "da", "dr", "beta2", "beta3"),
}  # fmt: skip
"""Terms of the generic model, in the order of its 45 parameters; rates are p b/(2V) and so on."""
GENERIC_NAMES = tuple(f"{part}_{term.replace(' ', '_')}" for part in TERMS for term in TERMS[part])
FACTORS = (
    "C_X_0", "C_X_q", "C_Y_beta", "C_Y_da", "C_Y_dr", "C_Y_p", "C_Y_r", "C_Z_alpha", "C_Z_de",
    "C_Z_q", "C_l_beta", "C_l_p", "C_l_r", "C_l_da", "C_l_dr", "C_m_alpha", "C_m_de", "C_m_q",
    "C_n_beta", "C_n_p", "C_n_r", "C_n_da", "C_n_dr",
)  # fmt: skip
"""The functions of the F-16 polynomials, each with an uncertain factor."""
LATERAL_ROWS = {"C_Y": "Y", "C_l": "L", "C_n": "N"}


def scatter_of(name: str) -> float:
    """Assumed one-sigma scatter of a parameter, as a fraction of its value."""
    part, cause = name[:3], name[4:]
    if row := LATERAL_ROWS.get(part):
        return SIGMA_FRACTION[f"{row}_{cause.rstrip('23')}"]
    if part in ("C_D", "C_X") or cause.endswith("q"):
        return DAMPING
    return LIFT if part in ("C_L", "C_Z") and not cause.endswith("de") else CONTROL


class UsualDoublets(NamedTuple):
    """About an aircraft and its usual test.

    aircraft_class: its shape, for display.   pitch_deg, rudder_deg: elevator and rudder of usual
    doublets [deg].
    """

    aircraft_class: AircraftClass
    pitch_deg: float
    rudder_deg: float


@dataclass(frozen=True)
class Airframe:
    """Mass and geometry."""

    mass_kg: Annotated[float, POSITIVE]
    """mass [kg]."""
    area_m2: Annotated[float, POSITIVE]
    """wing area [m2]."""
    span_m: Annotated[float, POSITIVE]
    """wing span [m]."""
    chord_m: Annotated[float, POSITIVE]
    """mean aerodynamic chord [m]."""
    ixx: Annotated[float, POSITIVE]
    """moment of inertia I_xx [kg m2]."""
    iyy: Annotated[float, POSITIVE]
    """moment of inertia I_yy [kg m2]."""
    izz: Annotated[float, POSITIVE]
    """moment of inertia I_zz [kg m2]."""
    ixz: float
    """product of inertia I_xz [kg m2]."""
    reference: float
    """reference point of the moments: behind the leading edge, in chords."""
    centre_of_gravity: float
    """centre of gravity: behind the leading edge, in chords."""

    def __post_init__(self) -> None:
        check_bounds(self)
        for field in fields(self):
            if not isfinite(value := getattr(self, field.name)):
                raise ValueError(f"{field.name} is {value}: give a finite number")
        if self.ixz**2 >= self.ixx * self.izz:
            raise ValueError(
                f"ixz={self.ixz:g} was given with ixx={self.ixx:g} and izz={self.izz:g}: its "
                "square must be less than their product"
            )

    @classmethod
    def of_feet(
        cls,
        weight_lb: float,
        inertia_slug_ft2: tuple[float, float, float, float],
        area_ft2: float,
        span_ft: float,
        chord_ft: float,
        reference: float,
        centre_of_gravity: float,
    ) -> "Airframe":
        """inertia: I_xx, I_yy, I_zz, I_xz."""
        ixx, iyy, izz, ixz = (each * SLUG * FOOT**2 for each in inertia_slug_ft2)
        return cls(
            weight_lb * POUND,
            area_ft2 * FOOT**2,
            span_ft * FOOT,
            chord_ft * FOOT,
            ixx,
            iyy,
            izz,
            ixz,
            reference,
            centre_of_gravity,
        )

    def body(self, model: int) -> Body:
        return Body(
            model,
            self.mass_kg,
            self.span_m,
            self.chord_m,
            self.area_m2,
            self.ixx,
            self.iyy,
            self.izz,
            self.ixz,
            self.reference - self.centre_of_gravity,
        )


@dataclass(frozen=True)
class NonlinearAircraft(ABC):
    """The recipe of a nonlinear aircraft in six degrees of freedom: its model and uncertainty."""

    airframe: Airframe
    """mass and geometry."""
    uncertainty: Uncertainty
    """uncertainty of the parameters: scatter of each about its nominal value."""

    def __post_init__(self) -> None:
        self.parameters  # noqa: B018 - refuses unknown names

    @property
    @abstractmethod
    def description(self) -> str:
        """The aircraft and the source of its numbers, in one line."""

    @property
    @abstractmethod
    def condition(self) -> UsualDoublets:
        """Its shape and usual tests."""

    @property
    @abstractmethod
    def body(self) -> Body: ...

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""

    @property
    @abstractmethod
    def nominal(self) -> Array:
        """(n_parameters,)"""

    @property
    def parameters(self) -> Parameters:
        spread = self.uncertainty.absolute(self.names, self.nominal)
        return Parameters(self.names, self.nominal, spread, self.uncertainty.distribution)


GENERIC_SCATTER = Uncertainty({name: scatter_of(name) for name in GENERIC_NAMES})
FACTOR_SCATTER = Uncertainty({name: scatter_of(name) for name in FACTORS})


@dataclass(frozen=True)
class GenericAircraft(NonlinearAircraft):
    """The generic global aerodynamic model: 45 parameters for any aircraft.

    Grauer and Morelli, Generic Global Aerodynamic Model for Aircraft, Journal of Aircraft 52(1),
    2015. One configuration, no effects of Mach number, alpha -4 to 30 deg, beta +-20 deg; C_n has
    a term in beta^2, so left and right differ, as published. The standard errors of its parameters
    are not at hand: the scatter is assumed.
    Raises ValueError for a number of parameters other than 45.
    """

    theta: tuple[float, ...]
    """parameters: theta_1 to theta_45 of the paper, of C_D, C_Y, C_L, C_l, C_m and C_n in this
    order."""
    title: str
    """name of the aircraft."""

    def __post_init__(self) -> None:
        if len(self.theta) != len(GENERIC_NAMES) or not np.isfinite(self.theta).all():
            raise ValueError(
                f"theta has {len(self.theta)} numbers, {np.isfinite(self.theta).sum()} of them "
                f"finite: give {len(GENERIC_NAMES)} finite ones"
            )
        super().__post_init__()

    @property
    def description(self) -> str:
        return (
            f"{self.title}, generic global aerodynamic model, six degrees of freedom; Grauer and "
            "Morelli, Journal of Aircraft 52(1), 2015"
        )

    @property
    def condition(self) -> UsualDoublets:
        return UsualDoublets("fighter", -3.0, 8.0)

    @property
    def body(self) -> Body:
        return self.airframe.body(GENERIC)

    @property
    def names(self) -> tuple[str, ...]:
        return GENERIC_NAMES

    @property
    def nominal(self) -> Array:
        return np.array(self.theta, dtype=np.float64)


@dataclass(frozen=True)
class PolynomialF16(NonlinearAircraft):
    """The F-16 as polynomials of the angles, each function with an uncertain factor.

    Morelli, Global Nonlinear Parametric Modeling with Application to F-16 Aerodynamics, American
    Control Conference 1998. Low speed, alpha -10 to 45 deg, beta +-30 deg; C_l and C_n have terms
    in beta^2, so left and right differ, as published. Slightly unstable in pitch with the centre of
    gravity at 0.35 chords, stable at 0.30. The scatter of the factors is assumed.
    """

    @property
    def description(self) -> str:
        return (
            "F-16, polynomials, six degrees of freedom; Morelli, American Control Conference 1998"
        )

    @property
    def condition(self) -> UsualDoublets:
        return UsualDoublets("fighter", -3.0, 8.0)

    @property
    def body(self) -> Body:
        return self.airframe.body(F16_POLYNOMIAL)

    @property
    def names(self) -> tuple[str, ...]:
        return FACTORS

    @property
    def nominal(self) -> Array:
        return np.ones(len(FACTORS))


F16_INERTIA = (9496.0, 55814.0, 63100.0, 982.0)
F16_SIZES = (300.0, 30.0, 11.32)

# Two public transcriptions agree, except for theta_31 of the F-16C (-8.267 here, -8267 in one) and
# the sign of its theta_42 (-0.034 here): the ones that damp pitch and yaw plausibly.
F16C_THETA = (
    0.034, -0.005, 20.77, 0.177, 1.285, -19.97, 0.756, 5.887, 55.59, -5.155,
    -1.146, -0.188, 0.876, 0.060, 0.164,
    0.074, 4.458, 29.90, 0.412, -5.538, -2.477, -1.101, 1.906,
    -0.071, -0.445, 0.058, -0.143, 0.023,
    -0.024, -0.288, -8.267, -0.563, -5.513, 9.793, -1.057, -2.018, 1.897, -0.094,
    0.234, 0.056, -0.418, -0.034, -0.085, 0.372, -0.725,
)  # fmt: skip
A7_THETA = (
    0.006, 0.320, 0.0, 0.074, -2.519, 0.0, 0.439, 19.76, 0.0, -22.10,
    -1.084, 0.030, 0.059, 0.099, 0.268,
    -0.093, 4.412, 0.0, 0.549, 0.0, 0.817, -9.833, 3.851,
    -0.054, -0.313, 0.031, -0.137, 0.004,
    -0.023, -0.810, -7.033, -1.032, 0.502, 8.007, 1.215, 17.15, -1.278, -1.969,
    0.102, 0.060, -0.294, -0.020, -0.121, 0.557, -0.923,
)  # fmt: skip

NONLINEAR_AIRCRAFT = family(
    "nonlinear_aircraft",
    NonlinearAircraft,
    {
        "f16_polynomial": PolynomialF16(
            Airframe.of_feet(20500.0, F16_INERTIA, *F16_SIZES, 0.35, 0.30), FACTOR_SCATTER
        ),
        "ggam_f16c": GenericAircraft(
            Airframe.of_feet(20500.0, F16_INERTIA, *F16_SIZES, 0.35, 0.25),
            GENERIC_SCATTER,
            F16C_THETA,
            "F-16C",
        ),
        "ggam_a7": GenericAircraft(
            Airframe.of_feet(
                22699.0, (16970.0, 65430.0, 76130.0, 4030.0), 375.0, 38.7, 10.8, 0.35, 0.30
            ),
            GENERIC_SCATTER,
            A7_THETA,
            "A-7",
        ),
    },
)
