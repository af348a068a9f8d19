"""The whole method as one would glue it together from python-control, numpy and scikit-learn.

Written to be read, not to be fast, and independent of `core` and `app`: the oracle that the
compiled code is compared with, and the peer that it is timed against.

y = (beta [rad], p [rad/s], r [rad/s], N_y [g], delta_a [rad], delta_r [rad]), T samples, the first
at t = 0; times in s; h = lead in samples. A low score is dangerous, a high p-value is.
"""

from collections.abc import Callable, Sequence
from itertools import product
from math import ceil

import control
import numpy as np
import numpy.typing as npt
from sklearn.decomposition import PCA
from sklearn.neighbors import KDTree

from core.types import Array

Map = Callable[[Array], Array]  # predictor: (m, d) -> (m, d'); distance and score: (m, d) -> (m,)

# F-16 of Stevens & Lewis (502 ft/s, sea level): rows Y, L, N; columns beta, p, r, delta_a, delta_r.
ALPHA0, V_OVER_G = np.deg2rad(2.1147872218278683), 502 / 32.174
DERIVATIVES = np.array(
    [
        [-0.322, 0.0364 - np.sin(ALPHA0), -0.9917 + np.cos(ALPHA0), 0.017189, 0.045837],
        [-30.6492, -3.6784, 0.6646, -42.014995, 7.534395],
        [8.5396, -0.0254, -0.4764, -1.827735, -3.552338],
    ]
)
SIGMA = np.array(  # one standard deviation, as a fraction
    [
        [0.10, 0.30, 0.30, 0.30, 0.15],
        [0.15, 0.10, 0.25, 0.10, 0.25],
        [0.10, 0.30, 0.20, 0.30, 0.10],
    ]
)


# --- simulation ----------------------------------------------------------------------------------


def sample_derivatives(rng: np.random.Generator, distribution: str = "uniform") -> Array:
    """Draw (3, 5) derivatives: "uniform" within 20 %, or "normal" with the published scatter."""
    if distribution == "uniform":
        return DERIVATIVES * (1 + rng.uniform(-0.2, 0.2, (3, 5)))
    return DERIVATIVES * (1 + SIGMA * rng.standard_normal((3, 5)))


def plant(derivatives: Array) -> tuple[Array, Array, Array, Array]:
    """A, B, C, D of the 3-state aircraft; N_y = (V/g) times the aerodynamic part of beta_dot."""
    kinematic = np.zeros((3, 3))
    kinematic[0] = 0, np.sin(ALPHA0), -np.cos(ALPHA0)
    ny = V_OVER_G * derivatives[0]
    c = np.vstack([np.eye(3), ny[:3], np.zeros((2, 3))])
    d = np.vstack([np.zeros((3, 2)), ny[3:], np.eye(2)])
    return derivatives[:, :3] + kinematic, derivatives[:, 3:], c, d


def damper(k_r: float = -0.5, k_p: float = -0.1) -> control.StateSpace:
    """K of u_cmd = pilot - K y: rudder k_r s/(s+1) r, aileron k_p p; the defaults damp the F-16."""
    b, d = np.zeros((1, 6)), np.zeros((2, 6))
    b[0, 2], d[0, 1], d[1, 2] = 1, k_p, k_r
    return control.StateSpace([[-1.0]], b, [[0.0], [-k_r]], d)


def first_order(bandwidth: float) -> control.StateSpace:
    """Two channels of bandwidth / (s + bandwidth)."""
    eye = np.eye(2)
    return control.StateSpace(-bandwidth * eye, bandwidth * eye, eye, 0 * eye)


def closed_loop(
    a: Array,
    b: Array,
    c: Array,
    d: Array,
    k: control.StateSpace | None = None,
    bandwidth: float | None = 20.2,
    pedal_lag: float = 0.0,
) -> control.StateSpace:
    """Continuous system from pilot command (2) to y (6).

    u_cmd = lagged pilot - K y;  delta_dot = bandwidth (u_cmd - delta), or delta = u_cmd for None.
    """
    loop = control.StateSpace(a, b, c, d)
    if bandwidth is not None:
        loop = loop * first_order(bandwidth)
    if k is not None:
        loop = control.feedback(loop, k, sign=-1)  # pyright: ignore[reportArgumentType]
    return loop if pedal_lag == 0 else loop * first_order(1 / pedal_lag)


def rollout(system: control.StateSpace, pilot: Array, dt: float) -> Array:
    """Response (T, 6) from rest to commands (T, 2) that are held over each step."""
    times = dt * np.arange(len(pilot))
    discrete = control.sample_system(system, dt, method="zoh")
    return control.forced_response(discrete, times, pilot.T).outputs.T  # pyright: ignore


