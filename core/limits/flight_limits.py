"""Limits of a flight in six degrees of freedom, with computed loads on fin and wing."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import degrees
from typing import Annotated

from core.bounds import Bounds, check_bounds
from core.channels import SIX_DOF, Channel, Dictionary, channel
from core.limits.limits import IntervalLimits

ABOVE = Bounds(above=0)
Limit = Annotated[float | None, Bounds(words="a limit is a finite number")]
FLIGHT = Dictionary(
    "flight",
    tuple(
        replace(known, reference="trim") if known.role == "control" else known
        for known in SIX_DOF.channels
    ),
)
"""The channels of six degrees of freedom, surfaces from trim: trim differs between aircraft, and a
monitor sees the begin of a manoeuvre in what a surface moves."""
QBAR = channel("qbar", "q̄", "Pa", "dynamic pressure", "condition", "absolute", "pressure")


FIELDS: dict[str, tuple[str | None, str, float]] = {
    "Nz": ("Nz_low", "Nz_high", 1.0),
    "alpha": ("alpha_low_deg", "alpha_high_deg", degrees(1.0)),
    "beta": ("beta_deg", "beta_deg", degrees(1.0)),
    "Ny": ("Ny", "Ny", 1.0),
    "qbar": (None, "qbar_high", 1.0),
    "V": ("V_low_mps", "V_high_mps", 1.0),
    "fin_load": ("fin_load", "fin_load", 1.0),
    "wing_bending": (None, "wing_bending", 1.0),
}
"""Parameters with the low and high limit of each channel, and their unit per unit of the channel.
One parameter for both: a magnitude."""


def _number(value: float) -> str:
    """A number as formulas take it."""
    return f"({value!r})"


@dataclass(frozen=True)
class FinLoad:
    """Side force on the fin, L = q S_v eta a_v (-beta + l_v r / V + tau delta_r).

    The load of the manoeuvres of 14 CFR 25.351 and 25.353, positive to the right. r counts from
    trim. The default geometry is assumed: of the size of a fighter's fin, of no known aircraft.
    """

    area_m2: Annotated[float, ABOVE] = 5.0
    """area S_v of the fin [m2]."""
    efficiency: Annotated[float, ABOVE] = 0.95
    """efficiency eta: dynamic pressure at the fin over that of the aircraft."""
    slope: Annotated[float, ABOVE] = 2.5
    """lift-curve slope a_v of the fin: per radian."""
    arm_m: Annotated[float, ABOVE] = 5.0
    """arm l_v: from the centre of gravity back to the fin [m]."""
    rudder: float = 0.5
    """rudder effectiveness tau: angle of attack of the fin per rudder."""

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def channel(self) -> Channel:
        size = _number(self.area_m2 * self.efficiency * self.slope)
        flow = f"-beta + {_number(self.arm_m)} * r / V + {_number(self.rudder)} * delta_r"
        return _load("fin_load", "N", "side force on the fin", f"qbar * {size} * ({flow})")


@dataclass(frozen=True)
class WingBending:
    """Bending moment at the root of the wing that bears more.

    M = k N_z + q |k_p p / V + k_a delta_a|, with k = W y share / 2. p counts from trim. The default
    coefficients are assumed: of the size of a fighter, of no known aircraft.
    """

    weight_n: Annotated[float, ABOVE] = 90_000.0
    """weight W that the wings bear, less their own [N]."""
    arm_m: Annotated[float, ABOVE] = 1.9
    """arm y: from the root to the centre of a wing's lift [m]."""
    share: Annotated[float, ABOVE] = 0.8
    """share of the lift that the wings bear."""
    roll: float = 120.0
    """k_p, from roll damping: bending moment per dynamic pressure and p / V [m4]."""
    aileron: float = 6.0
    """k_a, from aileron: bending moment per dynamic pressure and aileron [m3]."""

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def channel(self) -> Channel:
        lift = _number(0.5 * self.weight_n * self.arm_m * self.share)
        rolling = f"{_number(self.roll)} * p / V + {_number(self.aileron)} * delta_a"
        formula = f"{lift} * Nz + qbar * abs({rolling})"
        return _load("wing_bending", "N m", "bending moment at the wing root", formula)


