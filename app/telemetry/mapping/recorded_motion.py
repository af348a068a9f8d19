"""Evidence on units from the motion in the raw numbers of a file.

A roll rate is the slope of the bank angle, beta-dot follows minus the yaw rate and g/V times side
force and bank, N_z is near 1 g, and airspeed over Mach number is the speed of sound. The raw
numbers show such a ratio times a quotient of units.
"""

from collections.abc import Collection, Iterator
from collections.abc import Mapping as AnyMapping
from dataclasses import dataclass
from math import exp, hypot, inf, log, pi, sqrt

import numpy as np

from app.telemetry.contents import Columns, Signal
from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.candidates import PROPOSED, Candidate, Candidates
from app.telemetry.mapping.magnitudes import extent_of
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource, source_of
from app.telemetry.mapping.motion import ANGLE_OF, LARGEST, Motion, motion, sideslip_balance
from app.telemetry.mapping.names import is_derived
from app.telemetry.mapping.signs import CLEAR, FOLLOWS, is_wrong_scale
from app.telemetry.mapping.spelling import spellings
from app.telemetry.mapping.vocabulary import MACH, NORMAL_ACCELERATION
from app.telemetry.recording import TelemetryError
from app.telemetry.targets import TARGETS
from app.telemetry.units import STANDARD_GRAVITY, factor, fits
from core.types import Array

MOST = 1_000_000
"""Samples that are searched for a jump of an angle."""
WRAP = 0.02
"""Deviation of a jump from a full turn, as a share of the turn."""
QUATERNION = ("q0", "q1", "q2", "q3")
TURNS = {"rad": 2.0 * pi, "deg": 360.0}


def motion_as_recorded(
    columns: Columns, times: AnyMapping[str, TimeSource], names: AnyMapping[str, str]
) -> tuple[Motion | None, dict[str, str]]:
    """The motion of signals, and the unit of each angle that jumps by a full turn.

    names: key of TARGETS -> signal of the file. Attitude from a quaternion is in radians.
    """
    units: dict[str, str] = {}
    for key in ("phi", "psi"):
        if key in names and (unit := turn_of(columns.values(names[key]))):
            units[key] = unit
    of_quaternion = angles_of_quaternion(names)
    derived = {key: ChannelSource(derivation=f"{key}_from_quaternion") for key in of_quaternion}
    mapping = Mapping(
        {key: source_of(columns, name, TARGETS[key].unit) for key, name in names.items()} | derived,
        dict(times),
    )
    try:
        traces = apply_mapping(columns, mapping)
    except TelemetryError:
        return None, units
    turns = units | dict.fromkeys(of_quaternion, "rad")
    return motion(traces, {key: TURNS[unit] for key, unit in turns.items()}), units


def angles_of_quaternion(names: Collection[str]) -> tuple[str, ...]:
    """Angles that are not recorded but follow from a quaternion."""
    is_complete = set(QUATERNION) <= set(names)
    return tuple(key for key in ("phi", "psi") if is_complete and key not in names)


def turn_of(values: Array) -> str:
    """The unit of an angle that jumps by a full turn; "" if it does not jump."""
    with np.errstate(invalid="ignore", over="ignore"):
        jumps = np.abs(np.diff(values[:MOST]))
    for unit, turn in TURNS.items():
        near = np.abs(jumps / turn - 1.0) < WRAP
        # most large jumps must be full turns, otherwise they are spikes
        if near.any() and near.sum() >= 0.5 * np.count_nonzero(jumps > 0.5 * turn):
            return unit
    return ""


CLEARER = 0.1
"""Least gain in correlation for another signal; filters and noise make less difference."""
MOST_TRIED = 6


def choose_rates(
    columns: Columns, before: Mapping, candidates: Candidates, assigned: dict[str, Candidate]
) -> dict[str, Candidate]:
    """Replace a rate by another signal that follows the derivative of its angle clearly better.

    A signal that is a multiple of the derivative does not follow it. Rates that were derived from
    the angle would follow it best, so they do not replace others.
    before: channels with confirmed sources, and the times of the groups.
    """
    chosen = dict(assigned)
    for key, angle in ANGLE_OF.items():
        names = {other: before.channels[other].signal for other in before.channels}
        names |= {other: candidate.signal.name for other, candidate in chosen.items()}
        of_angle = {other: names[other] for other in (angle, *QUATERNION) if names.get(other)}
        if key not in chosen or angle not in (*of_angle, *angles_of_quaternion(of_angle)):
            continue
        used = {candidate.signal.name for other, candidate in chosen.items() if other != key}
        rivals = [
            candidate
            for candidate in candidates.by_key[key]
            if candidate.signal.name not in used
            and (candidate is chosen[key] or not is_derived(candidate.signal.name))
        ][:MOST_TRIED]
        if len(rivals) < 2 or chosen[key] not in rivals:
            continue
        unit = before.channels[angle].unit if angle in before.channels else ""
        unit = unit or (chosen[angle].unit if angle in chosen else TARGETS[angle].unit)
        follows = {
            rival.signal.name: _Follows.of(columns, before, rival, of_angle, unit)
            for rival in rivals
        }
        current = follows[chosen[key].signal.name]
        named = [r for r in rivals if r.certainty >= PROPOSED or current.is_contradicted]
        best = max(named, key=lambda rival: follows[rival.signal.name].score)
        of_best = follows[best.signal.name]
        if of_best.score**2 >= FOLLOWS and of_best.score > current.score + CLEARER:
            how = f"is {current.size:.3g} times it" if current.is_contradicted else ""
            how = how or f"with only {current.correlation:.2f}"
            chosen[key] = best.because(
                f"it follows d({angle})/dt with a correlation of {of_best.correlation:.2f}, "
                f"{chosen[key].signal.name} {how}"
            )
    return chosen