def rudder_doublet(amplitude: float, dt: float = 0.05, duration: float = 6.0) -> Array:
    """Commands (T, 2) [rad]: +amplitude for 1 s from 0.5 s, then -amplitude for 1 s."""
    pilot = np.zeros((round(duration / dt) + 1, 2))
    start, reversal, end = (round(t / dt) for t in (0.5, 1.5, 2.5))
    pilot[start:reversal, 1] = amplitude
    pilot[reversal:end, 1] = -amplitude
    return pilot


def first_exceedance(y: Array, channel: int = 3, limit: float = 0.5) -> int:
    """First sample with |y[channel]| >= limit, or T where there is none."""
    violations = np.flatnonzero(np.abs(y[:, channel]) >= limit)
    return int(violations[0]) if len(violations) else len(y)


def collect(
    sample_rollout: Callable[[], Array], n_unsafe: int, max_rollouts: int = 1_000_000
) -> tuple[list[Array], list[Array]]:
    """Unsafe trajectories, each cut at its failure (its last row), and the safe ones met so far."""
    unsafe, safe = [], []
    while len(unsafe) < n_unsafe:
        y = sample_rollout()
        fail = first_exceedance(y)
        if fail < len(y):
            unsafe.append(y[: fail + 1])
        else:
            safe.append(y)
        if len(unsafe) + len(safe) > max_rollouts:
            raise RuntimeError(
                f"{len(unsafe)} unsafe in {max_rollouts} rollouts; {n_unsafe} needed"
            )
    return unsafe, safe


# --- observations and predictors -----------------------------------------------------------------


def observations(y: Array, n_delay: int = 2) -> Array:
    """Rows (y_{t-n_delay}, ..., y_t), oldest first; before the start the first sample repeats."""
    t = np.arange(len(y))
    return np.hstack([y[np.maximum(t - lag, 0)] for lag in range(n_delay, -1, -1)])


def lead_steps(t_early: float, dt: float) -> int:
    """Samples between the last timely alert and the failure."""
    return ceil(t_early / dt - 1e-9)


def channel_scale(safe: Sequence[Array]) -> Array:
    """Standard deviation (6,) of each output over all safe samples; 1 for a constant channel."""
    spread = np.std(np.vstack(safe), axis=0)
    return np.where(spread > 0, spread, 1.0)


def safe_observations(
    safe: Sequence[Array], times: Sequence[npt.NDArray[np.int64]], h: int, n_delay: int = 2
) -> tuple[Array, Array, Array]:
    """All sampled observations, those with a sample h steps on, and those samples."""
    pairs = list(zip(safe, times, strict=True))
    observed = np.vstack([observations(y, n_delay)[t] for y, t in pairs])
    paired = np.vstack([observations(y, n_delay)[t[t + h < len(y)]] for y, t in pairs])
    ahead = np.vstack([y[t[t + h < len(y)] + h] for y, t in pairs])
    return observed, paired, ahead


def fit_linear(observed: Array, paired: Array, ahead: Array) -> Map:
    """y_hat = M o + mu; scikit-learn's own drops directions below 1e-6 of the first."""
    o_mean, y_mean = paired.mean(axis=0), ahead.mean(axis=0)
    slopes = np.linalg.lstsq(paired - o_mean, ahead - y_mean, rcond=None)[0]
    return lambda o: y_mean + (o - o_mean) @ slopes


def fit_identity(observed: Array, paired: Array, ahead: Array) -> Map:
    """No prediction: the observation itself."""
    return lambda o: o


def fit_pca(observed: Array, paired: Array, ahead: Array) -> Map:
    """The first six principal components of the safe observations."""
    return PCA(n_components=6).fit(observed).transform


def fit_last_output(observed: Array, paired: Array, ahead: Array) -> Map:
    """The output now."""
    return lambda o: o[:, -6:]


# --- scores --------------------------------------------------------------------------------------


FEW = 50
"""Points that are sooner gone through than put into a tree."""


def nearest(points: Array) -> Map:
    """Squared distance from each row of z to the nearest of `points`; +inf where there is none."""
    if len(points) == 0:
        return lambda z: np.full(len(z), np.inf)
    if len(points) <= FEW:
        return lambda z: ((z[:, None] - points) ** 2).sum(axis=-1).min(axis=1)
    tree = KDTree(points)

    def squared_distance(z: Array) -> Array:
        if len(z) == 0:
            return np.empty(0)
        index = tree.query(z, return_distance=False)[:, 0]
        return ((z - points[index]) ** 2).sum(axis=1)

    return squared_distance


