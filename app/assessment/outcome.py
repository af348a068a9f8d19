"""The outcome of a manoeuvre: its first exceedance, whether an alert came in time; and what exceeds
limits outside every manoeuvre."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import floor, nan
from operator import attrgetter, itemgetter
from typing import Any, Literal, NamedTuple

import numpy as np

from app.assessment.limits_history import InForceTimeline
from app.assessment.trim import TrimSteps
from app.telemetry.recording import GAP_RATIO, Trace, Traces
from core.channels import Dictionary
from core.limits.exceedance import NOT_PLAUSIBLE, SAME_TIME, TRIM_UNKNOWN, beyond
from core.limits.limits import Envelope, exceeded_end, shares_of
from core.types import Array, Flags, Indices

Outcome = Literal[
    "timely_alert",
    "late_alert",
    "missed",
    "false_alert",
    "quiet",
    "cut",
    "aborted",
    "unseen",
    "invalid",
    "unknown",
    "unassessed",
]
Alerts = tuple[tuple[float, float], ...]
OutcomeLevel = Literal["ok", "caution", "alert", "off"]


class Wording(NamedTuple):
    """How every view shows an outcome: its sign, a short word, how urgent it is, and a sentence."""

    sign: str
    word: str
    level: OutcomeLevel
    text: str


OUTCOMES: dict[Outcome, Wording] = {
    "timely_alert": Wording(
        "▲", "LIMIT EXCEEDED, warned in time", "caution", "limit exceeded, warned in time"
    ),
    "late_alert": Wording(
        "▲", "LIMIT EXCEEDED, warned too late", "alert", "limit exceeded, warned too late"
    ),
    "missed": Wording("▲", "LIMIT EXCEEDED, no warning", "alert", "limit exceeded, no warning"),
    "false_alert": Wording("◆", "FALSE ALERT", "caution", "alert, no limit exceeded"),
    "quiet": Wording("✓", "QUIET", "ok", "no alert, no limit exceeded"),
    "cut": Wording(
        "◇", "ENDS WITHIN THE MANOEUVRE", "caution", "ends within the manoeuvre, no verdict"
    ),
    "aborted": Wording(
        "◆", "ABORTED AFTER THE ALERT", "caution", "aborted after the alert, no verdict"
    ),
    "unseen": Wording("◇", "DATA MISSING", "caution", "data missing, no verdict"),
    "invalid": Wording("✕", "INVALID", "off", "INVALID, no verdict"),
    "unknown": Wording(
        "◆", "UNKNOWN", "caution", "unknown: the monitor does not record its limits"
    ),
    "unassessed": Wording("◇", "NOT ASSESSED", "off", "not assessed: no manoeuvre was flown"),
}
EXCEEDED = "LIMIT EXCEEDED"
OUTSIDE = f"{EXCEEDED} outside every manoeuvre, where nothing was assessed"
WITHOUT_VERDICT: tuple[Outcome, ...] = (
    *("cut", "aborted", "unseen", "invalid", "unknown", "unassessed"),
)
UNWARNED: tuple[Outcome, ...] = ("invalid", "unseen")
"""Exceedances that are neither missed nor warned: the monitor was withdrawn or had no data."""
OBSERVATIONS, LIMITS = "observations within training", "limits in force"
"""Checks of validity that a live flight makes too: the first needs a calibrated support, the second
is that the limits in force are the monitor's own."""


@dataclass(frozen=True)
class RecordedExceedance:
    """The first recorded sample that exceeds a limit. t: [s].   value: from trim, in its unit.

    limit: the limit exceeded where a limit set was in force; None for the monitor's own.
    doubt: of one as recorded: NOT_PLAUSIBLE, TRIM_UNKNOWN, or none; outside every manoeuvre one of
    OUTSIDE_DOUBTS.   arrived: when the sample of a live flight arrived [s]; None where unknown.
    """

    t: float
    channel: str
    value: float
    limit: float | None = None
    doubt: str = ""
    arrived: float | None = None


@dataclass(frozen=True)
class OutsideExceedance(RecordedExceedance):
    """One outside every manoeuvre. worst_t, worst: its sample furthest beyond the limit."""

    worst_t: float | None = None
    worst: float | None = None


