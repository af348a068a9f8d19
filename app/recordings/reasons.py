"""Why nothing is said of a stored sample of a scoring, in words: the same wherever it is shown."""

from collections.abc import Mapping, Sequence
from typing import Any

from core.monitor import State
from core.monitor.assessment import REASONS, STATES
from core.monitor.status import BETWEEN
from core.monitor.validity import in_words


def reason(code: int, t: float, manoeuvre: int, manoeuvres: Sequence[Mapping[str, Any]]) -> str:
    """The reason of a sample; empty where its state needs none.

    code, t, manoeuvre: as stored, see app.scoring.   manoeuvres: plain, as stored with them; those
    of earlier versions were withdrawn as a whole.
    """
    if STATES[code] is not State.INVALID:
        return REASONS[code]
    if manoeuvre < 0:
        return BETWEEN
    validity, begin = manoeuvres[manoeuvre]["validity"], manoeuvres[manoeuvre].get("withdrawn_t", t)
    is_withdrawn = validity["valid"] is False and begin is not None and t >= begin
    return (in_words(validity["reasons"]) if is_withdrawn else "") or REASONS[code]
