"""The limits in force while a recording was flown, from the records of its flight."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise
from typing import Any, NamedTuple, Self

import numpy as np

from app.assessment.monitors_in_use import MonitorRuling, MonitorsInUse, MonitorsRule
from app.assessment.rulings import (
    CONDITION_VALID_S,
    ROUNDING,
    LimitsInForce,
    LimitsRule,
    LimitsRuling,
    Ruling,
)
from app.telemetry.contents import Columns
from app.telemetry.mapping.mapping import Mapping as ChannelMapping
from app.telemetry.mapping.mapping import TimeSource
from app.telemetry.recording import TelemetryError
from app.telemetry.units import convert
from core.channels import KEYS, LATERAL, Dictionary
from core.conditions import (
    CONDITION_KEYS,
    CONDITIONS,
    IMPLAUSIBLE,
    MISSING,
    STALE,
    Condition,
    ConditionKey,
)
from core.limits.exceedance import SAME_TIME
from core.limits.limits import (
    Envelope,
    envelope_of,
    specification_from_plain,
    specification_to_plain,
)
from core.monitor import Monitor
from core.types import Array, Flags, Indices

KNOWN = ""


class ConditionSeries(NamedTuple):
    """One channel of the flight condition as sent: t (n,) increasing [s], values (n,)."""

    t: Array
    values: Array


@dataclass(frozen=True, eq=False)
class LimitsHistory:
    """The limit sets put in force during a flight, and the flight condition.

    A version applies to samples after its time; the first version of a flight to all samples.
    A condition value applies until the next one of its channel, for at most CONDITION_VALID_S.
    """

    versions: tuple[LimitsInForce, ...]
    measured: dict[str, ConditionSeries]

    @classmethod
    def of(cls, columns: Columns, mapping: ChannelMapping) -> Self | None:
        """Read it from a recording, on its mapping's times; None where no limit set was in force.

        TelemetryError if the record of limit sets is damaged.
        """
        contents = columns.contents
        if not contents.limits:
            return None
        try:
            versions = tuple(map(LimitsInForce.from_plain, contents.limits))
        except (KeyError, TypeError, ValueError, AttributeError):
            raise TelemetryError(
                "the limit sets in force are damaged: export the flight's journal again"
            ) from None
        return cls(versions, conditions_in(columns, mapping))

    def timeline(self, own: Sequence[Envelope | None]) -> "InForceTimeline":
        """Limits in force over time. own: limits of each monitor, alarm authority first."""
        begins = [-np.inf if v.seq == 0 else v.t + SAME_TIME for v in self.versions]
        each = (
            _ruled(LimitsRule(version, own), self.measured, begin, end)
            for version, (begin, end) in zip(
                self.versions, pairwise([*begins, np.inf]), strict=True
            )
        )
        starts, rulings, notes = _changes([(-np.inf, None, "")], *each)
        return InForceTimeline(starts, rulings, own[0], notes)


@dataclass(frozen=True, eq=False)
class SetHistory:
    """The monitor set to score a recording by, and the flight condition of the recording."""

    in_use: MonitorsInUse
    measured: dict[str, ConditionSeries]

    @classmethod
    def of(cls, columns: Columns, mapping: ChannelMapping, in_use: MonitorsInUse) -> Self:
        """With what the recorded flight declared, unless the set declares it itself."""
        declared = columns.contents.flown.get("declared", {}) | dict(in_use.fixed)
        return cls(replace(in_use, fixed=declared), conditions_in(columns, mapping))

    def timeline(self) -> "InForceTimeline":
        """Which monitor of the set is in use when, and its limits."""
        each = _ruled(MonitorsRule(self.in_use), self.measured, -np.inf, np.inf)
        starts, rulings, notes = _changes(each)
        n_channels = len(self.in_use.members[0].dictionary)
        return InForceTimeline(starts, rulings, None, notes, n_channels)


Ruled = tuple[float, Ruling | None, str]
"""A time [s], the ruling from it on, and what contradicts the declared condition there."""


def _ruled(
    rule: LimitsRule | MonitorsRule,
    measured: Mapping[str, ConditionSeries],
    begin: float,
    end: float,
) -> Iterator[Ruled]:
    """The ruling at `begin` [s] and at each later change of the condition before `end`."""
    for t, condition in conditions_over(measured, begin, end):
        ruling = rule.at(condition)
        yield t, ruling, rule.contradiction


def _changes(
    *parts: Iterable[Ruled],
) -> tuple[Array, tuple[Ruling | None, ...], tuple[str, ...]]:
    """Start [s] and ruling of each change, and a note on the first contradiction."""
    starts, rulings, notes = list[float](), list[Ruling | None](), tuple[str, ...]()
    for t, ruling, contradiction in chain.from_iterable(parts):
        if contradiction and not notes:
            notes = (f"At {t:.2f} s {contradiction}: the declared value applies.",)
        if not rulings or ruling is not rulings[-1]:
            starts.append(t)
            rulings.append(ruling)
    return np.array(starts), tuple(rulings), notes


def conditions_in(columns: Columns, mapping: ChannelMapping) -> dict[str, ConditionSeries]:
    """The channels of the flight condition in a recording, by key.

    Each by the name that its flight gave it, its key, or the signal mapped to it.
    """
    contents, mapped = columns.contents, mapping.channels
    known = {signal.name for signal in contents.signals}
    measured = {}
    for key in CONDITION_KEYS:
        channel = mapped.get("h" if key == "altitude" else key)
        names = contents.conditions.get(key, str(key)), channel.signal if channel else ""
        name = next((name for name in names if name in known), None)
        if name is not None:
            measured[key] = _measured(columns, mapping, name, CONDITIONS[key].unit)
    return measured


def conditions_over(
    measured: Mapping[str, ConditionSeries], begin: float, end: float
) -> list[tuple[float, Condition]]:
    """The measured condition at `begin` [s] and at each later change before `end`."""
    edges = [np.array([begin])]
    for series in measured.values():
        edges += [series.t - ROUNDING, np.nextafter(series.t + CONDITION_VALID_S, np.inf)]
    t = np.unique(np.concatenate(edges))
    t = t[(t >= begin) & (t < end)]
    columns = [_at(key, measured.get(key), t) for key in CONDITION_KEYS]
    changes = np.ones(len(t), bool)
    changes[1:] = np.logical_or.reduce(
        [(v[1:] != v[:-1]) | (words[1:] != words[:-1]) for v, words in columns]
    )
    return [
        (float(t[k]), tuple(str(w[k]) or float(v[k]) for v, w in columns))
        for k in np.flatnonzero(changes)
    ]


class InForceTimeline:
    """Which limits are in force when, and which monitors they suit.

    starts: (n,) increasing [s], the first -inf.   rulings: the ruling from each start on; None for
    the alarm authority's own limits.   own: those; None where unknown.   notes: for people.
    """

    def __init__(
        self,
        starts: Array,
        rulings: tuple[Ruling | None, ...],
        own: Envelope | None,
        notes: tuple[str, ...] = (),
        n_channels: int = len(KEYS),
    ):
        self.starts, self.rulings, self.notes = starts, rulings, notes
        self._known = [own if ruling is None else ruling.limits for ruling in rulings]
        each = [limits or Envelope.unlimited(n_channels) for limits in self._known]
        self.limits = Envelope(*map(np.array, zip(*each, strict=True)))
        """of each start, infinite where there is no limit or it is unknown"""
        self._silent = np.array([bool(ruling and ruling.reasons[0]) for ruling in rulings])

    def index(self, t: Array | float) -> Indices:
        return np.searchsorted(self.starts, t, "right") - 1

    def ruling(self, t: float) -> Ruling | None:
        """The ruling at a time [s]; None for the alarm authority's own limits."""
        return self.rulings[int(self.index(t))]

    def at(self, t: Array) -> Envelope:
        """The limits at each time."""
        index = self.index(t)
        return Envelope(*(ends[index] for ends in self.limits))

    def changes(self, t: Array) -> dict[int, Envelope | None]:
        """The limits, None where unknown, by the sample from which they apply. t: (n,) [s]."""
        index = self.index(t)
        rows = np.flatnonzero(np.diff(index, prepend=-1))
        return {row: self._known[index[row]] for row in rows.tolist()}

    def during(self, start: float, end: float) -> list[Envelope]:
        """Each distinct limits in force from start to end [s], in order."""
        first, last = self.index(np.array([start, end]))
        rows = [self.limits.row(k) for k in range(first, last + 1)]
        distinct = {(row.low.tobytes(), row.high.tobytes()): row for row in rows}
        return list(distinct.values())

    def silent(self, t: Array) -> Flags:
        """(n,) whether the limits in force make the alarm authority not applicable."""
        return self._silent[self.index(t)]

    def intervals(self, start: float, end: float) -> list[dict[str, Any]]:
        """Limits of limit sets in force from start to end [s], in plain data.

        reason: why the alarm authority is not applicable; empty where it is.
        """
        ends = [*self.starts[1:].tolist(), np.inf]
        return [
            {"start": max(begin, start), "end": min(stop, end)} | _plain(ruling)
            for begin, stop, ruling in zip(self.starts.tolist(), ends, self.rulings, strict=True)
            if ruling is not None and begin <= end and stop >= start
        ]