class Hole(NamedTuple):
    """Times between which a channel has no sample [s].   lost: beyond one usual step [s]."""

    channel: str
    start: float
    end: float
    lost: float


class Peak(NamedTuple):
    """The value of a limited channel furthest towards a limit, from trim and as recorded.

    largest: from trim, which is judged; None where no value or no trim is known.
    low, high: limits, infinite for none.   recorded: NaN where no value is known.
    bias: removed by the mapping.
    """

    channel: str
    largest: float | None
    low: float
    high: float
    recorded: float
    bias: float = 0.0

    def is_beyond(self, value: float) -> bool:
        return not self.low < value < self.high


class Limited(NamedTuple):
    """The recorded samples of the limited channels between two times, against the limits.

    lost: seconds without samples, in the worst channel.   holes: in every limited channel.
    as_recorded: the first sample that exceeds a limit as recorded, with its bias and trim.
    failed: the first sample of these that no aircraft can reach.
    implausible: channel and time [s] of the first such value, within the limits or not.
    worst: of each channel that exceeds a limit, the sample furthest beyond it: from trim, or as
    recorded if none is.   worst_recorded: those as recorded that are further beyond.
    """

    exceedance: RecordedExceedance | None
    peaks: tuple[Peak, ...]
    lost: float
    holes: tuple[Hole, ...] = ()
    as_recorded: RecordedExceedance | None = None
    failed: RecordedExceedance | None = None
    implausible: tuple[str, float] | None = None
    worst: tuple[RecordedExceedance, ...] = ()
    worst_recorded: tuple[RecordedExceedance, ...] = ()

    @property
    def recorded(self) -> RecordedExceedance | None:
        """The exceedance as recorded that is named beside the first from trim, or without one."""
        first, raw = self.exceedance, self.failed or self.as_recorded
        if first is None:
            return self.as_recorded
        return raw if raw and (raw is self.failed or raw.t < first.t - SAME_TIME) else None


def against_limits(
    traces: Traces,
    dictionary: Dictionary,
    limits: Envelope,
    trim: TrimSteps,
    start: float,
    end: float,
    timeline: InForceTimeline | None = None,
) -> Limited:
    """Judge the recorded samples, not those resampled for the monitor.

    traces: repaired.   start, end: [s], both included.
    timeline: limits in force over time, instead of `limits`; each gets its own peak.
    """
    exceedances, raw, failed = (list[RecordedExceedance | None]() for _ in range(3))
    worst, worst_recorded = list[RecordedExceedance](), list[RecordedExceedance]()
    peaks, holes, implausible = list[Peak](), list[Hole](), list[tuple[float, str]]()
    in_force = [limits] if timeline is None else timeline.during(start, end)
    limited = np.logical_or.reduce([each.limited for each in in_force])
    for c in np.flatnonzero(limited).tolist():
        key, rest = dictionary.keys[c], float(limits.rest[c])
        ends = dict.fromkeys(
            (float(each.low[c]), float(each.high[c])) for each in in_force if each.limited[c]
        )
        if timeline is not None and key not in traces.channels:
            peaks += [Peak(key, None, *each, nan) for each in ends]
            continue
        trace = traces.channels[key]
        part = slice(*np.searchsorted(trace.t, (start - SAME_TIME, end + SAME_TIME)).tolist())
        known = np.isfinite(trace.values[part])
        t, values = trace.t[part][known], trace.values[part][known]
        low, high = _ends_at(t, c, limits, timeline)
        is_named, subtracted = timeline is not None, trim.of_channel(c, t)
        arrived = None if traces.arrived is None else traces.arrived[part][known]
        from_trim = _Judged(key, t, values - subtracted, low, high, is_named, "", arrived)
        unknown = np.isnan(subtracted)
        recorded = from_trim._replace(value=values + trace.bias, trim_unknown=unknown)
        exceedances.append(from_trim.first)
        raw.append(recorded.first)
        raw_worst = [recorded.worst(rest)]
        if trace.sent is not None and (odd := ~known & np.isfinite(trace.sent[part])).any():
            at, sent = trace.t[part][odd], trace.sent[part][odd]
            implausible.append((float(at[0]), key))
            then = _ends_at(at, c, limits, timeline)
            is_odd = _Judged(key, at, sent, *then, is_named, NOT_PLAUSIBLE)
            failed.append(is_odd.first)
            raw_worst.append(is_odd.worst(rest))
        furthest = from_trim.worst(rest)
        as_is = max(filter(None, raw_worst), key=itemgetter(0), default=None)
        if named := furthest or as_is:
            worst.append(named[1])
        if furthest and as_is and as_is[0] > furthest[0]:
            worst_recorded.append(as_is[1])
        for each in ends:
            here = (low == each[0]) & (high == each[1])
            if len(t) and not here.any():
                continue
            value = from_trim.value
            largest = _furthest(value[here & np.isfinite(value)], *each, rest)
            as_recorded = _furthest(recorded.value[here], *each, rest)
            as_recorded = nan if as_recorded is None else as_recorded
            peaks.append(Peak(key, largest, *each, as_recorded, trace.bias))
        holes += holes_in(key, t, start, end)
    first, first_raw, first_failed = (
        min(filter(None, results), key=attrgetter("t"), default=None)
        for results in (exceedances, [*raw, *failed], failed)
    )
    odd_t, odd_key = min(implausible, default=(0.0, ""))
    doubted = (odd_key, odd_t) if odd_key else None
    about = tuple(peaks), lost_in(holes), tuple(holes)
    of_channels = tuple(worst), tuple(worst_recorded)
    return Limited(first, *about, first_raw, first_failed, doubted, *of_channels)


