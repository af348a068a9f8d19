"""Choose among several rate signals the one that fits the attitude best."""

from math import sqrt

from app.telemetry.contents import Columns
from app.telemetry.mapping.candidates import PROPOSED, Candidate, Candidates
from app.telemetry.mapping.mapping import Mapping
from app.telemetry.mapping.motion.as_recorded import (
    QUATERNION,
    angles_of_quaternion,
    motion_as_recorded,
)
from app.telemetry.mapping.motion.signs import ANGLE_OF, FOLLOWS
from app.telemetry.mapping.naming.names import is_derived

CLEARER = 0.1
"""Least gain in correlation for another signal; filters and noise make less difference."""
MOST_TRIED = 6


def choose_rates(
    columns: Columns, before: Mapping, candidates: Candidates, assigned: dict[str, Candidate]
) -> dict[str, Candidate]:
    """Replace a rate by another signal that follows the derivative of its angle clearly better.

    Rates that were derived from the angle would follow it best, so they do not replace others.
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
            if candidate.certainty >= PROPOSED
            and candidate.signal.name not in used
            and (candidate is chosen[key] or not is_derived(candidate.signal.name))
        ][:MOST_TRIED]
        if len(rivals) < 2 or chosen[key] not in rivals:
            continue
        follows = {
            rival.signal.name: _follows(columns, before, key, rival, of_angle) for rival in rivals
        }
        best = max(rivals, key=lambda rival: follows[rival.signal.name])
        current = chosen[key].signal.name
        if follows[best.signal.name] ** 2 < FOLLOWS:
            continue
        if follows[best.signal.name] > follows[current] + CLEARER:
            chosen[key] = best.because(
                f"it follows d({angle})/dt with a correlation of {follows[best.signal.name]:.2f}, "
                f"{current} with only {follows[current]:.2f}"
            )
    return chosen


def _follows(
    columns: Columns, before: Mapping, key: str, rate: Candidate, of_angle: dict[str, str]
) -> float:
    """Magnitude of the correlation between a signal and the derivative of its angle."""
    angle, names = ANGLE_OF[key], of_angle | {key: rate.signal.name}
    moves, _ = motion_as_recorded(columns, before.times, names)
    if moves is None or angle not in moves.values:
        return 0.0
    effect = moves.effects(moves.values[key], {angle: moves.rates[angle]}).get(angle)
    return sqrt(max(effect.share, 0.0)) if effect else 0.0
