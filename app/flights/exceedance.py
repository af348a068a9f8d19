"""Measured exceedances: judged from the channels alone, whatever the monitor says of them."""

from collections.abc import Iterable
from math import inf, isnan

import numpy as np

from app.messages import ChannelExceedances, Judged, LatchedExceedance, MeasuredExceedance
from core.channels import KEYS
from core.monitor.validity.verdict import exceeds
from core.types import Array


def exceedance(limits: Array | None, y: Array, recorded: Array) -> MeasuredExceedance | None:
    """Which limit a sample exceeds: from trim, as recorded, or both; None where it exceeds none.

    limits: (6,), None where they are not known.   y: (6,) from trim.   recorded: (6,), trim
    included. Of several channels the one furthest beyond its limit is named.
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
    """The measured exceedances of a flight, channel by channel: those begun, and those latched."""

    def __init__(self) -> None:
        self._of: dict[str, ChannelExceedances] = {}
        self._begun: dict[str, set[float]] = {}
        self._over: set[str] = set()
        self._latched: dict[str, LatchedExceedance] = {}
        self._is_over_any = False

    @property
    def of_channels(self) -> list[ChannelExceedances]:
        """What each channel came to, in the order of their first."""
        return sorted(self._of.values(), key=lambda one: one.first_t)

    @property
    def latched(self) -> list[LatchedExceedance]:
        """Those that a strip shows."""
        return [one.model_copy() for one in self._latched.values()]

    def restart(self) -> None:
        """The next sample does not follow the last one."""
        self._over.clear()
        self._latched.clear()
        self._is_over_any = False

    def update(
        self, t: float, y: Array, limits: Array | None, named: MeasuredExceedance | None
    ) -> None:
        """Take a sample, y (6,) from trim. named: its exceedance, or one since the one before."""
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
        self._is_over_any = bool(self._over) or any(one.over for one in self._latched.values())

    def pass_by(self, t: float, named: MeasuredExceedance, goes_on: bool = False) -> None:
        """Note one that a seek passes, which no strip shows.

        goes_on: up to the sample that was sought, which then begins none.
        """
        self._note(named.channel, t, named.value, named.limit)
        if goes_on:
            self._over.add(named.channel)
            self._is_over_any = True
        else:
            self._over.discard(named.channel)

    def acknowledge(self) -> None:
        """Somebody acknowledged an exceedance: those that are over need no more."""
        for key, one in list(self._latched.items()):
            if one.over:
                one.acknowledged = True
            else:
                del self._latched[key]

    def _note(self, key: str, t: float, value: float, limit: float) -> None:
        known = self._of.get(key)
        begins = key not in self._over and t not in self._begun.setdefault(key, set())
        if begins:
            self._begun[key].add(t)
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
    """What each channel came to, by the exceedances of alarms: t [s], value as each began."""
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
