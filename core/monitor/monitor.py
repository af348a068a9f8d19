"""The trained and calibrated monitor: of a batch, of a stream, as one portable file."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from core.channels import N_CHANNELS
from core.kernels import assessing as live_path
from core.kernels import peak_risk
from core.kernels.assessing import Fitted
from core.kernels.nearest import Tree, build
from core.kernels.p_value import SIMPLE, Transduction
from core.monitor import portable
from core.monitor.assessment import REASONS, STATES, Assessment, Assessments, Exemplar
from core.monitor.calibration import check_epsilon, smallest_epsilon
from core.monitor.predictor import Affine
from core.monitor.recipe import MonitorRecipe
from core.monitor.support import Support
from core.recipe import from_plain
from core.types import Array, Flags, Indices
from core.whole_file import write_whole


@dataclass(frozen=True, eq=False)
class Monitor:
    """A safety monitor for one manoeuvre.

    dt: sample interval [s].   h: lead in samples.
    scale: (6,) units of the channels in which distances count.
    reach: (6,) largest magnitude of each channel among the rollouts it learned from.
    unsafe_points, safe_points: (n, d) mapped.   unsafe_where, safe_where: (n, 2) the rollout and
    the sample each point comes from.   theta_unsafe, theta_safe: (n, n_parameters) of rollouts.
    n_early: failures that came before any warning could; their calibration score is +inf.
    fitted, exact: arrays of the compiled path.
    dataset_recipe, dataset_digest, seed, version: where it comes from.
    support: how far fresh flights stray from what it learned; None where that is not calibrated.
    """

    recipe: MonitorRecipe
    dt: float
    h: int
    scale: Array
    reach: Array
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
    support: Support | None = None

    @property
    def alphas(self) -> Array:
        """(n_unsafe,) sorted calibration scores."""
        return self.fitted.alphas

    @property
    def affine(self) -> Affine:
        """The predictor's map from an observation in SI units to a point."""
        return Affine(self.fitted.matrix[:, : self.fitted.d], self.fitted.offset[: self.fitted.d])

    @cached_property
    def safe_tree(self) -> Tree:
        """Search tree of the safe points, whether or not the score looks them up."""
        built = len(self.fitted.safe.slot) == len(self.safe_points)
        return self.fitted.safe if built else build(self.safe_points)

    @property
    def n_unsafe(self) -> int:
        """Failures it is calibrated on."""
        return len(self.alphas)

    @property
    def lead(self) -> float:
        """Lead in effect, h * dt [s]."""
        return self.h * self.dt

    @property
    def smallest_epsilon(self) -> float:
        """Smallest epsilon its failures can serve."""
        return smallest_epsilon(self.n_unsafe)

    def p_values(self, y: npt.ArrayLike) -> Array:
        """p-value of each sample of a trajectory sampled at the monitor's dt.

        y: (n_samples, 6) channels in order, SI units, N_y in g.
        Returns (n_samples,) in [1/(n_unsafe+1), 1]; NaN where a sample or its history is invalid.
        """
        y = _checked(y)
        return self.assess(np.arange(len(y)) * self.dt, y).p_value

    def assess(
        self, t: npt.ArrayLike, y: npt.ArrayLike, epsilon: float | None = None
    ) -> Assessments:
        """Assess every sample of a trajectory; the same bits as a stream of its samples.

        t: (n,) [s].   y: (n, 6).   epsilon: the recipe's unless given.
        """
        t, y = np.ascontiguousarray(t, np.float64), _checked(y)
        if t.shape != (len(y),):
            raise ValueError(f"t has shape {t.shape}: it needs one time a sample, ({len(y)},)")
        epsilon = self.check_epsilon(epsilon)
        state = live_path.states(t, y, self.dt, self.recipe.n_delay)
        fresh = state != live_path.STALE
        z, s, p, unsafe, safe = live_path.score_all(
            self.fitted, self.exact, y[fresh], state[fresh] == live_path.OK, self.recipe.n_delay
        )
        result = Assessments(
            t=t,
            state=state,
            p_value=_spread(p, fresh, np.nan),
            alert=_spread(p > epsilon, fresh, False),
            score=_spread(s, fresh, np.nan),
            y_hat=np.full((len(y), N_CHANNELS), np.nan),
            nearest_unsafe=_spread(unsafe, fresh, -1),
            nearest_safe=_spread(safe, fresh, -1),
        )
        if self.recipe.predictor.forecasts:
            result.y_hat[fresh] = z * self.scale
        return result

    def stream(self, epsilon: float | None = None) -> "Stream":
        """Start assessing one flight, sample by sample."""
        return Stream(self, self.check_epsilon(epsilon))

    def check_epsilon(self, epsilon: float | None = None) -> float:
        """Return the epsilon to alert at, the recipe's unless given; ValueError if too small."""
        return check_epsilon(self.recipe.epsilon if epsilon is None else epsilon, self.n_unsafe)

    def lowest_scores(self, y: Array, last: Indices) -> Array:
        """Lowest score of each trajectory over samples 0..last.

        y: (n, n_samples, 6).   last: (n,).   Returns (n,); +inf where last < 0.
        """
        nothing = np.full(len(y), -1)
        return peak_risk.lowest_scores(
            self.fitted, y, self.recipe.n_delay, np.zeros_like(last), last, nothing, np.empty(0)
        )

    def highest_p_values(self, y: Array, last: Indices) -> Array:
        """Highest p-value of each trajectory over samples 0..last; 0 where last < 0."""
        return peak_risk.highest_p_values(
            self.fitted, self.exact, np.ascontiguousarray(y), self.recipe.n_delay, last
        )

    def unsafe_exemplar(self, point: int, distance: float) -> Exemplar:
        """The failed rollout behind an unsafe point, at the sample t_early before it failed."""
        rollout, sample = self.unsafe_where[point].tolist()
        return self._exemplar(rollout, sample, distance, self.theta_unsafe)

    def safe_exemplar(self, point: int, distance: float) -> Exemplar:
        """The safe rollout behind a safe point, at the sample it was observed."""
        rollout, sample = self.safe_where[point].tolist()
        return self._exemplar(rollout, sample, distance, self.theta_safe)

    def _exemplar(self, rollout: int, sample: int, distance: float, theta: Array) -> Exemplar:
        parameters = dict(zip(self.theta_names, theta[rollout].tolist(), strict=True))
        return Exemplar(rollout, sample * self.dt, distance, parameters)

    def save(self, path: str | Path) -> None:
        """Write the portable file: whole, or not at all."""
        write_whole(path, portable.to_bytes(self))


