"""Physical relations that show units a file does not give: ratios that are known in SI.

A roll rate is the slope of the bank angle, beta-dot follows minus the yaw rate and g/V times side
force and bank, N_z is near 1 g, and airspeed over Mach number is the speed of sound. The raw
numbers show such a ratio times a quotient of units.
"""

from dataclasses import dataclass
from math import exp, hypot, log, pi, sqrt

import numpy as np

from app.telemetry.contents import Columns, Signal
from app.telemetry.mapping.extent import extent_of
from app.telemetry.mapping.motion.as_recorded import TURNS, WRAP
from app.telemetry.mapping.motion.motion import Motion
from app.telemetry.mapping.motion.sideslip_balance import LARGEST, sideslip_balance
from app.telemetry.mapping.motion.signs import ANGLE_OF, CLEAR, FOLLOWS
from app.telemetry.mapping.naming.spelling import spellings
from app.telemetry.mapping.naming.vocabulary import MACH, NORMAL_ACCELERATION
from app.telemetry.units import STANDARD_GRAVITY, factor, fits

SIDE_FORCE_CLEAR = 0.6
"""Least share of the lateral acceleration that the sideslip must explain."""
EFFECTIVENESS = {"delta_a": ("p", 6.0), "delta_r": ("r", 1.7)}
"""Rate that a surface accelerates, and usual acceleration [rad/s2 per rad]: 0.2 to 47 and 0.5 to 7
for the published aircraft, more for small aircraft."""
WIDEST = 0.3
"""Largest half interval of a slope, relative to the slope, that still gives an airspeed."""
STILL_MACH = 0.1
"""Slower samples are ignored."""


@dataclass(frozen=True)
class UnitRelation:
    """A ratio of quantities that is known in SI (N_y in g).

    powers: key of TARGETS -> power of its unit in the ratio.   recorded: natural logarithm of the
    ratio of the raw numbers.   expected, scatter: of the logarithm in SI, normally distributed.
    text: the ratio in words.   exact: whether it is kinematics, not a statistic of aircraft.
    """

    powers: dict[str, int]
    recorded: float
    expected: float
    scatter: float
    text: str
    exact: bool = True

    def in_si(self, factors: dict[str, float]) -> float:
        """Logarithm of the ratio in SI. factors: factors of the units to SI."""
        return self.recorded + sum(n * log(factors[key]) for key, n in self.powers.items())

    def deviation(self, factors: dict[str, float]) -> float:
        """Distance from the expected value, in multiples of the scatter."""
        return (self.in_si(factors) - self.expected) / self.scatter

    def in_words(self, factors: dict[str, float]) -> str:
        return self.text.format(exp(self.in_si(factors)))


def relations_of_motion(moves: Motion) -> list[UnitRelation]:
    """Ratios between channels, from a motion in raw numbers."""
    relations = []
    for key, angle in ANGLE_OF.items():
        if key not in moves.values or angle not in moves.values:
            continue
        effect = moves.effects(moves.values[key], {angle: moves.rates[angle]}).get(angle)
        if effect and effect.share >= FOLLOWS:
            # undo the bias of the slope by noise in the derivative
            size = log(abs(effect.slope) / sqrt(effect.share))
            text = f"{key} is {{:.3g}} times d({angle})/dt"
            # in a bank r is smaller by cos(phi)
            scatter = 0.2 if key == "p" else 0.35
            relations.append(UnitRelation({key: 1, angle: -1}, size, 0.0, scatter, text))
    return [*relations, *_of_sideslip(moves), *_of_surfaces(moves)]


def _of_surfaces(moves: Motion) -> list[UnitRelation]:
    """Angular acceleration per deflection."""
    relations = []
    for key, (rate, usual) in EFFECTIVENESS.items():
        if key not in moves.values or rate not in moves.values:
            continue
        others = ("p", "r", *EFFECTIVENESS, "beta")
        causes = {other: moves.values[other] for other in others if other in moves.values}
        effect = moves.effects(moves.rates[rate], causes).get(key)
        if effect and effect.share >= CLEAR:
            size = log(abs(effect.slope))
            text = f"{key} makes {{:.2g}} rad/s^2 of d({rate})/dt per rad"
            powers = {rate: 1, key: -1}
            relations.append(UnitRelation(powers, size, log(usual), 1.3, text, exact=False))
    return relations


