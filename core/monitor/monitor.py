"""The trained and calibrated monitor, for whole flights and streams."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from core.channels import LATERAL, Dictionary
from core.kernels import assessing, compiled, peak_risk
from core.kernels.assessing import Fitted
from core.kernels.deviation import NO_INNOVATION, Innovation, Reference, largest_so_far
from core.kernels.live_call import live_call, update_at
from core.kernels.nearest import build
from core.kernels.p_value import SIMPLE, Transduction, simple_p
from core.limits.limits import (
    Envelope,
    Specification,
    envelope_of,
    magnitudes_of,
    specification_to_plain,
)
from core.monitor.assessment import (
    Assessment,
    Assessments,
    Exemplar,
    State,
    Withdrawal,
    withdrawn,
    without_p_value,
)
from core.monitor.calibration import alert_above, check_epsilon, p_values, smallest_epsilon
from core.monitor.file import portable
from core.monitor.group import NO_GROUP, Groups
from core.monitor.peak_forecast import LOST, Ahead, PeakForecast
from core.monitor.predictor import Affine
from core.monitor.recipe import MonitorRecipe
from core.monitor.validity.flown_input import FlownInput, InputSupport
from core.monitor.validity.support import NOT_CALIBRATED, Support, ValidityBasis
from core.monitor.validity.verdict import (
    RunningValidity,
    ValidityVerdict,
    compare,
    in_words,
)
from core.recipe import to_plain
from core.types import Array, Flags, Indices, real_numbers
from core.whole_file import whole_file

OK = State.OK
make_assessment = tuple.__new__
"""Builds from the fields in order, in a tenth of the time of the class itself."""


@dataclass(frozen=True, eq=False)
class Monitor:
    """A safety monitor for one manoeuvre.

    dt: sample interval [s].   h: lead in samples.
    scale: (n_channels,) units of the channels for distances.
    training_max_abs: (n_channels,) largest magnitude of each channel in training.
    unsafe_points, safe_points: (n, d) mapped.   unsafe_where, safe_where: (n, 2) the rollout and
    the sample each point comes from.   theta_unsafe, theta_safe: (n, n_parameters) of rollouts.
    n_early: failures too early for a warning; their calibration score is +inf.
    fitted, exact: arrays of the compiled kernels.
    dataset_recipe, dataset_digest, seed, version: its origin.
    specification: defines its failures; None if unknown.
    support: how far fresh flights deviate from training; None if validity is not calibrated, and
    then it never withdraws.
    evaluation: results of fresh test flights, as plain data; None if none were flown.
    inputs: how surfaces moved in fresh flights; None if unknown.
    forecast: of the rest of the manoeuvre; None for predictors without one. If present, scores are
    of the forecast, and `fitted` only finds similar rollouts.
    groups: calibration by groups; None if all failures are pooled.
    dictionary: of the channels.
    """

    recipe: MonitorRecipe
    dt: float
    h: int
    scale: Array
    training_max_abs: Array
    unsafe_points: Array
    unsafe_where: Indices
    safe_points: Array
    safe_where: Indices
    theta_names: tuple[str, ...]
    theta_unsafe: Array
    theta_safe: Array
    n_early: int
    fitted: Fitted = field(repr=False)
    exact: Transduction = field(repr=False, default=SIMPLE)
    dataset_recipe: dict[str, Any] = field(default_factory=dict)
    dataset_digest: str = ""
    seed: int | None = None
    version: str = ""
    specification: Specification = None
    support: Support | None = None
    evaluation: dict[str, Any] | None = None
    inputs: InputSupport | None = None
    forecast: PeakForecast | None = field(repr=False, default=None)
    groups: Groups | None = field(repr=False, default=None)
    dictionary: Dictionary = field(repr=False, default=LATERAL)

    @property
    def alphas(self) -> Array:
        """(n,) sorted calibration scores of all failures."""
        return self.fitted.alphas

    @property
    def affine(self) -> Affine:
        """Map from an observation in SI units to a point."""
        return Affine(self.fitted.matrix[:, : self.fitted.d], self.fitted.offset[: self.fitted.d])

    @cached_property
    def limits(self) -> Array | None:
        """(6,) limits as magnitudes; None if unknown or of another kind."""
        return magnitudes_of(self.specification)

    @cached_property
    def envelope(self) -> Envelope | None:
        """Its limits; None if unknown."""
        return envelope_of(self.specification)

    @cached_property
    def validity_basis(self) -> ValidityBasis | None:
        """Basis for judging validity; None if it is not calibrated."""
        if self.support is None:
            return None
        reference = self.reference(self.support.innovation, self.support.sigma)
        shape = self.inputs and self.inputs.shape
        return ValidityBasis(
            self.support,
            reference,
            self.training_max_abs,
            self.safe_points,
            shape,
            self.dictionary,
        )

    def reference(
        self, innovation: Innovation = NO_INNOVATION, sigma: Array | None = None
    ) -> Reference:
        """Reference from which deviations are measured.

        innovation: of the responses.   sigma: (n_channels,) of the residuals h samples ahead,
        tested only if given.
        """
        sigma = np.full(len(self.dictionary), np.nan) if sigma is None else sigma
        is_built = len(self.fitted.safe.slot) == len(self.safe_points)
        return Reference(
            matrix=self.fitted.matrix,
            offset=self.fitted.offset,
            safe=self.fitted.safe if is_built else build(self.safe_points),
            scale=self.scale,
            sigma=sigma,
            d=self.fitted.d,
            h=self.h,
            n_delay=self.recipe.n_delay,
            dt=self.dt,
            has_residuals=bool(np.isfinite(sigma).all()),
            innovation=innovation,
        )

    @property
    def n_unsafe(self) -> int:
        """Failures in calibration; per group if it has groups."""
        return len(self.alphas) if self.groups is None else self.groups.n_unsafe

    @property
    def lead(self) -> float:
        """Effective lead h * dt [s]."""
        return self.h * self.dt

    @property
    def smallest_epsilon(self) -> float:
        """Smallest epsilon that its failures support."""
        return smallest_epsilon(self.n_unsafe, self.recipe.guarantee, self._most_early)

    @property
    def _most_early(self) -> int:
        """Failures too early for a warning; of the group with most of them."""
        return self.n_early if self.groups is None else self.groups.n_early

    def p_values(self, y: npt.ArrayLike) -> Array:
        """p-value of each sample of a trajectory sampled at the monitor's dt.

        y: (n_samples, n_channels) channels in order, SI units, N_y in g.
        Returns (n_samples,) in [1/(n_unsafe+1), 1]; NaN for invalid samples or history, and after
        the flight is outside training.
        """
        y = self._checked(y)
        t = np.arange(len(y), dtype=np.float64) * self.dt
        if len(self.exact.start) or self.forecast is not None or self.groups is not None:
            return self.assess(t, y).p_value
        state = assessing.states(t, y, self.dt, self.recipe.n_delay)
        ok = state == assessing.OK
        p = peak_risk.simple_p_values(self.fitted, y, ok, self.recipe.n_delay)
        if self.validity_basis is not None:
            end = self.last_counted(y)
            first = compare(self.validity_basis, t, y, state, end=end).first_outside
            p[len(p) if first is None else first :] = np.nan
        return p

    def assess(
        self,
        t: npt.ArrayLike,
        y: npt.ArrayLike,
        epsilon: float | None = None,
        *,
        withdraw: bool = True,
    ) -> Assessments:
        """Assess every sample of a trajectory; bit for bit like a stream of its samples.

        t: (n,) [s].   y: (n, n_channels).   epsilon: that of the recipe unless given.
        withdraw: mark samples invalid once the flight is outside training, as a stream does.
        """
        t, y = np.ascontiguousarray(t, np.float64), self._checked(y)
        if t.shape != (len(y),):
            raise ValueError(f"t has shape {t.shape}: give one time per sample, ({len(y)},)")
        above = self.alert_above(epsilon)
        state = assessing.states(t, y, self.dt, self.recipe.n_delay)
        fresh = state != assessing.STALE
        y_fresh, ok = _at(fresh, y), _at(fresh, state) == assessing.OK
        z, s, p, unsafe, safe = assessing.score_all(
            self.fitted, self.exact, y_fresh, ok, self.recipe.n_delay
        )
        lost_from = None
        if self.recipe.predictor.forecasts:
            y_hat = _spread(z * self.scale, fresh, np.nan)
        else:
            y_hat = np.full(y.shape, np.nan)
        if self.forecast is not None:
            near = _spread(s, fresh, np.nan)
            scored = self.forecast.follow(t, y, state, self.dt, near)
            lost_from = Withdrawal(scored.lost, LOST) if scored.lost < len(y) else None
            state, s = scored.state, _at(fresh, scored.score)
            p = p_values(s, self.alphas)
            if self.forecast.has_outputs:
                y_hat = scored.y_hat
        group = None
        if self.groups is not None:
            p, group = self.groups.p_values(s, y_fresh)
        result = Assessments(
            t=t,
            state=state,
            p_value=_spread(p, fresh, np.nan),
            alert=_spread(p > above, fresh, False),
            score=_spread(s, fresh, np.nan),
            y_hat=y_hat,
            nearest_unsafe=_spread(unsafe, fresh, -1),
            nearest_safe=_spread(safe, fresh, -1),
            alert_above=above,
            group=None if group is None else _spread(group, fresh, NO_GROUP),
            group_names=() if self.groups is None else self.groups.rule.names,
        ).withdrawn_from(lost_from)
        return (
            result.withdrawn_from(self.judge_and_withdraw(t, y, result)[1]) if withdraw else result
        )

    def _checked(self, y: npt.ArrayLike) -> Array:
        y = np.ascontiguousarray(real_numbers(y, "y"))
        if y.ndim != 2 or y.shape[1] != len(self.dictionary):
            text = f"y has shape {y.shape}: give (n_samples, {len(self.dictionary)})"
            raise ValueError(f"{text}, one flight at a time, as y[0]" if y.ndim == 3 else text)
        return y

    def last_counted(self, y: Array) -> int | None:
        """First sample that exceeds a limit, after which nothing is judged; None for none.

        y: (n, n_channels).
        """
        beyond = None if self.envelope is None else self.envelope.exceeds(y)
        return int(beyond.argmax()) if beyond is not None and beyond.any() else None

    def judge_and_withdraw(
        self, t: Array, y: Array, assessments: Assessments
    ) -> tuple[ValidityVerdict, Withdrawal | None]:
        """Verdict on a whole manoeuvre; first sample outside training and why, None if it never is.

        Samples count up to the first exceedance.   assessments: of these samples, not withdrawn.
        """
        if self.validity_basis is None:
            return ValidityVerdict(None, reasons=(NOT_CALIBRATED,)), None
        samples = self.validity_basis, t, y, assessments.state, assessments.nearest_safe
        whole, withdrawal = compare(*samples, self.last_counted(y)), None
        if (first := whole.first_outside) is not None:
            reasons = compare(*samples, first).verdict(assessments.y_hat).reasons
            withdrawal = Withdrawal(first, in_words(reasons))
        return whole.verdict(assessments.y_hat), withdrawal

    def flown_input(
        self, y: Array, end: int | None = None, planned: Array | None = None
    ) -> tuple[FlownInput, ...]:
        """How a manoeuvre's input compares with fresh flights; empty if unknown.

        y: (n, n_channels) from trim, NaN if unknown.   end: first sample that exceeds a limit, if
        any.   planned: (2,) amplitudes of aileron and rudder [rad]; None if unknown.
        """
        if self.inputs is None:
            return ()
        return self.inputs.judge(
            y if end is None else y[: end + 1], self.dt, end is not None, planned
        )

    def stream(self, epsilon: float | None = None, exemplars: bool = True) -> "Stream":
        """Start assessing one flight, sample by sample.

        exemplars: whether assessments include them.
        """
        return Stream(self, self.alert_above(epsilon), exemplars)

    def check_epsilon(self, epsilon: float | None = None) -> float:
        """The promised miss rate, that of the recipe unless given. ValueError if too small."""
        epsilon = self.recipe.epsilon if epsilon is None else epsilon
        self.alert_above(epsilon)
        return check_epsilon(epsilon, self.n_unsafe, self.recipe.guarantee)

    def alert_above(self, epsilon: float | None = None) -> float:
        """p-value above which it alerts. ValueError if the failures are too few for epsilon.

        epsilon: promised miss rate, that of the recipe unless given.
        """
        epsilon = self.recipe.epsilon if epsilon is None else epsilon
        above = alert_above(epsilon, self.n_unsafe, self.recipe.guarantee)
        if self.recipe.guarantee != "average" and above < (self._most_early + 1) / (
            self.n_unsafe + 1
        ):
            raise ValueError(
                f"epsilon={epsilon:g} with 95 % confidence would alert on every flight: "
                f"{self._most_early} of {self.n_unsafe} failures came too early for a warning: "
                "shorten t_early or raise epsilon"
                + (", or choose the scope planned" if self.recipe.is_near else "")
            )
        return above

    def lowest_scores(self, y: Array, last: Indices) -> Array:
        """Lowest score of each trajectory over samples 0..last.

        y: (n, n_samples, n_channels).   last: (n,).   Returns (n,); +inf where last < 0.
        """
        if self.forecast is not None:
            return self.forecast.lowest_scores(y, np.zeros_like(last), last)
        nothing = np.full(len(y), -1)
        return peak_risk.lowest_scores(
            self.fitted, y, self.recipe.n_delay, np.zeros_like(last), last, nothing, np.empty(0)
        )

    def highest_p_values(self, y: Array, last: Indices) -> Array:
        """Highest p-value of each trajectory over samples 0..last; 0 if last < 0. Not withdrawn."""
        if self.groups is not None:
            return self.groups.highest_p_values(y, last, self.lowest_scores)
        if self.forecast is not None:
            return np.where(last < 0, 0.0, p_values(self.lowest_scores(y, last), self.alphas))
        return peak_risk.highest_p_values(
            self.fitted, self.exact, np.ascontiguousarray(y), self.recipe.n_delay, last
        )

    def save(self, path: str | Path) -> None:
        """Write the portable file, completely or not at all."""
        with whole_file(path) as file:
            portable.write(file, self._sections())

    def to_bytes(self) -> bytes:
        return portable.pack(self._sections())

    def _sections(self) -> list[portable.Section]:
        header = {name: getattr(self, name) for name in portable.MONITOR_FIELDS} | {
            "recipe": to_plain(self.recipe),
            "theta_names": self.theta_names,
        }
        arrays = {name: getattr(self, name) for name in portable.MONITOR_ARRAYS}
        specification = {"specification": specification_to_plain(self.specification)}
        sections = [
            portable.Section("monitor", 1, True, header, arrays | self.affine._asdict()),
            portable.Section("specification", 1, True, specification, {}),
        ]
        if self.dictionary != LATERAL:
            plain = self.dictionary.to_plain()
            sections.append(portable.Section("dictionary", 1, True, plain, {}))
        if len(self.exact.start):
            plain = {"always": self.exact.always, "running": self.exact.running}
            exact = {name: getattr(self.exact, name) for name in portable.EXACT_ARRAYS}
            sections.append(portable.Section("transduction", 1, True, plain, exact))
        parts = self.forecast, self.groups, self.support, self.inputs
        sections += [part.to_section() for part in parts if part is not None]
        if self.evaluation is not None:
            sections.append(portable.Section("evaluation", 1, False, self.evaluation, {}))
        return sections

    def first_withdrawn(self, y: Array, fail_index: Indices) -> Indices:
        """First sample at which each trajectory is outside training.

        y: (n, n_samples, n_channels), finite up to the first exceedance.
        fail_index: (n,) first exceedance, n_samples for a safe flight; later samples never
        withdraw.   Returns (n,); n_samples for none.
        """
        if self.validity_basis is None:
            return np.full(len(y), y.shape[1])
        last = np.minimum(fail_index, y.shape[1] - 1)
        basis = self.validity_basis
        largest = largest_so_far(basis.reference, y, last)
        beyond: Flags = np.any(largest > basis.support.bounds(), axis=2)
        first = np.where(np.any(beyond, axis=1), np.argmax(beyond, axis=1), y.shape[1])
        if basis.input_shape is None:
            return first
        wrong = basis.input_shape.first_wrong_of(y, self.dt)
        return np.minimum(first, np.where(wrong <= last, wrong, y.shape[1]))


class Stream:
    """Assesses one flight, sample by sample.

    Once the flight is outside training, it stays invalid; without validity calibration this never
    happens.
    """

    def __init__(self, monitor: Monitor, alert_above: float, exemplars: bool = True) -> None:
        self.monitor = monitor
        self.alert_above = alert_above
        self._fitted, self._exact = monitor.fitted, monitor.exact
        self._shape = (len(monitor.dictionary),)
        self._buffer = np.zeros((monitor.recipe.n_delay + 1, *self._shape))
        self._status = np.array([0, 0, -1, -1])
        self._clock = np.array([np.nan, np.inf, np.nan, np.nan, 0.0])
        self._point = np.empty(self._fitted.d)
        basis, self._limits = monitor.validity_basis, monitor.envelope
        self._validity = basis and RunningValidity(basis)
        self._reason, self._is_ok = "", False
        self._forecast = monitor.forecast and monitor.forecast.start(monitor.dt)
        self._groups = monitor.groups and monitor.groups.start()
        has_outputs = monitor.forecast is not None and monitor.forecast.has_outputs
        self._scale = monitor.scale
        self._maps_ahead = monitor.recipe.predictor.forecasts and not has_outputs
        self._with_exemplars = exemplars
        names = monitor.theta_names, monitor.dt
        self._unsafe = _Neighbour(monitor.unsafe_where, monitor.theta_unsafe, *names)
        self._safe = _Neighbour(monitor.safe_where, monitor.theta_safe, *names)
        arrays = self._buffer, self._status, self._clock, self._point
        self._call = live_call(self._fitted, self._exact, *arrays, monitor.dt)
        self._update = compiled.entry(update_at, *self._call, 0.0, self._buffer[0])

    def update(self, t: float, y: npt.ArrayLike) -> Assessment:
        """Assess the next sample.

        t: time [s].   y: (n_channels,) in order, SI units, N_y in g; NaN if unknown.
        """
        y = np.ascontiguousarray(y, np.float64)
        if y.shape != self._shape:
            keys = self.monitor.dictionary.keys
            raise ValueError(
                f"a sample of shape {y.shape} was given: give the {len(keys)} channels "
                f"{', '.join(keys)}"
            )
        self._is_ok = False
        if self._reason:
            return withdrawn(float(t), self._reason)
        assessment = self._assess(float(t), y)
        if assessment.reason == LOST:
            self._reason = LOST
            return assessment
        if self._validity is not None:
            near = self._clock.item(3) if self._status.item(3) >= 0 else np.nan
            if self._validity.update(y, assessment, near if assessment.state is OK else np.nan):
                self._reason = in_words(self._validity.verdict.reasons)
                return withdrawn(assessment.t, self._reason)
            if self._limits is not None and self._limits.exceeds(y):
                self._validity = None  # the verdict at this moment is final
        self._is_ok = assessment.state is OK
        return assessment

    def forecast_ahead(self) -> Ahead | None:
        """Forecast of the rest of the manoeuvre at the last sample.

        None unless that sample is `ok`, and for monitors without a forecast.
        """
        return self._forecast.ahead() if self._forecast is not None and self._is_ok else None

    def _assess(self, t: float, y: Array) -> Assessment:
        code, p, s = self._update(*self._call, t, y)
        is_fresh = code != assessing.STALE
        y_hat = self._point * self._scale if self._maps_ahead else None
        if self._forecast is not None:
            s, code = self._forecast.update(t, y, code, s)
            if self._forecast.lost:
                return withdrawn(t, LOST)
            p = simple_p(self._fitted.alphas, s)
            if not self._maps_ahead:
                y_hat = self._forecast.y_hat
        if self._groups is not None and is_fresh:
            self._groups.update(y)
        if code != assessing.OK:
            return without_p_value(t, code)
        group = None
        if self._groups is not None:
            p, group = self._groups.p_value(s), self._groups.name
        unsafe = safe = None
        if self._with_exemplars:
            if (point := self._status.item(2)) >= 0:
                unsafe = self._unsafe.exemplar(point, self._clock.item(2))
            if (point := self._status.item(3)) >= 0:
                safe = self._safe.exemplar(point, self._clock.item(3))
        above = self.alert_above
        fields = (t, p, p > above, OK, "", y_hat, s, unsafe, safe, above, None, group)
        return make_assessment(Assessment, fields)


class _Neighbour:
    """Exemplars of a flight's neighbours; caches parameters, since rollouts recur.

    where: (n, 2) rollout and sample of each point.   theta: (n_rollouts, n_parameters).
    """

    def __init__(self, where: Indices, theta: Array, names: tuple[str, ...], dt: float) -> None:
        self._where, self._theta, self._names, self._dt = where, theta, names, dt
        self._parameters: dict[int, dict[str, float]] = {}

    def exemplar(self, point: int, distance: float) -> Exemplar:
        rollout = self._where.item(point, 0)
        parameters = self._parameters.get(rollout)
        if parameters is None:
            parameters = dict(zip(self._names, self._theta[rollout].tolist(), strict=True))
            self._parameters[rollout] = parameters
        return Exemplar(rollout, self._where.item(point, 1) * self._dt, distance, parameters)


def assemble(
    recipe: MonitorRecipe, affine: Affine, unsafe_points: Array, safe_points: Array, alphas: Array
) -> Fitted:
    """Build the arrays of the compiled kernels, with the search trees that the score uses."""
    searched = recipe.score.channel < 0
    return Fitted(
        *affine.in_lanes(),
        d=len(affine.offset),
        unsafe=build(unsafe_points if searched else unsafe_points[:0]),
        safe=build(safe_points if searched else safe_points[:0]),
        unsafe_weight=recipe.score.unsafe_weight,
        safe_weight=recipe.score.safe_weight,
        channel=recipe.score.channel,
        alphas=alphas,
    )


def _at(where: Flags, values: npt.NDArray) -> npt.NDArray:
    """Values of some samples; not copied if these are all."""
    return values if where.all() else values[where]


def _spread(values: npt.NDArray, where: Flags, missing: Any) -> npt.NDArray:
    """Values of some samples among all; the same array if these are all."""
    if where.all():
        return values
    spread = np.full((len(where), *values.shape[1:]), missing)
    spread[where] = values
    return spread
