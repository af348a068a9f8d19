"""Infer the units that a file does not give, jointly, by physics, magnitudes and other signals.

The likelihood of a unit is that of the resulting range of values. The signals of one group come
from one recorder, which writes angles and rates in degrees or in radians, and lengths in metres or
in feet. Physical relations between signals must hold. The most likely combination wins, and the
confidence in each unit is its probability over all combinations.
"""

from collections import Counter
from dataclasses import dataclass, field, replace
from math import exp, log

import numpy as np

from app.telemetry.contents import Columns
from app.telemetry.mapping.candidates import Candidate
from app.telemetry.mapping.magnitudes import COMMON, RULED_OUT, extent_of, unit_weights
from app.telemetry.mapping.mapping import ChannelSource, Mapping
from app.telemetry.mapping.recorded_motion import (
    UnitRelation,
    angles_of_quaternion,
    motion_as_recorded,
    relation_of_mach,
    relation_of_normal,
    relation_of_turn,
    relations_of_airspeed,
    relations_of_motion,
)
from app.telemetry.targets import TARGETS
from app.telemetry.units import PLAIN, factor, spelled
from core.types import Array

ALIKE = 0.9
"""Correlation of the magnitudes' log likelihoods: in a gentle manoeuvre all angles are small."""
LEAST = -12.0
"""Smallest log likelihood of a relation or magnitude, since each may mislead."""
LEAST_BY_AIRCRAFT = -6.0
"""The same for a relation that is typical of aircraft rather than kinematic."""
MOST_BY_MAGNITUDE = 2.5
"""Largest log odds from the magnitude of one angle or rate."""
SAME = 3.0
"""Log odds that a signal uses the units of its recorder's other signals."""
NEITHER = log(0.5 * (1.0 + exp(-SAME)))
"""Log likelihood of a unit that fits both systems: mean of the likelihoods of the others."""
SAME_FILE = 1.0
"""Log odds that a recorder uses the units of the file's other recorders."""
BOTH_ANGULAR = 2.0
"""Log odds that degrees and degrees per second occur together."""
CONTRADICTED = 3.5
"""Deviation from a relation, in multiples of its scatter, that contradicts it."""
LARGE = log(20.0)
"""Deviation too large for an error of scale."""
BY_PHYSICS, BY_AIRCRAFT = 0.5, 0.8
"""Factors on the confidence if a contradicted relation is kinematic or typical of aircraft."""
SELDOM = 0.8
"""Factor on the confidence if the unit is rare and lacks evidence."""
LOAD_FACTOR = {"g": 0.9, "m/s^2": 0.07, "ft/s^2": 0.03}
ACCELERATION = {"g": 0.35, "m/s^2": 0.55, "ft/s^2": 0.1}
SYSTEMS = {
    "angle": {"rad": 0, "deg": 1},
    "rate": {"rad/s": 0, "deg/s": 1},
    "length": {"m/s": 0, "m/s^2": 0, "km/h": 0, "ft/s": 1, "ft/s^2": 1},
}
"""Units that one recorder uses together; knots and g fit both systems."""
ANGULAR = ("angle", "rate")
ALIKE_OR_NOT = np.array([[0.0, -1.0], [-1.0, 0.0]])
"""Log likelihood of two systems, per log odds that they are alike."""
ALTITUDE = {"m": (log(0.7), log(0.03)), "ft": (log(0.3), log(0.97))}
"""Log likelihood in a metric recorder and in one that writes feet per second."""

_Axes = dict[str | tuple[str, int], int]
"""Axes of the table of all combinations, by channel, (system, recorder) and system of the file."""


