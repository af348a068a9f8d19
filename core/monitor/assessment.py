"""The assessment of one sample, and the states in which there is none."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from core.channels import KEYS
from core.types import Array, Flags, Indices


class State(StrEnum):
    """Whether a sample could be assessed; only `ok` has a p-value. A flight before its first sample
    has no data."""

    OK = "ok"
    WARMING_UP = "warming_up"
    STALE = "stale"
    INVALID = "invalid"
    NO_DATA = "no_data"


class Cause(StrEnum):
    """Causes of `invalid`: outside every manoeuvre, other limits in force, needed channels missing,
    the sample lost to its time, rate or an implausible value, or no trim of a limited channel; none
    where the monitor was
    withdrawn by its validity. And, of `warming_up`, what a flight between manoeuvres waits for:
    trim at rest, stillness, or the next input."""

    BETWEEN = "between_manoeuvres"
    NOT_APPLICABLE = "not_applicable"
    LIMITS_UNKNOWN = "limits_unknown"
    REST = "rest"
    MOVING = "moving"
    READY = "ready"
    MISSING = "missing"
    LOST = "lost"
    TRIM_UNKNOWN = "trim_unknown"


CAUSES = None, *Cause
"""Causes by the code that is stored; a new one goes to the end."""
RESTS = frozenset({Cause.REST, Cause.MOVING, Cause.READY})
"""Causes of a sample between the manoeuvres of a live flight."""
DATA_MISSING = frozenset({Cause.MISSING, Cause.LOST})
"""Causes that withdraw nothing."""
STATES = State.OK, State.WARMING_UP, State.STALE, State.INVALID
"""States of assessments by the code that the compiled kernels use."""
_CODES = {state: code for code, state in enumerate(STATES)}


def code_of(state: State) -> int:
    return _CODES[state]


REASONS = (
    "",
    "filling the history again after a gap or an invalid sample",
    "the sample has the same time as the previous one",
    "a value is not finite, or the time step differs from the monitor's sample interval",
)


@dataclass(frozen=True, slots=True)
class Exemplar:
    """The simulated rollout most similar to an assessed sample."""

    __pydantic_config__ = {"use_attribute_docstrings": True}  # noqa: RUF012

    rollout: int
    """index among the dataset's unsafe or safe rollouts"""
    t: float
    """time within the rollout [s]"""
    distance: float
    """distance to the assessed point, in the monitor's scaled units"""
    theta: dict[str, float]
    """parameters of the rollout"""


class Assessment(NamedTuple):
    """Assessment of one sample; a tuple because that saves a microsecond.

    t: time [s].   p_value, alert, score: None unless state is `ok`.
    alert_above: p-value above which it is an alert; None unless state is `ok`.
    cause: of an invalid sample, if views distinguish it, or of one between manoeuvres; else None.
    y_hat: (n_channels,) forecast of the outputs t_early ahead; None if the predictor makes none.
    nearest_unsafe, nearest_safe: exemplars; None if the score uses no neighbours.
    group: group of failing flights whose calibration gives the p-value; None while unknown and for
    monitors without groups.
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

    def as_dict(self, keys: Sequence[str] = KEYS) -> dict[str, Any]:
        """Wire form: plain numbers, the forecast by channel key. keys: of the channels."""
        return {
            "t": self.t,
            "p_value": self.p_value,
            "alert": self.alert,
            "alert_above": self.alert_above,
            "state": self.state.value,
            "reason": self.reason,
            "y_hat": None
            if self.y_hat is None
            else dict(zip(keys, self.y_hat.tolist(), strict=True)),
            "score": self.score,
            "group": self.group,
            "nearest_unsafe": self.nearest_unsafe and asdict(self.nearest_unsafe),
            "nearest_safe": self.nearest_safe and asdict(self.nearest_safe),
        }


class Withdrawal(NamedTuple):
    """first: sample from which the flight is not assessed.   reason: why."""

    first: int
    reason: str


def without_p_value(t: float, code: int) -> Assessment:
    """Assessment of a sample for which a kernel gives a state alone. code: of the state."""
    state = STATES[code]
    cause = Cause.LOST if state is State.INVALID else None
    return Assessment(t, None, None, state, REASONS[code], cause=cause)


def withdrawn(t: float, reason: str, cause: Cause | None = None) -> Assessment:
    """Assessment of a sample outside the monitor's validity."""
    return Assessment(t, None, None, State.INVALID, reason, cause=cause)


@dataclass(frozen=True, eq=False)
class Assessments:
    """Assessments of a whole trajectory, one array per field; row i is sample i.

    t: (n,) [s].   state: (n,) indices into STATES.   p_value, score: (n,), NaN unless `ok`.
    alert: (n,) false unless `ok`.   y_hat: (n, n_channels), NaN without a forecast.
    nearest_unsafe, nearest_safe: (n,) point numbers of the monitor; -1 for none.
    withdrawal: first sample outside training; None if the flight stays inside.
    alert_above: p-value above which a sample alerts.
    group: (n,) indices into group_names, -1 while unknown; None without groups.
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
        if STATES[code] is not State.OK:
            return without_p_value(t, code)
        y_hat = self.y_hat[k] if np.isfinite(self.y_hat[k]).all() else None
        p_value, alert, score = (float(self.p_value[k]), bool(self.alert[k]), float(self.score[k]))
        fields = p_value, alert, State.OK, "", y_hat, score
        group = self._group_name(k)
        return Assessment(t, *fields, alert_above=self.alert_above, group=group)

    def _group_name(self, k: int) -> str | None:
        group = -1 if self.group is None else self.group.item(k)
        return None if group < 0 else self.group_names[group]

    def columns(self) -> dict[str, list[Any]]:
        """Fields of `as_dict` as lists over the samples, without exemplars.

        y_hat: lists (n_channels,).
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

    def from_sample(self, first: int, stop: int | None = None) -> "Assessments":
        """The assessments from a sample on, up to another; they must not be withdrawn."""
        arrays = {
            field.name: value[first:stop]
            for field in fields(self)
            if isinstance(value := getattr(self, field.name), np.ndarray)
        }
        return replace(self, **arrays)

    def withdrawn_from(self, withdrawal: Withdrawal | None) -> "Assessments":
        """Copy that is invalid from `lost` on, unless it was withdrawn earlier."""
        if withdrawal is None or (
            self.withdrawal is not None and self.withdrawal.first <= withdrawal.first
        ):
            return self
        after = slice(withdrawal.first, None)
        arrays = {name: getattr(self, name).copy() for name in _MISSING}
        for name, missing in _MISSING.items():
            arrays[name][after] = missing
        return replace(self, **arrays, withdrawal=withdrawal)


def _where(known: Flags, values: Array | Flags) -> list[Any]:
    return [v if k else None for k, v in zip(known.tolist(), values.tolist(), strict=True)]


_MISSING = {
    "state": code_of(State.INVALID),
    "p_value": np.nan,
    "alert": False,
    "score": np.nan,
    "y_hat": np.nan,
    "nearest_unsafe": -1,
    "nearest_safe": -1,
}
"""Values of the arrays of Assessments for samples without an assessment."""
