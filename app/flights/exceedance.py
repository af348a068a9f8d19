"""Measured exceedances, judged from the channels alone."""

from collections.abc import Iterable
from math import inf, isnan
from operator import attrgetter

import numpy as np

from app.messages import ChannelExceedances, Judged, LatchedExceedance, MeasuredExceedance
from core.channels import KEYS
from core.monitor.validity.verdict import exceeds
from core.types import Array


def exceedance(limits: Array | None, y: Array, recorded: Array) -> MeasuredExceedance | None:
    """The limit that a sample exceeds from trim, as recorded, or both; None if it exceeds none.

    limits: (6,), None if unknown.   y: (6,) from trim.   recorded: (6,) including trim.
    With several channels beyond their limits, the result names the furthest one.
    """
    if limits is None:
        return None
    if exceeds(limits, y):
        judged: Judged = "both" if exceeds(limits, recorded) else "from_trim"
        return _named(limits, y, judged)
    if recorded is y:
        return None
    return _named(limits, recorded, "recorded") if exceeds(limits, recorded) else None


class Exceedances:
    """The measured exceedances of a flight per channel, and those that the strips latch.

    near: [s] a received sample and a grid sample so close together are one exceedance.
    """

    def __init__(self, near: float = 0.0) -> None:
        self._near = near
        self._of: dict[str, ChannelExceedances] = {}
        self._begun: dict[str, set[float]] = {}
        self._over: set[str] = set()
        self._latched: dict[str, LatchedExceedance] = {}
        self._is_over_any = False

    @property
    def of_channels(self) -> list[ChannelExceedances]:
        return sorted(self._of.values(), key=attrgetter("first_t"))

    @property
    def latched(self) -> list[LatchedExceedance]:
        return [latched.model_copy() for latched in self._latched.values()]

    def restart(self) -> None:
        self._over.clear()
        self._latched.clear()
        self._is_over_any = False

    def update(
        self, t: float, y: Array, limits: Array | None, named: MeasuredExceedance | None
    ) -> None:
        """Add a sample, y (6,) from trim. named: its exceedance, or one since the last sample."""
        if named is None and not self._is_over_any:
            return
        values: dict[str, tuple[float, float]] = {}
        if named is not None:
            values[named.channel] = named.value, named.limit
        from_trim = set[str]()
        if limits is not None:
            for key, value, limit in zip(KEYS, y.tolist(), limits.tolist(), strict=True):
                if abs(value) >= limit < inf:
                    values[key] = value, limit
                    from_trim.add(key)
        for key, (value, limit) in values.items():
            self._note(key, t, value, limit)
        self._over = set(values)
        self._latch(t, {key: values[key][0] for key in from_trim}, y)
        self._is_over_any = bool(self._over) or any(
            latched.over for latched in self._latched.values()
        )

    def add(self, t: float, named: MeasuredExceedance) -> None:
        """Add the exceedance of a received sample that may not reach the grid."""
        self._note(named.channel, t, named.value, named.limit)

    def pass_by(self, t: float, named: MeasuredExceedance, goes_on: bool = False) -> None:
        """Add an exceedance that a seek passes; no strip shows it.

        goes_on: it lasts to the sample sought, which then starts no new one.
        """
        self._note(named.channel, t, named.value, named.limit)
        if goes_on:
            self._over.add(named.channel)
            self._is_over_any = True
        else:
            self._over.discard(named.channel)

    def acknowledge(self) -> None:
        """Acknowledge all; those that have ended are no longer latched."""
        for key, latched in list(self._latched.items()):
            if latched.over:
                latched.acknowledged = True
            else:
                del self._latched[key]

    def _note(self, key: str, t: float, value: float, limit: float) -> None:
        known = self._of.get(key)
        begun = self._begun.setdefault(key, set())
        begins = key not in self._over and not any(abs(t - each) <= self._near for each in begun)
        if begins:
            begun.add(t)
        if known is None:
            about = {"first_t": t, "last_t": t, "worst": value, "worst_t": t, "limit": limit}
            self._of[key] = ChannelExceedances(channel=key, n=1, **about)
            return
        known.n += begins
        known.first_t = min(known.first_t, t)
        known.last_t = max(known.last_t, t) if begins else known.last_t
        if abs(value) / limit > abs(known.worst) / known.limit:
            known.worst, known.worst_t, known.limit = value, t, limit

    def _latch(self, t: float, over: dict[str, float], y: Array) -> None:
        for key, value in over.items():
            latched = self._latched.get(key)
            if latched is None:
                latched = LatchedExceedance(
                    channel=key, t=t, value=value, over=True, acknowledged=False
                )
                self._latched[key] = latched
            latched.over = True
            latched.value = max(latched.value, value, key=abs)
        for key in [key for key in self._latched if key not in over]:
            if isnan(y.item(KEYS.index(key))):
                continue
            if self._latched[key].acknowledged:
                del self._latched[key]
            else:
                self._latched[key].over = False


def of_alarms(alarms: Iterable[tuple[float, MeasuredExceedance]]) -> list[ChannelExceedances]:
    """Exceedances per channel from alarms: time [s], and values at their onset."""
    log = Exceedances()
    for t, named in alarms:
        log.pass_by(t, named)
    return log.of_channels


def _named(limits: Array, y: Array, judged: Judged) -> MeasuredExceedance:
    worst = int(np.nan_to_num(np.abs(y) / limits, posinf=0.0).argmax())
    return MeasuredExceedance(
        channel=KEYS[worst],
        value=float(y[worst]),
        limit=float(limits[worst]),
        judged=judged,
    )
