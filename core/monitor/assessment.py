"""What a monitor says of one sample, and the states in which it says nothing."""

from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from core.channels import KEYS
from core.types import Array, Flags, Indices


class State(StrEnum):
    """Whether a sample could be assessed; only `ok` has a p-value."""

    OK = "ok"
    WARMING_UP = "warming_up"
    STALE = "stale"
    INVALID = "invalid"


class Cause(StrEnum):
    """Why a sample is `invalid`, where views have a word of its own for it."""

    BETWEEN = "between_manoeuvres"
    NOT_APPLICABLE = "not_applicable"
    LIMITS_UNKNOWN = "limits_unknown"


STATES = tuple(State)
"""States in the order of the compiled path's codes."""
_CODES = {state: code for code, state in enumerate(STATES)}


def code_of(state: State) -> int:
    """The compiled path's code of a state."""
    return _CODES[state]


REASONS = (
    "",
    "the history restarted after a gap or an invalid sample and is not full yet",
    "the sample repeats the time of the one before it",
    "the sample is not finite, or its time does not follow the last one by the monitor's interval",
)


@dataclass(frozen=True, slots=True)
class Exemplar:
    """The simulated rollout that an assessment resembles: the "why"."""

    __pydantic_config__ = {"use_attribute_docstrings": True}  # noqa: RUF012

    rollout: int
    """index into the dataset's unsafe or safe rollouts"""
    t: float
    """time in it [s]"""
    distance: float
    """from the assessed point, in the monitor's scaled units"""
    theta: dict[str, float]
    """its parameters"""


class Assessment(NamedTuple):
    """What the monitor says of one sample; a tuple, which is made a microsecond sooner.

    t: time [s].   p_value, alert, score: None unless state is `ok`.
    alert_above: p-value above which it is an alert; None where there is none.
    cause: the kind of reason of an invalid sample, where views tell it apart; else None.
    y_hat: (6,) forecast of the outputs t_early ahead; None where the predictor makes none.
    nearest_unsafe, nearest_safe: exemplars; None where the score looks up no neighbours.
    group: the flight's group of failing flights, by which the p-value is; None where it is not
    known yet, and for monitors without groups.
    """

    t: float
    p_value: float | None
    alert: bool | None
    state: State
    reason: str = ""
    y_hat: Array | None = None
    score: float | None = None
    nearest_unsafe: Exemplar | None = None
    nearest_safe: Exemplar | None = None
    alert_above: float | None = None
    cause: Cause | None = None
    group: str | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the wire form: plain numbers, the forecast by channel key."""
        return {
            "t": self.t,
            "p_value": self.p_value,
            "alert": self.alert,
            "alert_above": self.alert_above,
            "state": self.state.value,
            "reason": self.reason,
            "y_hat": None
            if self.y_hat is None
            else dict(zip(KEYS, self.y_hat.tolist(), strict=True)),
            "score": self.score,
            "group": self.group,
            "nearest_unsafe": self.nearest_unsafe and asdict(self.nearest_unsafe),
            "nearest_safe": self.nearest_safe and asdict(self.nearest_safe),
        }


class Withdrawal(NamedTuple):
    """first: sample from which on nothing is said of a flight.   reason: why."""

    first: int
    reason: str


def withdrawn(t: float, reason: str, cause: Cause | None = None) -> Assessment:
    """What is said of a sample of which nothing may be said."""
    return Assessment(t, None, None, State.INVALID, reason, cause=cause)


@dataclass(frozen=True, eq=False)
class Assessments:
    """Assessments of a whole trajectory, one array a field; row i is sample i.

    t: (n,) [s].   state: (n,) codes into STATES.   p_value, score: (n,), NaN unless `ok`.
    alert: (n,) false unless `ok`.   y_hat: (n, 6), NaN where there is no forecast.
    nearest_unsafe, nearest_safe: (n,) point numbers of the monitor; -1 where there is none.
    withdrawal: from where on the flight is invalid for being outside training; None if it is not.
    alert_above: p-value above which a sample alerts.
    group: (n,) numbers into group_names, -1 while it is not known; None without groups.
    """

    t: Array
    state: Indices
    p_value: Array
    alert: Flags
    score: Array
    y_hat: Array
    nearest_unsafe: Indices
    nearest_safe: Indices
    withdrawal: Withdrawal | None = None
    alert_above: float = np.nan
    group: Indices | None = None
    group_names: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, k: int) -> Assessment:
        """Sample k, without exemplars."""
        if self.withdrawal is not None and k >= self.withdrawal.first:
            return withdrawn(float(self.t[k]), self.withdrawal.reason)
        t, code = float(self.t[k]), int(self.state[k])
        state, reason = STATES[code], REASONS[code]
        if state is not State.OK:
            return Assessment(t, None, None, state, reason)
        y_hat = self.y_hat[k] if np.isfinite(self.y_hat[k]).all() else None
        p_value, alert, score = (float(self.p_value[k]), bool(self.alert[k]), float(self.score[k]))
        said = p_value, alert, state, reason, y_hat, score
        group = self._group_name(k)
        return Assessment(t, *said, alert_above=self.alert_above, group=group)

    def _group_name(self, k: int) -> str | None:
        """Name of the group at sample k; None where it is not known."""
        group = -1 if self.group is None else self.group.item(k)
        return None if group < 0 else self.group_names[group]

    def columns(self) -> dict[str, list[Any]]:
        """Return what `as_dict` says of each sample but exemplars, a list a field.

        y_hat: lists (6,).
        """
        reasons = list(map(REASONS.__getitem__, self.state.tolist()))
        if self.withdrawal is not None:
            first, reason = self.withdrawal
            reasons[first:] = [reason] * (len(self) - first)
        known = self.state == code_of(State.OK)
        forecast = known & np.isfinite(self.y_hat).all(axis=1)
        return {
            "t": self.t.tolist(),
            "p_value": _where(known, self.p_value),
            "alert": _where(known, self.alert),
            "alert_above": [self.alert_above if k else None for k in known.tolist()],
            "state": [STATES[code].value for code in self.state.tolist()],
            "reason": reasons,
            "y_hat": _where(forecast, self.y_hat),
            "score": _where(known, self.score),
            "group": [self._group_name(k) if ok else None for k, ok in enumerate(known.tolist())],
        }

    def withdrawn_from(self, lost: Withdrawal | None) -> "Assessments":
        """Return them with nothing said from a sample on, or from one before it if it is so."""
        if lost is None or (self.withdrawal is not None and self.withdrawal.first <= lost.first):
            return self
        after = slice(lost.first, None)
        arrays = {name: getattr(self, name).copy() for name in _NOTHING}
        for name, nothing in _NOTHING.items():
            arrays[name][after] = nothing
        return replace(self, **arrays, withdrawal=lost)


def _where(known: Flags, values: Array | Flags) -> list[Any]:
    return [v if k else None for k, v in zip(known.tolist(), values.tolist(), strict=True)]


_NOTHING = {
    "state": code_of(State.INVALID),
    "p_value": np.nan,
    "alert": False,
    "score": np.nan,
    "y_hat": np.nan,
    "nearest_unsafe": -1,
    "nearest_safe": -1,
}
"""What stands in an array of Assessments where nothing is said."""