def _load(key: str, unit: str, label: str, formula: str) -> Channel:
    known = channel(key, key, unit, label, "output", "absolute", key)
    return replace(known, formula=formula)


Ends = tuple[float | None, float | None]
"""Low and high; None: no limit on that side."""


@dataclass(frozen=True)
class LoadLimits:
    """Limits on channels and loads, each optional: unsafe as soon as one is reached.

    ValueError for no limit at all.
    """

    Nz_low: Limit = None
    """lowest normal acceleration N_z [g]."""
    Nz_high: Limit = None
    """highest normal acceleration N_z [g]."""
    alpha_low_deg: Limit = None
    """lowest angle of attack [deg]."""
    alpha_high_deg: Limit = None
    """highest angle of attack [deg]."""
    beta_deg: Annotated[float | None, ABOVE] = None
    """largest sideslip, to either side [deg]."""
    Ny: Annotated[float | None, ABOVE] = None
    """largest lateral acceleration N_y, from trim, to either side [g]."""
    qbar_high: Annotated[float | None, ABOVE] = None
    """highest dynamic pressure [Pa]."""
    V_low_mps: Annotated[float | None, ABOVE] = None
    """lowest true airspeed [m/s]."""
    V_high_mps: Annotated[float | None, ABOVE] = None
    """highest true airspeed [m/s]."""
    fin_load: Annotated[float | None, ABOVE] = None
    """largest load on the fin, to either side [N]."""
    wing_bending: Annotated[float | None, ABOVE] = None
    """largest bending moment at the wing root [N m]."""
    fin: FinLoad = FinLoad()
    """geometry of the fin: for its load."""
    wing: WingBending = WingBending()
    """coefficients of the wing: for its bending moment."""

    def __post_init__(self) -> None:
        check_bounds(self)
        if not self.ends:
            known = ", ".join(field.name for field in fields(self)[:-2])
            raise ValueError(f"no limit was given: set at least one of {known}")

    @property
    def ends(self) -> dict[str, Ends]:
        """Limits by channel, in its unit."""
        known: dict[str, Ends] = {}
        for key, (low, high, factor) in FIELDS.items():
            least, most = (getattr(self, name) if name else None for name in (low, high))
            if low == high and most is not None:
                least = -most
            if (least, most) != (None, None):
                least, most = (None if end is None else end / factor for end in (least, most))
                known[key] = least, most
        return known

    @staticmethod
    def given(ends: Mapping[str, Ends]) -> dict[str, float | None]:
        """The parameters of limits by channel, in its unit.   ValueError for others."""
        parameters: dict[str, float | None] = {}
        for key, (least, most) in ends.items():
            if key not in FIELDS:
                raise ValueError(f"{key} cannot be limited: choose {', '.join(FIELDS)}")
            low, high, factor = FIELDS[key]
            if low == high and (least is None or most is None or least != -most):
                raise ValueError(f"{key} has one limit to either side: write it as {key}=VALUE")
            if low is None and least is not None:
                raise ValueError(f"{key} has no lower limit: write it as {key}=..HIGH")
            for name, end in ((low, least), (high, most)):
                if name is not None and end is not None:
                    parameters[name] = end * factor
        return parameters

    @property
    def dictionary(self) -> Dictionary:
        """The channels of a flight, with those that the limits need besides."""
        loads = {"fin_load": self.fin, "wing_bending": self.wing}
        computed = [load.channel for key, load in loads.items() if key in self.ends]
        measured = [QBAR] if computed or "qbar" in self.ends else []
        return FLIGHT.plus(*measured, *computed)

    def of_trim(self, rest: dict[str, float]) -> IntervalLimits:
        """These limits with the values in trimmed flight, by channel.

        ValueError for one that is exceeded in trim.
        """
        return IntervalLimits.of(self.dictionary, self.ends, rest)


ALL_CHANNELS = LoadLimits(fin_load=1.0, wing_bending=1.0).dictionary
"""Those that can be limited, and more."""