@dataclass(frozen=True)
class _Follows:
    """How a signal follows the derivative of its angle.

    correlation: its magnitude.   size: ratio to the derivative, in the units that fit best if they
    are not given.   is_contradicted: whether the ratio is far from 1.
    """

    correlation: float = 0.0
    size: float = 1.0
    is_contradicted: bool = False

    @property
    def score(self) -> float:
        return 0.0 if self.is_contradicted else self.correlation

    @classmethod
    def of(
        cls, columns: Columns, before: Mapping, rate: Candidate, of_angle: dict[str, str], unit: str
    ) -> "_Follows":
        """unit: of the angle, "" if unknown."""
        names = of_angle | {rate.key: rate.signal.name}
        moves, _ = motion_as_recorded(columns, before.times, names)
        effect = moves.rate_effect(rate.key) if moves else None
        if effect is None or not effect.share > 0.0 or not effect.slope:
            return cls()
        sizes = [
            effect.size * factor(of_rate, "rad/s") / factor(of_angle, "rad")
            for of_rate in ([rate.unit] if rate.unit else ["rad/s", "deg/s"])
            for of_angle in ([unit] if unit else list(TURNS))
        ]
        size = min(sizes, key=lambda size: abs(log(size)))
        follows = effect.share >= FOLLOWS
        return cls(sqrt(effect.share), size, follows and is_wrong_scale(rate.key, size))


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


def relations_of_motion(moves: Motion) -> Iterator[UnitRelation]:
    """Ratios between channels, from a motion in raw numbers."""
    for key, angle in ANGLE_OF.items():
        effect = moves.rate_effect(key)
        if effect and effect.share >= FOLLOWS:
            size = log(effect.size)
            text = f"{key} is {{:.3g}} times d({angle})/dt"
            # in a bank r is smaller by cos(phi)
            yield UnitRelation({key: 1, angle: -1}, size, 0.0, 0.2 if key == "p" else 0.35, text)
    if "beta" in moves.values:
        # beta-dot against the yaw rate
        effect = moves.effect(moves.rates["beta"], "r", "p", "phi")
        if effect and effect.share >= FOLLOWS:
            size = log(effect.size)
            text = "d(beta)/dt is {:.3g} times -r"
            yield UnitRelation({"beta": 1, "r": -1}, size, 0.1, 0.3, text)
    effect = moves.effect("Ny", "beta", "delta_r", "p", "r", "delta_a", "phi")
    if effect and effect.share >= SIDE_FORCE_CLEAR:
        # C_Y,beta over C_L: 0.9 to 12 g per rad for the published aircraft
        text = "the side force is {:.2g} g per rad of sideslip"
        powers, size = {"Ny": 1, "beta": -1}, log(abs(effect.slope))
        yield UnitRelation(powers, size, log(2.0), 1.0, text, exact=False)
    for key, (rate, usual) in EFFECTIVENESS.items():
        acceleration = moves.rates.get(rate)
        others = ("p", "r", *(other for other in EFFECTIVENESS if other != key), "beta")
        effect = None if acceleration is None else moves.effect(acceleration, key, *others)
        if effect and effect.share >= CLEAR:
            text = f"{key} makes {{:.2g}} rad/s^2 of d({rate})/dt per rad"
            powers, size = {rate: 1, key: -1}, log(abs(effect.slope))
            yield UnitRelation(powers, size, log(usual), 1.3, text, exact=False)


def relations_of_airspeed(moves: Motion, speed: float) -> Iterator[UnitRelation]:
    """beta-dot against side force and bank, which is g/V times each.

    speed: raw airspeed.
    """
    slopes = sideslip_balance(moves) if 0.0 < speed < LARGEST else {}
    for key, per in (("Ny", "g of Ny"), ("phi", "rad of bank")):
        slope = slopes.get(key)
        wide = (slope.high - slope.value) / abs(slope.value) if slope and slope.value else inf
        if slope and wide < WIDEST:
            size = log(abs(slope.value) * speed / STANDARD_GRAVITY)
            text = f"d(beta)/dt + r is {{:.2g}} g/V per {per}"
            powers = {"V": 1, "beta": 1, key: -1}
            yield UnitRelation(powers, size, 0.0, hypot(0.2, wide), text)


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
