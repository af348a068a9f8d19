"""Of several signals that are named like a rate, the one that the attitude follows."""

from math import sqrt

from app.telemetry.contents import Columns
from app.telemetry.mapping.candidates import PROPOSED, Candidate, Candidates
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.mapping.motion.as_recorded import motion_as_recorded
from app.telemetry.mapping.motion.signs import ANGLE_OF, FOLLOWS
from app.telemetry.mapping.naming.names import is_derived

CLEARER = 0.1
"""Correlation that another signal must have more: filters and noise make less of a difference."""
MOST_TRIED = 6


def choose_rates(
    columns: Columns, before: Mapping, candidates: Candidates, assigned: dict[str, Candidate]
) -> dict[str, Candidate]:
    """Replace a rate by another signal that follows the derivative of its angle clearly better.

    A rate that was derived follows it best, and is not taken for one that was measured.
    before: channels that were settled before, and the times of the groups.
    """
    chosen = dict(assigned)
    for key, angle in ANGLE_OF.items():
        name_of_angle = _name(angle, before, chosen)
        if key not in chosen or not name_of_angle:
            continue
        used = {candidate.signal.name for other, candidate in chosen.items() if other != key}
        rivals = [
            candidate
            for candidate in candidates.by_key[key]
            if candidate.certainty >= PROPOSED
            and candidate.signal.name not in used
            and (candidate is chosen[key] or not is_derived(candidate.signal.name))
        ][:MOST_TRIED]
        if len(rivals) < 2 or chosen[key] not in rivals:
            continue
        follows = {
            rival.signal.name: _follows(columns, before, key, rival, angle, name_of_angle)
            for rival in rivals
        }
        best = max(rivals, key=lambda rival: follows[rival.signal.name])
        itself = chosen[key].signal.name
        if follows[best.signal.name] ** 2 < FOLLOWS:
            continue
        if follows[best.signal.name] > follows[itself] + CLEARER:
            chosen[key] = best.because(
                f"it follows d({angle})/dt with a correlation of {follows[best.signal.name]:.2f}, "
                f"{itself} with {follows[itself]:.2f}"
            )
    return chosen


def _name(key: str, before: Mapping, chosen: dict[str, Candidate]) -> str:
    if key in before.channels:
        return before.channels[key].signal
    return chosen[key].signal.name if key in chosen else ""


def _follows(
    columns: Columns, before: Mapping, key: str, rate: Candidate, angle: str, name_of_angle: str
) -> float:
    """Magnitude of the correlation of a signal with the derivative of an angle."""
    names = {key: rate.signal.name, angle: name_of_angle}
    moves, _ = motion_as_recorded(columns, before.times, names)
    if moves is None:
        return 0.0
    effect = moves.effects(moves.values[key], {angle: moves.rates[angle]}).get(angle)
    return sqrt(max(effect.share, 0.0)) if effect else 0.0