def limits_over_time(
    history: LimitsHistory | SetHistory | None, monitors: Sequence[Monitor]
) -> InForceTimeline | None:
    """Limits in force for monitors, the alarm authority first; None if its own always apply.

    They do without a limit set, and for channels that limit sets do not know.
    """
    if isinstance(history, SetHistory):
        return history.timeline()
    if history is None or monitors[0].dictionary != LATERAL:
        return None
    return history.timeline([monitor.envelope for monitor in monitors])


class LimitPiece(NamedTuple):
    """Limits from start to end [s]: infinite where there is no limit or it is unknown."""

    start: float
    end: float
    limits: Envelope


def pieces_of(
    dictionary: Dictionary,
    own: Envelope | None,
    in_force: Sequence[Mapping[str, Any]] | None,
) -> list[LimitPiece]:
    """Which limits were in force when. own: the monitor's; None for none.

    in_force: plain, see InForceTimeline.intervals; None where the monitor's applied throughout.
    """
    unlimited = Envelope.unlimited(len(dictionary))
    if in_force is None:
        return [LimitPiece(-np.inf, np.inf, own or unlimited)]
    pieces = [
        LimitPiece(
            each["start"],
            each["end"],
            envelope_of(specification_from_plain(each["limits"] or None, dictionary)) or unlimited,
        )
        for each in in_force
    ]
    begin = pieces[0].start if pieces else np.inf
    return [LimitPiece(-np.inf, begin, own or unlimited), *pieces]