class _Judged(NamedTuple):
    """Samples of a channel against its limits, (n,) each.

    is_named: whether an exceedance names its limit.   doubt, arrived: see RecordedExceedance.
    trim_unknown: where an exceedance is one as recorded; None for nowhere.
    """

    key: str
    t: Array
    value: Array
    low: Array
    high: Array
    is_named: bool
    doubt: str = ""
    arrived: Array | None = None
    trim_unknown: Flags | None = None

    def exceedance(self, i: int) -> RecordedExceedance:
        """That of sample i."""
        t, value, low, high = (float(each[i]) for each in self[1:5])
        limit = exceeded_end(low, high, value) if self.is_named else None
        arrived = None if self.arrived is None else self.arrived.item(i)
        doubt = self.doubt
        if not doubt and self.trim_unknown is not None and self.trim_unknown[i]:
            doubt = TRIM_UNKNOWN
        return RecordedExceedance(t, self.key, value, limit, doubt, arrived)

    @property
    def over(self) -> Indices:
        return beyond(self.value, self.low, self.high)

    @property
    def first(self) -> RecordedExceedance | None:
        over = self.over
        return self.exceedance(over[0]) if len(over) else None

    def worst(self, rest: float) -> tuple[float, RecordedExceedance] | None:
        """Share of the way to the limit of the sample furthest beyond, and that sample."""
        if not len(over := self.over):
            return None
        shares = shares_of(self.value[over], self.low[over], self.high[over], rest)
        return float(shares.max()), self.exceedance(over[shares.argmax()])


def _ends_at(
    t: Array, c: int, limits: Envelope, timeline: InForceTimeline | None
) -> tuple[Array, Array]:
    """(n,) low and high limit of channel c at each time."""
    if timeline is not None:
        at = timeline.at(t)
        return at.low[:, c], at.high[:, c]
    return np.full(len(t), limits.low[c]), np.full(len(t), limits.high[c])


def _furthest(values: Array, low: float, high: float, rest: float) -> float | None:
    """The value with the largest share of the way from rest to a limit; None without values."""
    if not len(values):
        return None
    return float(values[shares_of(values, low, high, rest).argmax()])


def lost_in(holes: Sequence[Hole]) -> float:
    """Time without samples, in the worst channel [s]."""
    lost = dict.fromkeys([hole.channel for hole in holes], 0.0)
    for hole in holes:
        lost[hole.channel] += hole.lost
    return max(lost.values(), default=0.0)


def holes_in(key: str, t: Array, start: float, end: float, step: float | None = None) -> list[Hole]:
    """Holes of a channel between start and end.

    t: (n,) times of its samples.   step: between these [s]; None for their usual one.
    """
    if len(t) < 2:
        return [Hole(key, start, end, end - start)]
    step = float(np.median(np.diff(t))) if step is None else step
    edges = np.concatenate([[start], t, [end]])
    steps = np.diff(edges)
    return [
        Hole(key, float(edges[i]), float(edges[i + 1]), float(steps[i] - step))
        for i in np.flatnonzero(steps > GAP_RATIO * step)
    ]


