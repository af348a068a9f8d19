"""What a report says of a scored flight, before it is a page."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from typing import Any

from app.scoring.outcome import verdict_of
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.targets import TARGETS
from core.channels import BY_KEY, KEYS
from core.monitor.validity.flown_input import amplitude_in_words

Plain = Mapping[str, Any]

OUTCOMES = {
    "timely_alert": ("▲", "limit exceeded, warned in time", "caution"),
    "late_alert": ("▲", "limit exceeded, warned too late", "bad"),
    "missed": ("✕", "limit exceeded, no warning", "bad"),
    "false_alert": ("△", "alert, no limit exceeded", "caution"),
    "quiet": ("●", "no alert, no limit exceeded", "good"),
    "unseen": ("◌", "not all seen: nothing can be said", "caution"),
    "invalid": ("▨", "invalid, no verdict", "invalid"),
    "unknown": ("?", "unknown: the monitor's limits are not known", "caution"),
}
"""Sign, words and level of each outcome; see outcome_of."""
TELLING = (
    "missed",
    "late_alert",
    "unseen",
    "false_alert",
    "timely_alert",
    "invalid",
    "unknown",
    "quiet",
)
"""Outcomes, those first that a reader wants to see drawn."""
MOST_DRAWN = 100
"""Manoeuvres that are drawn one by one."""
MOST_NOTES = 40


def outcome_of(manoeuvre: Plain) -> tuple[str, str, str]:
    """Sign, words and level of what came of a manoeuvre; an exceedance is said first."""
    sign, words, level = OUTCOMES[manoeuvre["outcome"]]
    said = verdict_of(manoeuvre)
    if not said:
        return sign, words, level
    if manoeuvre["exceedance"] is None:
        return sign, f"{said}; {words}", "caution" if level == "good" else level
    return sign, said, "caution" if manoeuvre["outcome"] == "timely_alert" else "bad"


def headline(manoeuvres: Sequence[Plain], outside: Sequence[Plain] = ()) -> tuple[str, str]:
    """Level and words of the whole flight; the worst that happened comes first.

    outside: exceedances in none of the manoeuvres.
    """
    level, words = _of_manoeuvres(manoeuvres)
    if any(manoeuvre.get("recorded_exceedance") for manoeuvre in manoeuvres):
        level = "caution" if level == "good" else level
        words = words.replace("No limit was exceeded", "No limit was exceeded from trim")
        words = f"{words}; a limit was exceeded as recorded, not from trim"
    if not outside:
        return level, words
    level = "caution" if level == "good" else level
    if any(manoeuvre["exceedance"] for manoeuvre in manoeuvres):
        return level, f"{words}; one was also exceeded outside every manoeuvre"
    words = words.replace("No limit was exceeded", "No limit was exceeded in a manoeuvre")
    return level, f"{words}; a limit was exceeded outside every manoeuvre"


def _of_manoeuvres(manoeuvres: Sequence[Plain]) -> tuple[str, str]:
    """Of the valid ones, and how many are not."""
    invalid = [s for s in manoeuvres if _is_invalid(s)]
    level, words = _of_valid([s for s in manoeuvres if not _is_invalid(s)])
    if level == "bad" or not invalid:
        pass
    elif exceeded := [s for s in invalid if s["exceedance"]]:
        level, words = _of_exceeded_invalid(exceeded)
    elif level == "good":
        level = "caution"
    n, total = len(invalid), len(manoeuvres)
    if not n or n == total:
        return level, words
    of_all = f"{n} of the {total} manoeuvres {'is' if n == 1 else 'are'} not valid"
    said = (
        "nothing is promised of"
        if any(s["exceedance"] for s in invalid)
        else "this says nothing of"
    )
    return level, f"{words}; {of_all}, {said} {'it' if n == 1 else 'them'}"


def _of_exceeded_invalid(exceeded: Sequence[Plain]) -> tuple[str, str]:
    """Of manoeuvres that are not valid: an alert before the withdrawal stands."""
    stands = {"timely_alert": ("caution", "in time"), "late_alert": ("bad", "too late")}
    outcomes = {s["outcome"] for s in exceeded}
    if len(outcomes) > 1 or not outcomes <= stands.keys():
        return "bad", "A limit was exceeded where the monitor is not applicable"
    level, when = stands[outcomes.pop()]
    words = f"A limit was exceeded, warned of {when} before the monitor was withdrawn"
    return level, f"{words} as not applicable"


def _is_invalid(manoeuvre: Plain) -> bool:
    return manoeuvre["validity"]["valid"] is False or manoeuvre["outcome"] == "invalid"


def _of_valid(manoeuvres: Sequence[Plain]) -> tuple[str, str]:
    if not manoeuvres:
        return "invalid", "No verdict: the monitor is not applicable"
    n = counts(manoeuvres)
    if n["unknown"]:
        return "caution", "Unknown: the monitor does not say which limits it was trained for"
    if n["missed"] or n["late_alert"]:
        return "bad", "A limit was exceeded without an alert in time"
    unseen = [s for s in manoeuvres if s["outcome"] == "unseen"]
    if any(s["exceedance"] for s in unseen):
        return (
            "bad",
            "A limit was exceeded where samples are missing: nothing can be said of alerts",
        )
    if unseen:
        return "caution", "Samples are missing: whether a limit was exceeded is not wholly known"
    unchecked = any(s["validity"]["valid"] is None for s in manoeuvres)
    level = "caution" if n["false_alert"] or unchecked else "good"
    if n["timely_alert"]:
        return "caution", "A limit was exceeded; every exceedance was warned of in time"
    of = amplitude_in_words([s["amplitude"] for s in manoeuvres if s.get("amplitude")])
    if n["false_alert"]:
        return level, f"No limit was exceeded, but there was an alert{of}"
    return level, f"No limit was exceeded, and there was no alert{of}"


def counts(manoeuvres: Sequence[Plain]) -> dict[str, int]:
    """How many manoeuvres came to each outcome."""
    return {name: sum(s["outcome"] == name for s in manoeuvres) for name in OUTCOMES}


def worst(manoeuvres: Sequence[Plain]) -> list[tuple[str, str]]:
    """Names of the manoeuvres in which a limit was exceeded unwarned, or may have been; and why."""
    named = []
    for manoeuvre in manoeuvres:
        outcome = manoeuvre["outcome"]
        if outcome in ("missed", "late_alert"):
            named.append((manoeuvre["name"], OUTCOMES[outcome][1]))
        elif outcome == "invalid" and manoeuvre["exceedance"]:
            named.append((manoeuvre["name"], "limit exceeded, no verdict"))
        elif outcome == "unseen":
            named.append((manoeuvre["name"], "not all seen"))
    return named


def alerts(manoeuvres: Sequence[Plain]) -> list[dict[str, Any]]:
    """Every alert: times, whether the first of its manoeuvre, whether that exceeded a limit.

    lead: what it left before the limit [s], None where that was not exceeded after it.
    """
    rows = []
    for number, manoeuvre in enumerate(manoeuvres, 1):
        exceedance = manoeuvre["exceedance"]
        for begin, end in manoeuvre["alerts"]:
            rows.append(
                {
                    "number": number,
                    "name": manoeuvre["name"],
                    "start": begin,
                    "end": end,
                    "first": begin == manoeuvre["alerts"][0][0],
                    "exceeds": exceedance is not None,
                    "lead": exceedance["t"] - begin
                    if exceedance and exceedance["t"] >= begin
                    else None,
                }
            )
    return rows


def exceeded_own(manoeuvres: Sequence[Plain], key: str, limit: float) -> list[tuple[Plain, Plain]]:
    """Manoeuvres in which a limit of the monitor's own was exceeded, each with its exceedance."""
    first = [
        (one, one.get("own_exceedance") or one["exceedance"])
        for one in manoeuvres
        if one["exceedance"] or one.get("own_exceedance")
    ]
    return [
        (one, exceedance)
        for one, exceedance in first
        if exceedance["channel"] == key and abs(exceedance["value"]) >= limit
    ]