def _plain(ruling: Ruling) -> dict[str, Any]:
    limits = specification_to_plain(ruling.specification)
    if isinstance(ruling, MonitorRuling):
        known = limits if isinstance(limits, dict) and ruling.limits is not None else None
        return {
            "name": ruling.in_use.name,
            "case": ruling.case,
            "monitor": ruling.monitor_id,
            "monitor_name": ruling.monitor_name,
            "limits": known and {key: limit for key, limit in known.items() if limit is not None},
            "reason": ruling.reason,
        }
    assert isinstance(ruling, LimitsRuling)
    in_force = ruling.in_force
    return {
        "limit_set": in_force.limit_set,
        "name": in_force.name,
        "version": in_force.version,
        "by": in_force.by,
        "case": ruling.case,
        "limits": {key: limits[key] for key in KEYS if limits.get(key) is not None}
        if isinstance(limits, dict)
        else None,
        "reason": ruling.reasons[0],
    }


def _measured(columns: Columns, mapping: ChannelMapping, name: str, own: str) -> ConditionSeries:
    """The values of a signal in order of time, infinite where marked unknown.

    own: unit of the condition; a signal that is also a channel has the unit of that, as in flight.
    """
    signal = columns.signal(name)
    group = columns.contents.groups[signal.group]
    source = mapping.times.get(group.name, TimeSource())
    clock, unit = (source.signal, source.unit) if source.signal else (group.time, "s")
    t, values = convert(columns.values(clock), unit, "s"), columns.values(name)
    if own and signal.unit:
        values = convert(values, signal.unit, own)
    known = ~np.isnan(values) & np.isfinite(t)
    order = np.argsort(t[known], kind="stable")
    return ConditionSeries(t[known][order], values[known][order])


def _at(key: ConditionKey, measured: ConditionSeries | None, t: Array) -> tuple[Array, np.ndarray]:
    """Value of a channel at each time, and the word for why it has none; empty where it has."""
    if measured is None or not len(measured.t):
        return np.zeros(len(t)), np.full(len(t), MISSING)
    newest = np.searchsorted(measured.t, t + 2 * ROUNDING, "right") - 1
    at = np.maximum(newest, 0)
    late = t - measured.t[at] > CONDITION_VALID_S
    values, (low, high) = measured.values[at], CONDITIONS[key].plausible
    unknown = (newest < 0) | np.isinf(values)
    is_wild = (values < low) | (values > high)
    words = np.select([unknown, is_wild, late], [MISSING, IMPLAUSIBLE, STALE], KNOWN)
    return np.where(words == KNOWN, values, 0.0), words