def runs(flags: Flags) -> list[tuple[int, int]]:
    """First and last sample of each run of true."""
    edges = np.flatnonzero(np.diff(flags.view(np.int8), prepend=0, append=0)).reshape(-1, 2)
    return [(begin, end - 1) for begin, end in edges.tolist()]


def alert_times(t: Array, alert: Flags) -> Alerts:
    """First and last time of each run of alerts [s]."""
    return tuple((float(t[first]), float(t[last])) for first, last in runs(alert))


def outcome(
    alerts: Alerts,
    exceedance: RecordedExceedance | None,
    promised: float,
    *,
    is_cut: bool = False,
    calls: Sequence[float] = (),
) -> tuple[Outcome, float | None]:
    """The outcome of a manoeuvre, and the lead from the first alert to the exceedance [s].

    promised: lead in effect [s]. An exceedance without an alert before it is a miss.
    is_cut: samples end within the manoeuvre; a limit may have been exceeded after them.
    calls: times of ABORT and KNOCK IT OFF [s].
    """
    if exceedance is None and is_cut:
        is_aborted = alerts and any(t >= alerts[0][0] - SAME_TIME for t in calls)
        return ("aborted" if is_aborted else "cut"), None
    if exceedance is None:
        return ("false_alert" if alerts else "quiet"), None
    if not alerts or alerts[0][0] > exceedance.t + SAME_TIME:
        return "missed", None
    lead = exceedance.t - alerts[0][0]
    return ("timely_alert" if lead >= promised - SAME_TIME else "late_alert"), lead


def lasting(alerts: Alerts, invalid_t: float, exceeded_t: float, promised: float) -> Alerts:
    """Alerts that warn of an exceedance: the monitor stayed valid until it, or for the lead.

    An alert that is withdrawn sooner may come from what made the monitor invalid, and its crew had
    no lead to act on it.   invalid_t: when the monitor last became invalid; infinite if it is valid
    at the exceedance.   exceeded_t, promised: [s].
    """
    if invalid_t >= exceeded_t:
        return alerts
    return tuple(each for each in alerts if each[0] + promised <= invalid_t + SAME_TIME)


def warned_at(alert_t: float, shown: float, exceeded_t: float, arrived: float) -> float:
    """Time that an alert counts from [s]: when it was shown, however old its sample was by then.

    alert_t, exceeded_t: of the samples [s].   shown: of the alert, by another clock [s].   arrived:
    when the exceedance arrived, or would have without lag, by that clock [s].
    """
    return max(alert_t, exceeded_t - (arrived - shown))


def lead_words(lead: float) -> str:
    """`1.34`: a lead in seconds, rounded down so that it never overstates."""
    return f"{floor(100.0 * (lead + SAME_TIME)) / 100.0:.2f}"


def warning_words(outcome: Outcome, lead: float | None, promised: float | None = None) -> str:
    """How early the alert came: `warned 0.45 s before the limit`.

    lead: [s] from the first alert to it.   promised: lead time of the monitor [s], named where the
    alert was late; None where unknown.
    """
    if outcome in UNWARNED:
        return OUTCOMES[outcome].text
    if lead is None or outcome not in ("timely_alert", "late_alert"):
        return "missed: no alert before the limit"
    ahead = f"{lead_words(lead)} s before the limit"
    if outcome == "timely_alert":
        return f"warned {ahead}"
    late = f"warned too late, {ahead}"
    return late if promised is None else f"{late} ({promised:.4g} s promised)"


def exceedance_verdict(outcome: Outcome, lead: float | None, promised: float | None = None) -> str:
    """The verdict on an exceedance from trim, worded alike in every view. See warning_words."""
    if outcome == "unassessed":
        return OUTSIDE
    return f"{EXCEEDED}, {warning_words(outcome, lead, promised)}"


