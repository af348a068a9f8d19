"""Why nothing is said of a stored sample of a scoring, in words: the same wherever it is shown."""

from collections.abc import Mapping, Sequence
from typing import Any

from core.monitor import State
from core.monitor.assessment import REASONS, STATES
from core.monitor.status import BETWEEN
from core.monitor.validity.verdict import in_words


def reason(code: int, t: float, manoeuvre: int, manoeuvres: Sequence[Mapping[str, Any]]) -> str:
    """The reason of a sample; empty where its state needs none.

    code, t, manoeuvre: as stored, see app.scoring.   manoeuvres: plain, as stored with them; those
    of earlier versions were withdrawn as a whole, or do not say what was known at that time.
    """
    if STATES[code] is not State.INVALID:
        return REASONS[code]
    if manoeuvre < 0:
        return BETWEEN
    scored = manoeuvres[manoeuvre]
    held = [one for one in scored.get("limits_in_force", ()) if one["start"] <= t]
    if held and held[-1]["reason"]:
        return held[-1]["reason"]
    validity, begin = scored["validity"], scored.get("withdrawn_t", t)
    if validity["valid"] is not False or begin is None or t < begin:
        return REASONS[code]
    why = scored.get("withdrawn_reason") or in_words(validity["reasons"])
    return why or REASONS[code]