@dataclass(frozen=True, eq=False)
class UnitDecision:
    """Candidates with units.

    contradictions: key -> (reason, factor on the confidence), also for channels known before.
    """

    assigned: dict[str, Candidate]
    contradictions: dict[str, tuple[str, float]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Choice:
    """Possible units of a channel. weights: (n,) log likelihoods.   recorder: its number."""

    units: tuple[str, ...]
    weights: Array
    recorder: int
    system: str


def decide_units(columns: Columns, before: Mapping, assigned: dict[str, Candidate]) -> UnitDecision:
    """Give each candidate a unit; an inferred unit limits the certainty.

    before: channels with confirmed sources, and the times of the groups.
    """
    known = {key: source for key, source in before.channels.items() if source.signal}
    choices = _choices(columns, known, assigned)
    relations = _relations(columns, before, known, assigned)
    units, shares = _likeliest(choices, relations)
    factors = {key: factor(unit, TARGETS[key].unit) for key, unit in units.items()}
    with_units = {
        key: candidate
        if candidate.unit
        else _inferred(candidate, units[key], shares[key], relations, factors)
        for key, candidate in assigned.items()
    }
    return UnitDecision(with_units, _contradictions(relations, factors))


def _choices(
    columns: Columns, known: dict[str, ChannelSource], assigned: dict[str, Candidate]
) -> dict[str, _Choice]:
    groups = {key: columns.signal(source.signal).group for key, source in known.items()}
    groups |= {key: candidate.signal.group for key, candidate in assigned.items()}
    members = Counter(group for key, group in groups.items() if _system(key) in ANGULAR)
    unknown = [key for key, c in assigned.items() if not c.unit and _system(key) in ANGULAR]
    choices = {}
    for key, group in groups.items():
        unit = spelled(known[key].unit) if key in known else assigned[key].unit
        if TARGETS[key].unit == PLAIN or (key in known and not unit):
            continue
        if unit:
            units, weights = (unit,), np.zeros(1)
        else:
            candidate = assigned[key]
            common = _common(candidate)
            units = tuple(common)
            by_unit = unit_weights(key, candidate.extent, dict.fromkeys(units, 1.0))
            weights = np.log([by_unit[unit] for unit in units])
            # n equally correlated witnesses count as n / (1 + (n - 1) correlation)
            power = 1.0 / (1.0 + ALIKE * (len(unknown) - 1))
            impossible = weights <= log(RULED_OUT)
            weights -= weights.max()
            if key in unknown:
                weights = power * np.maximum(weights, -MOST_BY_MAGNITUDE)
            weights += np.log([common[unit] for unit in units])
            weights = np.where(impossible, LEAST, weights)
        # a group with one angle shows no system of units
        recorder = group if _system(key) in ANGULAR and members[group] > 1 else -1
        choices[key] = _Choice(units, weights, recorder, _system(key))
    for key in angles_of_quaternion(groups):  # always in radians
        choices[key] = _Choice(("rad",), np.zeros(1), -1, "")
    return choices


def _system(key: str) -> str:
    return {"rad": "angle", "rad/s": "rate", "m/s": "length", "g": "length", "m": "length"}.get(
        TARGETS[key].unit, ""
    )


def _relations(
    columns: Columns,
    before: Mapping,
    known: dict[str, ChannelSource],
    assigned: dict[str, Candidate],
) -> list[UnitRelation]:
    names = {key: source.signal for key, source in known.items()}
    names |= {key: candidate.signal.name for key, candidate in assigned.items()}
    moves, turns = motion_as_recorded(columns, before.times, names)
    relations: list[UnitRelation | None] = [
        relation_of_turn(key, unit) for key, unit in turns.items()
    ]
    for key, relate in (
        ("Ny", relation_of_normal), ("Ay", relation_of_normal), ("V", relation_of_mach)
    ):  # fmt: skip
        if key in names:
            relations.append(relate(columns, key, columns.signal(names[key])))
    if moves is not None:
        relations += relations_of_motion(moves)
        if "V" in names:
            speed = extent_of(columns.values(names["V"])).middle
            relations += relations_of_airspeed(moves, speed)
    return [relation for relation in relations if relation is not None]


def _likeliest(
    choices: dict[str, _Choice], relations: list[UnitRelation]
) -> tuple[dict[str, str], dict[str, float]]:
    """Units of the most likely combination, and the probability of each over all combinations.

    `total` holds the log likelihood of all combinations of the units of related channels and the
    systems of the recorders. Other channels depend only on the system of their recorder.
    """
    relations = [relation for relation in relations if relation.powers.keys() <= choices.keys()]
    related = sorted({key for relation in relations for key in relation.powers})
    recorders = sorted({(c.system, c.recorder) for c in choices.values() if c.system})
    axes: _Axes = {name: axis for axis, name in enumerate([*related, *recorders, *SYSTEMS])}
    shape = [len(choices[key].units) for key in related] + [2] * (len(axes) - len(related))
    total = np.zeros(shape)
    total += _along(BOTH_ANGULAR * ALIKE_OR_NOT, [axes[system] for system in ANGULAR], len(shape))
    for system, recorder in recorders:
        at = [axes[system, recorder], axes[system]]
        total += _along(SAME_FILE * ALIKE_OR_NOT, at, len(shape))
    joint: dict[str, Array] = {}
    for key, choice in choices.items():
        table = choice.weights[:, None] + _fit(choice)
        if key in axes:
            at = [axes[key], *([axes[choice.system, choice.recorder]] if choice.system else [])]
            total += _along(table if choice.system else table[:, 0], at, len(shape))
        elif choice.system:
            joint[key] = table
            over_units = np.logaddexp.reduce(table, axis=0)
            total += _along(over_units, [axes[choice.system, choice.recorder]], len(shape))
    for relation in relations:
        total += _along_relation(relation, choices, axes, len(shape))
    return _read_off(choices, joint, axes, total)


def _fit(choice: _Choice) -> Array:
    """(n units, 2 systems) log likelihood of the units given the system of the recorder."""
    fits = np.full((len(choice.units), 2), NEITHER)
    for row, unit in enumerate(choice.units):
        if choice.system == "length" and unit in ALTITUDE:
            fits[row] = ALTITUDE[unit]
        elif (system := SYSTEMS.get(choice.system, {}).get(unit)) is not None:
            fits[row] = -SAME
            fits[row, system] = 0.0
    return fits


def _along(table: Array, at: list[int], n_axes: int) -> Array:
    """Arrange a table along axes, for broadcasting."""
    order = np.argsort(at)
    shape = [1] * n_axes
    for axis, size in zip(at, table.shape, strict=True):
        shape[axis] = size
    return table.transpose(order).reshape(shape)


def _along_relation(
    relation: UnitRelation, choices: dict[str, _Choice], axes: _Axes, n_axes: int
) -> Array:
    size = np.full([1] * n_axes, relation.recorded)
    for key, power in relation.powers.items():
        logs = [log(factor(unit, TARGETS[key].unit)) for unit in choices[key].units]
        size = size + _along(power * np.array(logs), [axes[key]], n_axes)
    deviation = (size - relation.expected) / relation.scatter
    return np.maximum(-0.5 * deviation * deviation, LEAST if relation.exact else LEAST_BY_AIRCRAFT)


def _read_off(
    choices: dict[str, _Choice], joint: dict[str, Array], axes: _Axes, total: Array
) -> tuple[dict[str, str], dict[str, float]]:
    best = np.unravel_index(int(total.argmax()), total.shape)
    probability = np.exp(total - total.max())
    probability /= probability.sum()
    units, shares = {}, {}
    for key, choice in choices.items():
        if key in axes:
            of_unit = _marginal(probability, axes[key])
            units[key] = choice.units[best[axes[key]]]
        elif key in joint:
            given = np.exp(joint[key] - np.logaddexp.reduce(joint[key], axis=0))
            of_unit = given @ _marginal(probability, axes[choice.system, choice.recorder])
            units[key] = choice.units[int(of_unit.argmax())]
        else:
            of_unit = np.exp(choice.weights - np.logaddexp.reduce(choice.weights))
            units[key] = choice.units[int(of_unit.argmax())]
        shares[key] = float(of_unit[choice.units.index(units[key])])
    return units, shares


def _marginal(probability: Array, axis: int) -> Array:
    return probability.sum(axis=tuple(a for a in range(probability.ndim) if a != axis))


def _inferred(
    candidate: Candidate,
    unit: str,
    share: float,
    relations: list[UnitRelation],
    factors: dict[str, float],
) -> Candidate:
    key = candidate.key
    weights = unit_weights(key, candidate.extent, _common(candidate))
    alone = max(weights, key=lambda unit: weights[unit])
    why = f"unit not given: values up to {candidate.extent.peak:.3g} are taken as {unit}"
    evidence = [
        relation.in_words(factors)
        for relation in relations
        if key in relation.powers
        and relation.powers.keys() <= factors.keys()
        and abs(relation.deviation(factors)) < CONTRADICTED
    ]
    if evidence:
        why += f", because then {', and '.join(evidence)}"
    elif unit != alone:
        others = "angles" if _system(key) in ANGULAR else "speeds and lengths"
        why += f", like the other {others} of the file"
    if share < 0.9:
        rivals = sorted((u for u in weights if u != unit), key=lambda u: -weights[u])
        why += f", but {rivals[0]} is also plausible"
    if unit == "cdeg" and not evidence:
        share *= SELDOM
        why += ", but this may not be an angle: check the unit"
    return replace(candidate.because(why, share, unit=unit), unit_share=share)


def _contradictions(
    relations: list[UnitRelation], factors: dict[str, float]
) -> dict[str, tuple[str, float]]:
    contradictions = {}
    for relation in relations:
        if not relation.powers.keys() <= factors.keys():
            continue
        if abs(relation.deviation(factors)) > CONTRADICTED:
            several = len(relation.powers) > 1
            is_large = abs(relation.in_si(factors) - relation.expected) > LARGE
            fault = "unit or scale" if several and not is_large else "unit"
            channel = "one of them" if several else "it"
            text = f"{relation.in_words(factors)}: the {fault} of {channel} is wrong"
            least = BY_PHYSICS if relation.exact else BY_AIRCRAFT
            contradictions |= dict.fromkeys(relation.powers, (text, least))
    return contradictions


def _common(candidate: Candidate) -> dict[str, float]:
    """How common units are, also by name: a load factor is in g."""
    if TARGETS[candidate.key].unit != "g":
        return COMMON[TARGETS[candidate.key].unit]
    stem = candidate.stem
    if stem.startswith("n") or stem.endswith("load") or "loadfactor" in stem:
        return LOAD_FACTOR
    return ACCELERATION if "ac" in stem or "besch" in stem else COMMON["g"]
