"""The limits that were in force while a recording was flown, from what its flight wrote down."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple, Self

import numpy as np

from app.scoring.limits_in_force import HELD_S, ROUNDING, LimitsInForce, LimitsRule, Ruling
from app.scoring.outcome import SAME_TIME
from app.telemetry.contents import Columns
from app.telemetry.mapping.mapping import Mapping as ChannelMapping
from app.telemetry.mapping.mapping import TimeSource
from app.telemetry.recording import TelemetryError
from app.telemetry.units import convert
from core.channels import KEYS, N_CHANNELS
from core.limit_set import CONDITION_KEYS, MISSING, STALE, Condition
from core.specification import specification_to_plain
from core.types import Array, Flags, Indices

KNOWN = ""


class ConditionSeries(NamedTuple):
    """What was sent of a channel of the flight condition: t (n,) rising [s], values (n,)."""

    t: Array
    values: Array


@dataclass(frozen=True, eq=False)
class LimitsHistory:
    """The limit sets that were put in force during a flight, and the flight condition.

    A version holds for the samples after its time, the first of a flight for all; a value of the
    condition until the next of its channel, HELD_S at most.
    """

    versions: tuple[LimitsInForce, ...]
    measured: dict[str, ConditionSeries]

    @classmethod
    def of(cls, columns: Columns, mapping: ChannelMapping) -> Self | None:
        """That of a recording by its mapping's times; None where no limit set was in force.

        TelemetryError where what was written of them cannot be read.
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
        names = {key: contents.conditions.get(key, key) for key in CONDITION_KEYS}
        known = {signal.name for signal in contents.signals}
        measured = {
            key: _measured(columns, mapping, name) for key, name in names.items() if name in known
        }
        return cls(versions, measured)

    def held(self, own: Sequence[Array | None]) -> "HeldLimits":
        """Which limits held for monitors, the alarm authority first. own: (6,) of each."""
        starts, rulings = [-np.inf], list[Ruling | None]([None])
        begins = [-np.inf if one.seq == 0 else one.t + SAME_TIME for one in self.versions]
        for version, (begin, end) in zip(self.versions, pairwise([*begins, np.inf]), strict=True):
            rule = LimitsRule(version, own)
            for t, condition in self._conditions(begin, end):
                ruling = rule.at(condition)
                if ruling is not rulings[-1]:
                    starts.append(t)
                    rulings.append(ruling)
        return HeldLimits(np.array(starts), tuple(rulings), own[0])

    def _conditions(self, begin: float, end: float) -> list[tuple[float, Condition]]:
        """The measured condition from `begin` on [s], at each time before `end` that it changes."""
        edges = [np.array([begin])]
        for one in self.measured.values():
            edges += [one.t - ROUNDING, np.nextafter(one.t + HELD_S, np.inf)]
        t = np.unique(np.concatenate(edges))
        t = t[(t >= begin) & (t < end)]
        columns = [_at(self.measured.get(key), t) for key in CONDITION_KEYS]
        changes = np.ones(len(t), bool)
        changes[1:] = np.logical_or.reduce(
            [_differs(values) | (words[1:] != words[:-1]) for values, words in columns]
        )
        return [
            (float(t[k]), tuple(str(w[k]) or float(v[k]) for v, w in columns))
            for k in np.flatnonzero(changes)
        ]