class Stream:
    """One flight through a monitor, sample by sample."""

    def __init__(self, monitor: Monitor, epsilon: float) -> None:
        self.monitor = monitor
        self.epsilon = epsilon
        self._fitted, self._exact = monitor.fitted, monitor.exact
        self._buffer = np.zeros((monitor.recipe.n_delay + 1, N_CHANNELS))
        self._status = np.array([0, 0, -1, -1])
        self._clock = np.array([np.nan, np.inf, np.nan, np.nan, 0.0])
        self._point = np.empty(self._fitted.d)

    def update(self, t: float, y: npt.ArrayLike) -> Assessment:
        """Assess the next sample.

        t: time [s].   y: (6,) channels in order, SI units, N_y in g; NaN where unknown.
        """
        y = np.ascontiguousarray(y, np.float64)
        if y.shape != (N_CHANNELS,):
            raise ValueError(
                f"a sample of shape {y.shape} was given: it needs the 6 channels, (6,)"
            )
        t = float(t)
        code, p, s = live_path.update(
            self._fitted,
            self._exact,
            self._buffer,
            self._status,
            self._clock,
            self.monitor.dt,
            t,
            y,
            self._point,
        )
        if code != live_path.OK:
            return Assessment(t, None, None, STATES[code], REASONS[code])
        monitor, z = self.monitor, self._point
        unsafe, safe = self._status[2], self._status[3]
        return Assessment(
            t=t,
            p_value=p,
            alert=p > self.epsilon,
            state=STATES[code],
            y_hat=z * monitor.scale if monitor.recipe.predictor.forecasts else None,
            score=s,
            nearest_unsafe=monitor.unsafe_exemplar(unsafe, self._clock[2]) if unsafe >= 0 else None,
            nearest_safe=monitor.safe_exemplar(safe, self._clock[3]) if safe >= 0 else None,
        )


def assemble(
    recipe: MonitorRecipe, affine: Affine, unsafe_points: Array, safe_points: Array, alphas: Array
) -> Fitted:
    """Build the arrays of the compiled path, search trees included where they are looked up."""
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


def load(path: str | Path) -> Monitor:
    """Read a portable monitor; portable.MonitorFileError says what is wrong with the file."""
    return from_bytes(portable.read(path), str(path))


