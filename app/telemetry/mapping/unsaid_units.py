"""Units that a file leaves unsaid: told by the reach of each signal, and by its companions.

A recorder writes its angles and rates either in degrees or in radians, so each one whose unit is
said or plain to see votes for the others.
"""

from dataclasses import replace
from math import exp, log

from app.telemetry.mapping.candidates import Candidate
from app.telemetry.mapping.magnitudes import COMMON, unit_weights
from app.telemetry.targets import TARGETS

ANGULAR = {"rad": ("rad", "deg"), "rad/s": ("rad/s", "deg/s")}
SAID_VOTE = 2.5
"""Log odds that a said unit lends to its companions, at the most; an unsaid one lends its own."""
VOTES = 0.7
MOST_VOTES = 4.0
LOAD_FACTOR = {"g": 0.9, "m/s^2": 0.1}
ACCELERATION = {"g": 0.35, "m/s^2": 0.65}


def settle_units(given: dict[str, Candidate]) -> dict[str, Candidate]:
    """Give each candidate a unit; where it was not said, as sure as the numbers are about it."""
    votes = {key: _vote(candidate) for key, candidate in given.items() if _is_angular(key)}
    settled = {}
    for key, candidate in given.items():
        if candidate.unit:
            settled[key] = candidate
            continue
        weights = unit_weights(key, candidate.reach, _common(candidate))
        alone = max(weights, key=lambda unit: weights[unit])
        if _is_angular(key):
            others = VOTES * sum(vote for other, vote in votes.items() if other != key)
            radians = ANGULAR[TARGETS[key].unit][0]
            weights[radians] *= exp(min(max(others, -MOST_VOTES), MOST_VOTES))
        settled[key] = _settled(candidate, weights, alone)
    return settled


def _settled(candidate: Candidate, weights: dict[str, float], alone: str) -> Candidate:
    unit = max(weights, key=lambda unit: weights[unit])
    sure = weights[unit] / sum(weights.values())
    why = f"no unit is said: values up to {candidate.reach.peak:.3g} are read as {unit}"
    if unit != alone:
        why += ", like the other angles of the file"
    elif sure < 0.9:
        others = sorted((u for u in weights if u != unit), key=lambda u: -weights[u])
        why += f", though {others[0]} is possible too"
    return replace(
        candidate,
        unit=unit,
        certainty=candidate.certainty * sure,
        reasons=(*candidate.reasons, why),
    )


def _is_angular(key: str) -> bool:
    return TARGETS[key].unit in ANGULAR


def _vote(candidate: Candidate) -> float:
    """Log odds of radians over degrees."""
    radians, degrees = ANGULAR[TARGETS[candidate.key].unit]
    if candidate.unit:
        return {radians: SAID_VOTE, degrees: -SAID_VOTE}.get(candidate.unit, 0.0)
    weights = unit_weights(candidate.key, candidate.reach)
    odds = log(weights[radians] / weights[degrees])
    return min(max(odds, -SAID_VOTE), SAID_VOTE)


def _common(candidate: Candidate) -> dict[str, float]:
    """How common units are, by what the signal is called: a load factor is in g."""
    if TARGETS[candidate.key].unit != "g":
        return COMMON[TARGETS[candidate.key].unit]
    stem = candidate.stem
    if stem.startswith("n") or stem.endswith("load") or "loadfactor" in stem:
        return LOAD_FACTOR
    return ACCELERATION if "ac" in stem or "besch" in stem else COMMON["g"]