Score = Callable[[Map, Map], Map]  # (distance to unsafe, distance to safe) -> score of points
SCORES: dict[str, Score] = {
    "nearest neighbour": lambda unsafe, safe: lambda z: unsafe(z) - safe(z),
    "unsafe only": lambda unsafe, safe: unsafe,
    "safe only": lambda unsafe, safe: lambda z: -safe(z),
    "|Ny|": lambda unsafe, safe: lambda z: -np.abs(z[:, 3]),
}


# --- calibration and p-values --------------------------------------------------------------------
# `flights`: of each unsafe trajectory the mapped points z_0 ... z_{t_fail-h}; empty if t_fail < h.


def timely_part(z: Array, fail: int, h: int) -> Array:
    """The points at which an alert comes in time: 0 ... fail - h."""
    return z[: max(fail - h + 1, 0)]


def error_points(flights: Sequence[Array]) -> Array:
    """The unsafe set: the last timely point of each unsafe flight."""
    last = [z[-1] for z in flights if len(z)]
    return np.array(last) if last else np.empty((0, flights[0].shape[1]))


def without(flights: Sequence[Array], i: int) -> list[Array]:
    """The flights with nothing left of flight i."""
    return [z[:0] if j == i else z for j, z in enumerate(flights)]


def calibrate(flights: Sequence[Array], safe: Array, score: Score, level: str) -> Array:
    """alpha_i (n_unsafe,), in order: the score of flight i with its own unsafe point left out.

    level "pointwise": at t_fail - h (the paper); "trajectory": the lowest up to t_fail - h.
    """
    to_safe, alphas = nearest(safe), []
    for i, z in enumerate(flights):
        s = score(nearest(error_points(without(flights, i))), to_safe)
        own = z if level == "trajectory" else z[-1:]
        alphas.append(s(own).min() if len(z) else np.inf)
    return np.array(alphas)


def p_values(scores: Array, alphas: Array) -> Array:
    """(1 + #{alpha_i >= s}) / (n_unsafe + 1)."""
    at_least = len(alphas) - np.searchsorted(np.sort(alphas), scores, side="left")
    return (1 + at_least) / (len(alphas) + 1)


def exact_p_value(z: Array, unsafe: Array, safe: Array, score: Score, n_early: int = 0) -> float:
    """Full conformal p of one point z (d,): refit with z in the unsafe set, then count.

    n_early: unsafe flights without an unsafe point (alpha = +inf).
    """
    flights = [point[None] for point in (*unsafe, z)]
    *alphas, own = calibrate(flights, safe, score, "pointwise")
    return float(1 + n_early + sum(alpha >= own for alpha in alphas)) / (len(flights) + n_early)


def exact_trajectory_p_values(z: Array, flights: Sequence[Array], safe: Array) -> Array:
    """Full conformal p (T,) of the flight z_0 ... z_{T-1}, nearest neighbour, trajectory level.

    At t: s = min_{t' <= t} s(z_t');  alpha_i = min_t' min(u_{i,t'}, |y_{i,t'} - z_t|^2) - v_{i,t'}.
    """
    to_unsafe, to_safe, p = nearest(error_points(flights)), nearest(safe), []
    lowest = np.minimum.accumulate(to_unsafe(z) - to_safe(z))
    others = [nearest(error_points(without(flights, i))) for i in range(len(flights))]
    u = [other(y) for other, y in zip(others, flights, strict=True)]
    v = [to_safe(y) for y in flights]
    for z_t, s in zip(z, lowest, strict=True):
        alphas = [
            (np.minimum(u_i, ((y_i - z_t) ** 2).sum(axis=1)) - v_i).min() if len(y_i) else np.inf
            for u_i, v_i, y_i in zip(u, v, flights, strict=True)
        ]
        p.append((1 + sum(alpha >= s for alpha in alphas)) / (len(flights) + 1))
    return np.array(p)


# --- evaluation ----------------------------------------------------------------------------------