def wording_of(manoeuvre: Mapping[str, Any]) -> Wording:
    """The wording of a stored manoeuvre (plain data); an exceedance comes first.

    What was shown in flight stays; a check of the whole manoeuvre that fails is said after it.
    """
    sign, word, level, text = wording = _as_shown(manoeuvre)
    checks = manoeuvre["validity"].get("checks", ())
    failed = [each for each in checks if each["ok"] is False]
    failed = [each["text"] for each in failed if each["name"] not in (OBSERVATIONS, LIMITS)]
    if not failed or manoeuvre["outcome"] in WITHOUT_VERDICT:
        return wording
    sign, level = ("◆", "caution") if level == "ok" else (sign, level)
    return Wording(sign, f"{word}; NO GUARANTEE", level, f"{text}; no guarantee: {failed[0]}")


def _as_shown(manoeuvre: Mapping[str, Any]) -> Wording:
    wording = OUTCOMES[manoeuvre["outcome"]]
    verdict = verdict_of(manoeuvre)
    if not verdict:
        return wording
    if manoeuvre["exceedance"] is None and not verdict.endswith(NOT_PLAUSIBLE):
        word, text = f"{verdict}; {wording.word}", f"{verdict}; {wording.text}"
        level: OutcomeLevel = "caution" if wording.level in ("ok", "off") else wording.level
        return Wording("◆", word, level, text)
    is_timely = manoeuvre["outcome"] == "timely_alert"
    return Wording("▲", verdict, "caution" if is_timely else "alert", verdict)


def begins_in_words(manoeuvre: Mapping[str, Any]) -> str:
    """When a stored manoeuvre begins, and its trim segment; "" where that was not detected."""
    begins, start = manoeuvre.get("begins"), manoeuvre["start"]
    if begins is None:
        return ""
    return f"begins {begins:.2f} s" + (f" (trim from {start:.2f} s)" if start < begins else "")


def verdict_of(manoeuvre: Mapping[str, Any], promised: float | None = None) -> str:
    """The verdict on the exceedance of a manoeuvre (by field); "" where there was none.

    promised: of scorings by earlier versions, which do not have it [s].
    """
    raw = manoeuvre.get("recorded_exceedance")
    if manoeuvre["exceedance"] is not None:
        promised = manoeuvre.get("promised", promised)
        text = exceedance_verdict(manoeuvre["outcome"], manoeuvre["lead"], promised)
        t = manoeuvre["exceedance"]["t"]
        return text if raw is None else after_recorded(text, t, raw["t"], raw.get("doubt", ""))
    return "" if raw is None else recorded_verdict(raw.get("doubt", ""))


def recorded_verdict(doubt: str) -> str:
    """The verdict on an exceedance as recorded. doubt: see RecordedExceedance."""
    if doubt == NOT_PLAUSIBLE:
        return f"{EXCEEDED}, {doubt}"
    return f"{EXCEEDED} as recorded, {doubt or 'not from trim'}"


def after_recorded(text: str, t: float, recorded_t: float, doubt: str) -> str:
    """The verdict on an exceedance from trim at t [s], naming one as recorded that came before.

    Less than APART before, they are one exceedance.
    """
    if recorded_t > t - APART:
        return text
    first = recorded_verdict(doubt).replace(EXCEEDED, f"{EXCEEDED} first at {recorded_t:.2f} s", 1)
    return f"{first}, and from trim at {t:.2f} s{text.removeprefix(EXCEEDED)}"


APART = 1.0
"""[s] Samples beyond a limit that lie closer together are one exceedance."""
BLOCK = 65_536
"""Samples processed at a time."""
MANY = 3
"""This many exceedances of one channel suggest a fault in its mapping."""
MOST_OUTSIDE = 1000
"""Exceedances that are stored; the note counts all."""
OUTSIDE_DOUBTS = "", "as recorded, not from trim", TRIM_UNKNOWN, NOT_PLAUSIBLE
"""Why an exceedance outside every manoeuvre is not one from trim; empty if it is."""
FROM_TRIM, AS_RECORDED = 0, 1