class HeldLimits:
    """Which limits hold when, for monitors.

    starts: (n,) rising [s], the first -inf.   rulings: from each on; None for the authority's own
    limits, (6,), None where they are not known.
    """

    def __init__(self, starts: Array, rulings: tuple[Ruling | None, ...], own: Array | None):
        self.starts, self.rulings = starts, rulings
        each = [own if one is None else one.limits for one in rulings]
        unlimited = np.full(N_CHANNELS, np.inf)
        self.limits = np.array([unlimited if one is None else one for one in each])
        """(n, 6), infinite where there is none, or nobody can tell"""
        self._silent = np.array([bool(one and one.reasons[0]) for one in rulings])

    def index(self, t: Array | float) -> Indices:
        """Number of the ruling at each time."""
        return np.searchsorted(self.starts, t, "right") - 1

    def ruling(self, t: float) -> Ruling | None:
        """The ruling at a time [s]; None for the authority's own limits."""
        return self.rulings[int(self.index(t))]

    def at(self, t: Array) -> Array:
        """(n, 6) magnitudes that must not be exceeded at each time."""
        return self.limits[self.index(t)]

    def during(self, start: float, end: float) -> list[Array]:
        """(6,) each of the limits that hold from start to end [s], once, in order."""
        first, last = self.index(np.array([start, end]))
        each = {one.tobytes(): one for one in self.limits[first : last + 1]}
        return list(each.values())

    def silent(self, t: Array) -> Flags:
        """(n,) whether the alarm authority is not applicable at each time, for the limits."""
        return self._silent[self.index(t)]

    def intervals(self, start: float, end: float) -> list[dict[str, Any]]:
        """Which limits held from start to end [s], in plain data; those of a monitor left out.

        reason: why the alarm authority is not applicable; empty where it is.
        """
        ends = [*self.starts[1:].tolist(), np.inf]
        return [
            {"start": max(begin, start), "end": min(stop, end)} | _plain(ruling)
            for begin, stop, ruling in zip(self.starts.tolist(), ends, self.rulings, strict=True)
            if ruling is not None and begin <= end and stop >= start
        ]


class LimitPiece(NamedTuple):
    """Limits (6,) from start to end [s], infinite where there is none, or nobody can tell."""

    start: float
    end: float
    limits: Array


def pieces_of(limits: Array, in_force: Sequence[Mapping[str, Any]] | None) -> list[LimitPiece]:
    """Which limits held when. limits: (6,) the monitor's.

    in_force: plain, see HeldLimits.intervals; None where these held all along.
    """
    if in_force is None:
        return [LimitPiece(-np.inf, np.inf, limits)]
    pieces = [
        LimitPiece(
            one["start"], one["end"], np.array([(one["limits"] or {}).get(k, np.inf) for k in KEYS])
        )
        for one in in_force
    ]
    begin = pieces[0].start if pieces else np.inf
    return [LimitPiece(-np.inf, begin, limits), *pieces]


def _plain(ruling: Ruling) -> dict[str, Any]:
    in_force = ruling.in_force
    limits = specification_to_plain(ruling.specification)
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


def _measured(columns: Columns, mapping: ChannelMapping, name: str) -> ConditionSeries:
    """The values of a signal in the order of their times, infinite where nobody knew it."""
    group = columns.contents.groups[columns.signal(name).group]
    source = mapping.times.get(group.name, TimeSource())
    clock, unit = (source.signal, source.unit) if source.signal else (group.time, "s")
    t, values = convert(columns.values(clock), unit, "s"), columns.values(name)
    known = ~np.isnan(values) & np.isfinite(t)
    order = np.argsort(t[known], kind="stable")
    return ConditionSeries(t[known][order], values[known][order])


def _at(measured: ConditionSeries | None, t: Array) -> tuple[Array, np.ndarray]:
    """Value of a channel at each time, and the word for why there is none, empty where it is."""
    if measured is None or not len(measured.t):
        return np.zeros(len(t)), np.full(len(t), MISSING)
    newest = np.searchsorted(measured.t, t + 2 * ROUNDING, "right") - 1
    at = np.maximum(newest, 0)
    late = t - measured.t[at] > HELD_S
    unknown = (newest < 0) | np.isinf(measured.values[at])
    words = np.where(unknown, MISSING, np.where(late, STALE, KNOWN))
    return np.where(words == KNOWN, measured.values[at], 0.0), words


def _differs(values: Array) -> Flags:
    return np.diff(values) != 0.0