def from_bytes(blob: bytes, name: str = "monitor") -> Monitor:
    """Read a portable monitor from memory; `name` is what errors call it."""
    header, arrays = portable.unpack(blob, name)
    try:
        return _rebuild(header, arrays)
    except KeyError as error:
        raise portable.MonitorFileError(
            f"{name} has no {error}: it was written by an older program, train the monitor again"
        ) from error
    except (TypeError, ValueError) as error:
        raise portable.MonitorFileError(
            f"{name} holds a monitor that this program cannot rebuild ({error}): upgrade forewarn "
            "or train the monitor again"
        ) from error


def _rebuild(header: dict[str, Any], arrays: dict[str, Any]) -> Monitor:
    recipe = from_plain(MonitorRecipe(), header["recipe"])
    affine = Affine(arrays.pop("matrix"), arrays.pop("offset"))
    exact = Transduction(
        **{key: arrays.pop(f"exact_{key}") for key in portable.EXACT_ARRAYS}, **header["exact"]
    )
    support = _support(header, arrays)
    _check_arrays(recipe, affine, exact, header, arrays)
    fitted = assemble(
        recipe, affine, arrays["unsafe_points"], arrays["safe_points"], arrays.pop("alphas")
    )
    return Monitor(
        recipe=recipe,
        fitted=fitted,
        exact=exact,
        theta_names=tuple(header["theta_names"]),
        support=support,
        **{key: header[key] for key in portable.HEADER_FIELDS},
        **arrays,
    )


def _support(header: dict[str, Any], arrays: dict[str, Any]) -> Support | None:
    """Take the support out of the arrays; a file without one was written by an older program, or
    for a monitor whose validity is not calibrated.
    """
    if not header.get("support"):
        return None
    parts = {key: arrays.pop(f"support_{key}") for key in portable.SUPPORT_ARRAYS}
    support = Support(**parts, **header["support"])
    support.check()
    return support


def _check_arrays(
    recipe: MonitorRecipe,
    affine: Affine,
    exact: Transduction,
    header: dict[str, Any],
    arrays: dict[str, Any],
) -> None:
    """Refuse arrays that do not fit together: kernels trust them without looking again."""
    d, n_parameters = len(affine.offset), len(header["theta_names"])
    if recipe.predictor.maps_to_outputs and d != N_CHANNELS:
        raise ValueError(f"its points have {d} entries instead of {N_CHANNELS}")
    n_failures, n_samples = len(exact.alphas), len(exact.points)
    shapes = {
        "matrix": (affine.matrix, (N_CHANNELS * (recipe.n_delay + 1), d)),
        "offset": (affine.offset, (d,)),
        "scale": (arrays["scale"], (N_CHANNELS,)),
        "reach": (arrays["reach"], (N_CHANNELS,)),
        "alphas": (arrays["alphas"], (len(arrays["alphas"]),)),
        "exact points": (exact.points, (n_samples, d if n_samples else 1)),
        "exact unsafe": (exact.unsafe, (n_samples,)),
        "exact safe": (exact.safe, (n_samples,)),
        "exact alphas": (exact.alphas, (n_failures,)),
    }
    counts = [("exact start", exact.start, n_samples)] if len(exact.start) else []
    for side in ("unsafe", "safe"):
        points, where = arrays[f"{side}_points"], arrays[f"{side}_where"]
        theta = arrays[f"theta_{side}"]
        shapes[f"{side} points"] = (points, (len(points), d))
        shapes[f"theta {side}"] = (theta, (len(theta), n_parameters))
        if where.shape != (len(points), 2):
            raise ValueError(f"{side} where has shape {where.shape}")
        counts.append((f"{side} where", where[:, 0], len(theta) - 1))
    for name, (array, shape) in shapes.items():
        if array.dtype != np.float64 or array.shape != shape:
            raise ValueError(f"{name} is {array.dtype} {array.shape} instead of float64 {shape}")
    for name, array, most in counts:
        if array.dtype != np.int64 or (len(array) and not 0 <= array.min() <= array.max() <= most):
            raise ValueError(f"{name} holds numbers outside 0 to {most}")
    if len(exact.start) and (
        len(exact.start) != n_failures + 1 or (np.diff(exact.start) < 0).any()
    ):
        raise ValueError("exact start does not delimit the failures' histories")
    if len(exact.points) and not len(exact.start):
        raise ValueError("exact points belong to no failure")


def _checked(y: npt.ArrayLike) -> Array:
    y = np.ascontiguousarray(y, np.float64)
    if y.ndim != 2 or y.shape[1] != N_CHANNELS:
        raise ValueError(f"y has shape {y.shape}: it needs (n_samples, {N_CHANNELS})")
    return y


def _spread(values: npt.NDArray, where: Flags, missing: Any) -> npt.NDArray:
    spread = np.full(len(where), missing)
    spread[where] = values
    return spread
