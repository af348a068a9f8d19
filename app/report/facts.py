"""The facts of a report on a scored flight, before they become a page."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from math import inf
from typing import Any

from app.assessment.outcome import OUTCOMES, OUTSIDE, OutcomeLevel, wording_of
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.mapping.mapping import ChannelSource
from app.telemetry.targets import as_mapped, in_order, target_of
from core.channels import Channel, Dictionary
from core.limits.exceedance import NOT_PLAUSIBLE
from core.limits.limits import (
    Envelope,
    Specification,
    envelope_of,
    specification_from_plain,
)
from core.monitor.validity.flown_input import amplitude_in_words

Plain = Mapping[str, Any]

LOOKS: dict[OutcomeLevel, str] = {"ok": "good", "alert": "bad", "off": "invalid"}
"""Style of a level; of others, the level itself."""
BY_INTEREST = (
    "missed",
    "late_alert",
    "unseen",
    "aborted",
    "cut",
    "false_alert",
    "timely_alert",
    "invalid",
    "unknown",
    "unassessed",
    "quiet",
)
"""Outcomes in the order in which their manoeuvres are drawn."""
MOST_DRAWN = 100
"""Manoeuvres that get a figure."""
MOST_NOTES = 40
NONE_EXCEEDED = "No limit was exceeded"


def outcome_of(manoeuvre: Plain) -> tuple[str, str, str]:
    """Sign, words and style of the outcome of a manoeuvre; an exceedance comes first."""
    sign, _, level, text = wording_of(manoeuvre)
    return sign, text, LOOKS.get(level, level)


def headline(manoeuvres: Sequence[Plain], outside: Sequence[Plain] = ()) -> tuple[str, str]:
    """Level and words for the whole flight, by its worst event.

    outside: exceedances outside the manoeuvres.
    """
    invalid = [s for s in manoeuvres if _is_invalid(s)]
    exceeded = [s for s in invalid if s["exceedance"]]
    level, words = _of_valid([s for s in manoeuvres if not _is_invalid(s)])
    if exceeded and level != "bad":
        level, words = _of_exceeded_invalid(exceeded)
    n, total = len(invalid), len(manoeuvres)
    if 0 < n < total:
        consequence = "no guarantee for" if exceeded else "no verdict on"
        words += f"; {n} of the {total} manoeuvres {'is' if n == 1 else 'are'} not valid, "
        words += f"{consequence} {'it' if n == 1 else 'them'}"
    raw = [(each, m["exceedance"]) for m in manoeuvres if (each := m.get("recorded_exceedance"))]
    doubts = {each.get("doubt", "") for each in (*(each for each, _ in raw), *outside)}
    plausible = [later for each, later in raw if each.get("doubt", "") != NOT_PLAUSIBLE]
    as_recorded = not all(plausible)
    if level == "good" and (invalid or as_recorded or outside):
        level = "caution"
    if as_recorded:
        words = words.replace(NONE_EXCEEDED, f"{NONE_EXCEEDED} from trim")
        words += "; a limit was exceeded as recorded, not from trim"
    if any(plausible):
        words += "; as recorded, a limit was exceeded before it was from trim"
    if outside and any(manoeuvre["exceedance"] for manoeuvre in manoeuvres):
        words += "; one was also exceeded outside every manoeuvre"
    elif outside:
        words = words.replace(NONE_EXCEEDED, f"{NONE_EXCEEDED} in a manoeuvre")
        words += "; a limit was exceeded outside every manoeuvre"
    if NOT_PLAUSIBLE in doubts:
        level, words = "bad", f"{words}; a limit was exceeded {NOT_PLAUSIBLE}"
    return level, words


def _of_exceeded_invalid(exceeded: Sequence[Plain]) -> tuple[str, str]:
    """Headline of invalid manoeuvres; an alert before the withdrawal counts."""
    warned = {"timely_alert": ("caution", "in time"), "late_alert": ("bad", "too late")}
    outcomes, first = {s["outcome"] for s in exceeded}, exceeded[0]
    if outcomes == {"missed"}:
        return "bad", "A limit was exceeded without an alert and without a guarantee"
    if len(outcomes) > 1 or not outcomes <= warned.keys():
        return "bad", "A limit was exceeded where the monitor is not applicable"
    level, when = warned[outcomes.pop()]
    if (t := first.get("withdrawn_t")) is None:
        return level, f"A limit was exceeded, warned {when}, without a guarantee"
    words = f"A limit was exceeded, warned {when} before the monitor was withdrawn"
    return level, f"{words} at {t:.2f} s ({first['withdrawn_reason']})"


def _is_invalid(manoeuvre: Plain) -> bool:
    return manoeuvre["validity"]["valid"] is False or manoeuvre["outcome"] == "invalid"


def _of_valid(manoeuvres: Sequence[Plain]) -> tuple[str, str]:
    if not manoeuvres:
        return "invalid", "No verdict: the monitor is not applicable"
    n = counts(manoeuvres)
    if n["unknown"]:
        return "caution", "Unknown: the monitor does not record its limits"
    if n["unassessed"]:
        is_exceeded = any(s["exceedance"] for s in manoeuvres)
        words = OUTSIDE if is_exceeded else OUTCOMES["unassessed"].text
        return "bad" if is_exceeded else "invalid", words.capitalize()
    if n["missed"] or n["late_alert"]:
        return "bad", "A limit was exceeded without a timely alert"
    unseen = [s for s in manoeuvres if s["outcome"] == "unseen"]
    if any(s["exceedance"] for s in unseen):
        return "bad", "A limit was exceeded where samples are missing: no verdict on alerts"
    if unseen:
        return "caution", "Samples are missing: a limit may have been exceeded"
    if not n["timely_alert"] and (n["cut"] or n["aborted"]):
        why = "Samples end within a manoeuvre" if n["cut"] else "Aborted after the alert"
        return "caution", f"{why}: no verdict"
    unchecked = any(s["validity"]["valid"] is None for s in manoeuvres)
    level = "caution" if n["false_alert"] or unchecked else "good"
    if n["timely_alert"]:
        return "caution", "A limit was exceeded; every exceedance had a timely alert"
    of = amplitude_in_words([s["amplitude"] for s in manoeuvres if s.get("amplitude")])
    if n["false_alert"]:
        return level, f"{NONE_EXCEEDED}, but there was an alert{of}"
    return level, f"{NONE_EXCEEDED}, and there was no alert{of}"


def counts(manoeuvres: Sequence[Plain]) -> dict[str, int]:
    return {name: sum(s["outcome"] == name for s in manoeuvres) for name in OUTCOMES}


def worst(manoeuvres: Sequence[Plain]) -> list[tuple[str, str]]:
    """Names of the manoeuvres to check first, each with its outcome in words."""
    return [
        (manoeuvre["name"], outcome_of(manoeuvre)[1])
        for manoeuvre in manoeuvres
        if (outcome := manoeuvre["outcome"]) in ("missed", "late_alert", "unseen", "cut", "aborted")
        or (outcome == "invalid" and manoeuvre["exceedance"])
    ]


def alerts(manoeuvres: Sequence[Plain]) -> list[dict[str, Any]]:
    """One row for each alert.

    first: of its manoeuvre.   exceeds: whether that manoeuvre exceeds a limit.
    lead: from the alert to the exceedance [s]; None where none follows.
    """
    return [
        {
            "number": number,
            "name": manoeuvre["name"],
            "start": begin,
            "end": end,
            "first": begin == manoeuvre["alerts"][0][0],
            "exceeds": exceedance is not None,
            "lead": exceedance["t"] - begin if exceedance and exceedance["t"] >= begin else None,
        }
        for number, manoeuvre in enumerate(manoeuvres, 1)
        for exceedance in [manoeuvre["exceedance"]]
        for begin, end in manoeuvre["alerts"]
    ]


def exceeded_own(
    manoeuvres: Sequence[Plain], key: str, low: float, high: float
) -> list[tuple[Plain, Plain]]:
    """Manoeuvres that exceed limits of the monitor's own, each with its exceedance."""
    return [
        (manoeuvre, exceedance)
        for manoeuvre in manoeuvres
        if (exceedance := manoeuvre.get("own_exceedance") or manoeuvre["exceedance"])
        and exceedance["channel"] == key
        and not low < exceedance["value"] < high
    ]