def exceedances_outside(
    traces: Traces,
    dictionary: Dictionary,
    limits: Envelope,
    intervals: Sequence[tuple[float, float]],
    trim: TrimSteps,
    timeline: InForceTimeline | None = None,
) -> tuple[RecordedExceedance, ...]:
    """The first recorded sample of each exceedance that begins outside all manoeuvres.

    traces: repaired.   intervals: start and end of each manoeuvre, in order [s].
    timeline: limits in force over time, instead of `limits`.
    An exceedance that begins in a manoeuvre and outlasts it belongs to that manoeuvre.
    """
    starts, ends = np.array(intervals, np.float64).T
    exceedances = []
    in_force = limits if timeline is None else timeline.limits
    for c in np.flatnonzero(in_force.limited).tolist():
        key = dictionary.keys[c]
        if key not in traces.channels:
            continue
        over = _all_over(traces.channels[key], c, limits, trim, timeline)
        number = np.maximum(np.searchsorted(starts - SAME_TIME, over.t, "right") - 1, 0)
        inside = (over.t >= starts[number] - SAME_TIME) & (over.t <= ends[number] + SAME_TIME)
        shares = shares_of(over.value, over.low, over.high, float(limits.rest[c]))
        begins = np.flatnonzero(np.diff(over.t, prepend=-np.inf) > APART)
        for begin, stop in pairwise([*begins.tolist(), len(over.t)]):
            if inside[begin]:
                continue
            from_trim = begin + np.flatnonzero(over.doubt[begin:stop] == FROM_TRIM)
            rows = from_trim if len(from_trim) else np.arange(begin, stop)
            first, at = int(rows[0]), int(rows[shares[rows].argmax()])
            doubt = OUTSIDE_DOUBTS[int(over.doubt[first])]
            about = over.t, over.value, over.low, over.high, timeline is not None, doubt
            begun = _Judged(key, *about).exceedance(first)
            worst_t, worst = float(over.t[at]), float(over.value[at])
            exceedances.append(OutsideExceedance(**vars(begun), worst_t=worst_t, worst=worst))
    return tuple(sorted(exceedances, key=lambda exceedance: exceedance.t))


class _Over(NamedTuple):
    """Samples (n,) of a channel that exceed a limit, from trim or else as recorded.

    doubt: number in OUTSIDE_DOUBTS.
    """

    t: Array
    value: Array
    low: Array
    high: Array
    doubt: Indices


def _all_over(
    trace: Trace, c: int, limits: Envelope, trim: TrimSteps, timeline: InForceTimeline | None
) -> _Over:
    parts = []
    for first in range(0, len(trace.t), BLOCK):
        t, values = trace.t[first : first + BLOCK], trace.values[first : first + BLOCK]
        low, high = _ends_at(t, c, limits, timeline)
        from_trim, recorded = values - trim.of_channel(c, t), values + trace.bias
        doubt = np.where(np.isnan(from_trim), OUTSIDE_DOUBTS.index(TRIM_UNKNOWN), AS_RECORDED)
        if trace.sent is not None:
            sent = trace.sent[first : first + BLOCK]
            odd = np.isnan(values) & np.isfinite(sent)
            recorded = np.where(odd, sent, recorded)
            doubt[odd] = OUTSIDE_DOUBTS.index(NOT_PLAUSIBLE)
        judged = beyond(from_trim, low, high)
        value = recorded
        value[judged], doubt[judged] = from_trim[judged], FROM_TRIM
        over = beyond(value, low, high)
        parts.append([part[over] for part in (t, value, low, high, doubt)])
    return _Over(*map(np.concatenate, zip(*parts, strict=True)))


def notes_on_outside(
    exceedances: Sequence[RecordedExceedance], dictionary: Dictionary
) -> tuple[str, ...]:
    """Notes on exceedances outside the manoeuvres, for people; empty without any."""
    if not exceedances:
        return ()
    first = exceedances[0]
    value = dictionary.by_key[first.channel].read(first.value)
    times = "once" if len(exceedances) == 1 else f"{len(exceedances)} times, first"
    doubt = f", {first.doubt}" if first.doubt else ""
    counts = Counter(exceedance.channel for exceedance in exceedances)
    return (
        *(_suspicion(channel, n) for channel, n in counts.items() if n >= MANY),
        f"Limit exceeded outside every manoeuvre, where nothing is assessed: {times} "
        f"{first.channel} {value} at {first.t:.2f} s{doubt}.",
    )


def _suspicion(channel: str, n: int) -> str:
    return (
        f"{channel} exceeded its limit {n} times outside every manoeuvre: before you trust any "
        f"verdict, check the signal, unit, sign and offset in the mapping of {channel}."
    )
