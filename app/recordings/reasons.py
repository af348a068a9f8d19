"""Why a stored sample has no assessment, in the same words everywhere."""

from collections.abc import Mapping, Sequence
from typing import Any

from core.monitor import State
from core.monitor.assessment import REASONS, STATES
from core.monitor.status import BETWEEN
from core.monitor.validity.verdict import in_words


def reason(code: int, t: float, manoeuvre: int, manoeuvres: Sequence[Mapping[str, Any]]) -> str:
    """The reason of a sample; empty if its state needs none.

    code, t, manoeuvre: as stored, see app.assessment.   manoeuvres: plain, as stored. Earlier
    versions withdrew them as a whole, or did not store when.
    """
    if STATES[code] is not State.INVALID:
        return REASONS[code]
    if manoeuvre < 0:
        return BETWEEN
    scored = manoeuvres[manoeuvre]
    in_force = [limits for limits in scored.get("limits_in_force", ()) if limits["start"] <= t]
    if in_force and in_force[-1]["reason"]:
        return in_force[-1]["reason"]
    validity, begin = scored["validity"], scored.get("withdrawn_t", t)
    if validity["valid"] is not False or begin is None or t < begin:
        return REASONS[code]
    return scored.get("withdrawn_reason") or in_words(validity["reasons"]) or REASONS[code]