def limits_in_force(
    dictionary: Dictionary, in_force: Sequence[Plain], manoeuvres: Sequence[Plain]
) -> list[dict[str, Any]]:
    """Limits of a set in force over time, and the manoeuvres that first exceeded them."""
    rows = []
    for interval in in_force:
        case = interval["case"] or "flight condition unknown"
        name = f"{interval['name']} version {interval.get('version')}, {case}"
        if "monitor_name" in interval:
            used = interval["monitor_name"] or "no monitor in use"
            name = f"{used}, {interval['case'] or interval['reason']}"
        exceeded = [
            manoeuvre
            for manoeuvre in manoeuvres
            if (first := manoeuvre["exceedance"])
            and interval["start"] <= first["t"] < interval["end"]
        ]
        specification = specification_from_plain(interval["limits"] or None, dictionary)
        limits = limited(dictionary, specification)
        rows.append(dict(interval) | {"limits": limits, "words": name, "exceeded": exceeded})
    return rows


def limited(
    dictionary: Dictionary, specification: Specification
) -> list[tuple[Channel, float, float]]:
    """The channels with limits, each with its least and greatest safe value."""
    limits = envelope_of(specification) or Envelope.unlimited(len(dictionary))
    ends = zip(dictionary.channels, limits.low.tolist(), limits.high.tolist(), strict=True)
    return [each for each in ends if each[1:] != (-inf, inf)]


def drawn(manoeuvres: Sequence[Plain]) -> set[int]:
    """Positions of the manoeuvres to draw: all, or the most interesting ones."""
    order = sorted(
        range(len(manoeuvres)), key=lambda k: (BY_INTEREST.index(manoeuvres[k]["outcome"]), k)
    )
    return set(order[:MOST_DRAWN])


def mapping_rows(
    mapping: Plain, rationales: Mapping[str, Plain], dictionary: Dictionary
) -> list[dict[str, Any]]:
    """One row for each channel with its source; None where it is missing.

    dictionary: of the monitor; its channels come first.
    """
    channels = mapping["channels"]
    needed = {known.key: as_mapped(known) for known in dictionary.channels}
    rows = []
    for key in (*needed, *(key for key in in_order(channels) if key not in needed)):
        source, rationale = channels.get(key), rationales.get(key, {})
        way = source["derivation"] if source else ""
        rows.append(
            {
                "target": needed.get(key) or target_of(key, source["unit"]),
                "source": source,
                "scaled": str(ChannelSource(**source).scaling) if source else "",
                "derived": DERIVATIONS[way].title if way in DERIVATIONS else way,
                "confidence": rationale.get("confidence") if source else None,
                "reasons": list(rationale.get("reasons", ())),
            }
        )
    return rows


def notes(*given: Iterable[str], apart_from: Iterable[str] = ()) -> tuple[list[str], int]:
    """The first MOST_NOTES distinct notes, and the number of the others."""
    excluded = set(apart_from)
    distinct = [note for note in dict.fromkeys(chain(*given)) if note not in excluded]
    return distinct[:MOST_NOTES], max(len(distinct) - MOST_NOTES, 0)