def limits_in_force(in_force: Sequence[Plain], manoeuvres: Sequence[Plain]) -> list[dict[str, Any]]:
    """Which limits of a set held when, and the manoeuvres in which they were first exceeded."""
    rows = []
    for one in in_force:
        name = (
            f"{one['name']} version {one['version']}, {one['case'] or 'flight condition unknown'}"
        )
        exceeded = [
            manoeuvre
            for manoeuvre in manoeuvres
            if (first := manoeuvre["exceedance"]) and one["start"] <= first["t"] < one["end"]
        ]
        limits = [{"channel": BY_KEY[key], "limit": v} for key, v in (one["limits"] or {}).items()]
        rows.append(dict(one) | {"limits": limits, "words": name, "exceeded": exceeded})
    return rows


def drawn(manoeuvres: Sequence[Plain]) -> set[int]:
    """Positions of the manoeuvres that are drawn: all, or the most telling ones."""
    order = sorted(
        range(len(manoeuvres)), key=lambda k: (TELLING.index(manoeuvres[k]["outcome"]), k)
    )
    return set(order[:MOST_DRAWN])


def mapping_rows(mapping: Plain, rationales: Mapping[str, Plain]) -> list[dict[str, Any]]:
    """One row a channel and a clock with what it was read from, None where it is missing."""
    channels = mapping["channels"]
    rows = []
    for key in (*KEYS, *(key for key in TARGETS if key in channels and key not in KEYS)):
        source, rationale = channels.get(key), rationales.get(key, {})
        way = source["derivation"] if source else ""
        rows.append(
            {
                "target": TARGETS[key],
                "source": source,
                "derived": DERIVATIONS[way].title if way in DERIVATIONS else way,
                "confidence": rationale.get("confidence") if source else None,
                "reasons": list(rationale.get("reasons", ())),
            }
        )
    return rows


def notes(*given: Iterable[str], apart_from: Iterable[str] = ()) -> tuple[list[str], int]:
    """The notes, each once and the first MOST_NOTES of them, and how many more there are."""
    told = set(apart_from)
    distinct = [note for note in dict.fromkeys(chain(*given)) if note not in told]
    return distinct[:MOST_NOTES], max(len(distinct) - MOST_NOTES, 0)