def _of_sideslip(moves: Motion) -> list[UnitRelation]:
    """beta-dot against the yaw rate, and side force against sideslip."""
    if "beta" not in moves.values:
        return []
    relations = []
    if "r" in moves.values:
        causes = {key: moves.values[key] for key in ("r", "p", "phi") if key in moves.values}
        effect = moves.effects(moves.rates["beta"], causes).get("r")
        if effect and effect.share >= FOLLOWS:
            size = log(abs(effect.slope) / sqrt(effect.share))
            text = "d(beta)/dt is {:.3g} times -r"
            relations.append(UnitRelation({"beta": 1, "r": -1}, size, 0.1, 0.3, text))
    if "Ny" in moves.values:
        others = ("beta", "delta_r", "p", "r", "delta_a", "phi")
        causes = {key: moves.values[key] for key in others if key in moves.values}
        effect = moves.effects(moves.values["Ny"], causes).get("beta")
        if effect and effect.share >= SIDE_FORCE_CLEAR:
            # C_Y,beta over C_L: 0.9 to 12 g per rad for the published aircraft
            relations.append(
                UnitRelation(
                    {"Ny": 1, "beta": -1}, log(abs(effect.slope)), log(2.0), 1.0,
                    "the side force is {:.2g} g per rad of sideslip", exact=False,
                )
            )  # fmt: skip
    return relations


def relations_of_airspeed(moves: Motion, speed: float) -> list[UnitRelation]:
    """beta-dot against side force and bank, which is g/V times each.

    speed: raw airspeed.
    """
    relations = []
    slopes = sideslip_balance(moves) if 0.0 < speed < LARGEST else {}
    for key, per in (("Ny", "g of Ny"), ("phi", "rad of bank")):
        if key not in slopes:
            continue
        slope = slopes[key]
        wide = slope.high - slope.value
        if not wide < WIDEST * abs(slope.value):
            continue
        size = log(abs(slope.value) * speed / STANDARD_GRAVITY)
        text = f"d(beta)/dt + r is {{:.2g}} g/V per {per}"
        powers = {"V": 1, "beta": 1, key: -1}
        relations.append(UnitRelation(powers, size, 0.0, hypot(0.2, wide / slope.value), text))
    return relations


def relation_of_turn(key: str, unit: str) -> UnitRelation:
    text = f"{key} jumps by {{:.3g}} rad, a full turn"
    return UnitRelation({key: 1}, log(TURNS[unit]), log(2.0 * pi), WRAP, text)


def relation_of_normal(columns: Columns, key: str, like: Signal) -> UnitRelation | None:
    """A normal acceleration of the same group is near 1 g."""
    normal = _named(columns, like.group, NORMAL_ACCELERATION)
    if normal is None:
        return None
    if fits(normal.unit, "g"):
        text = f"{normal.name} in its group is given in {normal.unit}"
        return UnitRelation({key: 1}, -log(factor(normal.unit, "g")), 0.0, 0.1, text)
    level = abs(extent_of(columns.values(normal.name)).middle)
    if not 0.5 < level < 50.0:
        return None
    text = f"{normal.name} in its group is at {{:.3g}} g"
    return UnitRelation({key: 1}, log(level), 0.0, 0.15, text)


def relation_of_mach(columns: Columns, key: str, like: Signal) -> UnitRelation | None:
    """Airspeed over Mach number is the speed of sound, 295 to 345 m/s."""
    mach = _named(columns, like.group, MACH)
    if mach is None:
        return None
    speeds, machs = columns.values(like.name), columns.values(mach.name)
    stride = 1 + len(machs) // 10_000
    flying = np.isfinite(speeds[::stride]) & (machs[::stride] > STILL_MACH)
    if flying.sum() < 20:
        return None
    ratio = float(np.median(speeds[::stride][flying] / machs[::stride][flying]))
    if not 0.0 < ratio < 1e4:
        return None
    text = f"{key} over {mach.name} is {{:.0f}} m/s, the speed of sound"
    return UnitRelation({key: 1}, log(ratio), log(318.0), 0.06, text)


def _named(columns: Columns, group: int, names: frozenset[str]) -> Signal | None:
    """The first signal of a group whose words make one of the names."""
    place = columns.contents.groups[group].name
    for signal in columns.contents.signals:
        ways = spellings(signal.name, place) if signal.group == group else ()
        if any("".join(way.words) in names for way in ways):
            return signal
    return None