def evaluate(
    p: Sequence[Array], fails: Sequence[int], h: int, epsilons: Array
) -> tuple[Array, Array]:
    """Miss rate and power at each epsilon, from p (T,) and t_fail (T if safe) of each test flight.

    Miss: share of unsafe flights with no p > epsilon up to t_fail - h. Power: share of safe
    flights with none at all. NaN where the test set has no such flight.
    """
    silent_unsafe, silent_safe = [], []
    for p_j, fail in zip(p, fails, strict=True):
        if fail < len(p_j):
            silent_unsafe.append(~(timely_part(p_j, fail, h)[:, None] > epsilons).any(axis=0))
        else:
            silent_safe.append(~(p_j[:, None] > epsilons).any(axis=0))
    nothing = np.full(len(epsilons), np.nan)
    miss = np.mean(silent_unsafe, axis=0) if silent_unsafe else nothing
    power = np.mean(silent_safe, axis=0) if silent_safe else nothing
    return miss, power


METHODS: dict[str, tuple[Callable[[Array, Array, Array], Map], str]] = {
    "linear + nearest neighbour": (fit_linear, "nearest neighbour"),
    "identity + nearest neighbour": (fit_identity, "nearest neighbour"),
    "pca + nearest neighbour": (fit_pca, "nearest neighbour"),
    "last output + |Ny|": (fit_last_output, "|Ny|"),
    "linear + |Ny|": (fit_linear, "|Ny|"),
}


def monitor_p_values(
    unsafe: Sequence[Array],
    safe: Sequence[Array],
    safe_times: Sequence[npt.NDArray[np.int64]],
    tests: Array,
    method: str,
    h: int,
    n_delay: int = 2,
    scaled: bool = False,
    level: str = "pointwise",
) -> tuple[Array, Array]:
    """Train one monitor and fly it on tests (n_test, T, 6).

    Returns alphas (n_unsafe,), in order, and p-values (n_test, T). `scaled` divides every output by
    its `channel_scale` first, else units stay raw as in the paper.
    """
    fit, score_name = METHODS[method]
    scale = channel_scale(safe) if scaled else np.ones(6)
    unsafe, safe, tests = [y / scale for y in unsafe], [y / scale for y in safe], tests / scale
    observed, paired, ahead = safe_observations(safe, safe_times, h, n_delay)
    predict = fit(observed, paired, ahead)
    flights = [timely_part(predict(observations(y, n_delay)), len(y) - 1, h) for y in unsafe]
    safe_points = predict(observed)
    alphas = calibrate(flights, safe_points, SCORES[score_name], level)
    score = SCORES[score_name](nearest(error_points(flights)), nearest(safe_points))
    flown = predict(np.vstack([observations(y, n_delay) for y in tests]))
    return alphas, p_values(score(flown), alphas).reshape(tests.shape[:2])


def study(
    n_monitors: int = 10,
    n_unsafe: int = 50,
    n_obs: int = 50,
    n_test: int = 500,
    epsilons: Array | None = None,
    amplitude_deg: float = 5.0,
    k: control.StateSpace | None = None,
    bandwidth: float | None = 20.2,
    pedal_lag: float = 0.0,
    distribution: str = "uniform",
    dt: float = 0.05,
    t_early: float = 0.25,
    scaled: bool = False,
    levels: Sequence[str] = ("pointwise",),
    seed: int = 0,
) -> dict[str, dict[str, tuple[Array, Array]]]:
    """The paper's experiment, on the F-16: calibration level -> method -> (miss, power).

    miss, power: (n_monitors, n_epsilons). Each monitor has its own training rollouts and its own
    n_test fresh ones; the levels share them.
    """
    rng = np.random.default_rng(seed)
    pilot, h = rudder_doublet(np.deg2rad(amplitude_deg), dt), lead_steps(t_early, dt)
    grid = np.linspace(0.02, 1, 50) if epsilons is None else epsilons

    def sample_rollout() -> Array:
        matrices = plant(sample_derivatives(rng, distribution))
        return rollout(closed_loop(*matrices, k, bandwidth, pedal_lag), pilot, dt)

    curves: dict[str, dict[str, list[tuple[Array, Array]]]] = {
        level: {method: [] for method in METHODS} for level in levels
    }
    for _ in range(n_monitors):
        unsafe, safe = collect(sample_rollout, n_unsafe)
        times = [rng.choice(len(pilot), n_obs, replace=False) for _ in safe]
        tests = np.array([sample_rollout() for _ in range(n_test)])
        fails = [first_exceedance(y) for y in tests]
        for level, method in product(levels, METHODS):
            _, p = monitor_p_values(
                unsafe, safe, times, tests, method, h, scaled=scaled, level=level
            )
            curves[level][method].append(evaluate(list(p), fails, h, grid))
    return {
        level: {
            method: (np.array([miss for miss, _ in pairs]), np.array([power for _, power in pairs]))
            for method, pairs in methods.items()
        }
        for level, methods in curves.items()
    }
