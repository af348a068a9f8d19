"""Units that a file does not give: inferred from the extent of each signal, and its companions.

A recorder writes its angles and rates either in degrees or in radians, so each one whose unit is
given or evident votes for the others.
"""

from dataclasses import replace
from math import exp, log

from app.telemetry.mapping.candidates import Candidate
from app.telemetry.mapping.magnitudes import COMMON, unit_weights
from app.telemetry.targets import TARGETS

ANGULAR = {"rad": ("rad", "deg"), "rad/s": ("rad/s", "deg/s")}
GIVEN_VOTE = 2.5
"""Log odds that a given unit lends to its companions, and the most that an inferred one does."""
VOTES = 0.7
MOST_VOTES = 4.0
LOAD_FACTOR = {"g": 0.9, "m/s^2": 0.1}
ACCELERATION = {"g": 0.35, "m/s^2": 0.65}


def infer_units(assigned: dict[str, Candidate]) -> dict[str, Candidate]:
    """Give each candidate a unit; an inferred one lowers its certainty to that of the unit."""
    votes = {key: _vote(candidate) for key, candidate in assigned.items() if _is_angular(key)}
    with_units = {}
    for key, candidate in assigned.items():
        if candidate.unit:
            with_units[key] = candidate
            continue
        weights = unit_weights(key, candidate.extent, _common(candidate))
        alone = max(weights, key=lambda unit: weights[unit])
        if _is_angular(key):
            others = VOTES * sum(vote for other, vote in votes.items() if other != key)
            radians = ANGULAR[TARGETS[key].unit][0]
            weights[radians] *= exp(min(max(others, -MOST_VOTES), MOST_VOTES))
        with_units[key] = _inferred(candidate, weights, alone)
    return with_units


def _inferred(candidate: Candidate, weights: dict[str, float], alone: str) -> Candidate:
    unit = max(weights, key=lambda unit: weights[unit])
    share = weights[unit] / sum(weights.values())
    why = f"unit not given: values up to {candidate.extent.peak:.3g} are taken as {unit}"
    if unit != alone:
        why += ", as for the other angles of the file"
    elif share < 0.9:
        others = sorted((u for u in weights if u != unit), key=lambda u: -weights[u])
        why += f", although {others[0]} is plausible too"
    return replace(candidate.because(why, share, unit=unit), unit_inferred=True)


def _is_angular(key: str) -> bool:
    return TARGETS[key].unit in ANGULAR


def _vote(candidate: Candidate) -> float:
    """Log odds of radians over degrees."""
    radians, degrees = ANGULAR[TARGETS[candidate.key].unit]
    if candidate.unit:
        return {radians: GIVEN_VOTE, degrees: -GIVEN_VOTE}.get(candidate.unit, 0.0)
    weights = unit_weights(candidate.key, candidate.extent)
    odds = log(weights[radians] / weights[degrees])
    return min(max(odds, -GIVEN_VOTE), GIVEN_VOTE)


def _common(candidate: Candidate) -> dict[str, float]:
    """How common units are, by what the signal is called: a load factor is in g."""
    if TARGETS[candidate.key].unit != "g":
        return COMMON[TARGETS[candidate.key].unit]
    stem = candidate.stem
    if stem.startswith("n") or stem.endswith("load") or "loadfactor" in stem:
        return LOAD_FACTOR
    return ACCELERATION if "ac" in stem or "besch" in stem else COMMON["g"]
