"""The plain twin is itself right: closed forms, hand counts and published numbers."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

from tests.support import plain_twin as twin
from tests.support.plain_twin import Array

DT = 0.05
LEVELS = ("pointwise", "trajectory")
EPSILONS = np.array([0.1, 0.3, 0.5])


def discretised_by_hand(a: Array, b: Array, pilot: Array) -> Array:
    """States (T, n) from rest under held inputs: exp of the matrix joined with its inputs."""
    n, m = b.shape
    step = expm(DT * np.block([[a, b], [np.zeros((m, n + m))]]))
    x = [np.zeros(n)]
    for u in pilot[:-1]:
        x.append(step[:n, :n] @ x[-1] + step[:n, n:] @ u)
    return np.array(x)


def test_rollout_with_damper_and_actuators_equals_the_matrix_exponential() -> None:
    a, b, c, d = twin.plant(twin.sample_derivatives(np.random.default_rng(1)))
    pilot = np.random.default_rng(2).standard_normal((40, 2))
    w = 20.2  # states: beta, p, r, delta_a, delta_r, washed-out part of r
    loop, into = np.zeros((6, 6)), np.zeros((6, 2))
    loop[:3, :3], loop[:3, 3:5] = a, b
    loop[3:5, 3:5] = -w * np.eye(2)
    loop[3, 1] += w * 0.1  # aileron: pilot + 0.1 p
    loop[4, 2] += w * 0.5  # rudder: pilot + 0.5 (r - x_w)
    loop[4, 5] -= w * 0.5
    loop[5, 2], loop[5, 5] = 1, -1
    into[3:5] = w * np.eye(2)
    x = discretised_by_hand(loop, into, pilot)
    expected = x[:, :3] @ c.T + x[:, 3:5] @ d.T
    y = twin.rollout(twin.closed_loop(a, b, c, d, twin.damper()), pilot, DT)
    np.testing.assert_allclose(y, expected, rtol=1e-9, atol=1e-10)


def test_pedal_lag_is_first_order() -> None:
    matrices = twin.plant(twin.DERIVATIVES)
    system = twin.closed_loop(*matrices, bandwidth=None, pedal_lag=0.1)
    y = twin.rollout(system, np.tile([0.0, 1.0], (20, 1)), DT)
    np.testing.assert_allclose(y[:, 5], 1 - np.exp(-DT * np.arange(20) / 0.1), atol=1e-12)


def test_nominal_plant_is_the_published_f16() -> None:
    """Rows of C and D and the three-state Dutch roll as tabulated for Stevens & Lewis' F-16."""
    a, _, c, d = twin.plant(twin.DERIVATIVES)
    rounding = 0.5e-6 * twin.V_OVER_G  # of the derivatives, which are printed to six decimals
    np.testing.assert_allclose(c[3], [-5.024057, -0.007827, 0.118875], atol=rounding)
    np.testing.assert_allclose(d[3], [0.26819, 0.715173], atol=rounding)
    dutch = np.linalg.eigvals(a)[np.argmax(np.linalg.eigvals(a).imag)]
    assert abs(dutch) == pytest.approx(3.0534, abs=1e-4)
    assert -dutch.real / abs(dutch) == pytest.approx(0.1567, abs=1e-4)


def test_damper_damps_the_dutch_roll() -> None:
    loop = twin.closed_loop(*twin.plant(twin.DERIVATIVES), twin.damper())
    poles = np.linalg.eigvals(np.asarray(loop.A))
    oscillatory = poles[poles.imag > 1e-6]
    dutch = oscillatory[np.argmin(abs(oscillatory))]
    assert 0.3 <= -dutch.real / abs(dutch) <= 0.5


@pytest.mark.parametrize("n", [500, pytest.param(2000, marks=pytest.mark.fuzz)])
def test_rudder_amplitude_table_holds_with_actuators_and_without_pedal_lag(n: int) -> None:
    """Published: P(unsafe) = 10 / 25 / 40 % at 4.6 / 5.0 / 5.4 deg, 3 states, no feedback.

    Tolerance: 3 binomial standard errors of n draws here and 4000 there, and 0.02 because the
    amplitudes are printed to 0.1 deg (P rises by about 0.37 a degree).
    """
    rng = np.random.default_rng(3)
    pilot = twin.rudder_doublet(1.0, duration=3.0)  # the peak follows the end at 2.5 s at once
    peak = np.array(  # of the response to 1 rad: the loop is linear
        [
            np.abs(twin.rollout(twin.closed_loop(*twin.plant(theta)), pilot, DT)[:, 3]).max()
            for theta in (twin.sample_derivatives(rng) for _ in range(n))
        ]
    )
    for degrees, published in ((4.6, 0.10), (5.0, 0.25), (5.4, 0.40)):
        unsafe = np.mean(peak * np.deg2rad(degrees) >= 0.5)
        error = np.sqrt(published * (1 - published) * (1 / n + 1 / 4000))
        assert abs(unsafe - published) <= 3 * error + 0.02


def test_normal_derivatives_scatter_by_the_published_fractions() -> None:
    rng, n = np.random.default_rng(4), 4000
    theta = np.array([twin.sample_derivatives(rng, "normal") for _ in range(n)])
    fraction = theta.std(axis=0) / np.abs(twin.DERIVATIVES)
    np.testing.assert_allclose(fraction, twin.SIGMA, rtol=5 / np.sqrt(2 * n))


def test_doublet_reverses_after_one_second() -> None:
    rudder = twin.rudder_doublet(2.0)[:, 1]
    assert len(rudder) == 121
    assert list(rudder[[9, 10, 29, 30, 49, 50]]) == [0, 2, 2, -2, -2, 0]


def test_the_limit_itself_is_unsafe() -> None:
    y = np.zeros((4, 6))
    assert twin.first_exceedance(y) == 4
    y[2, 3] = -0.5
    assert twin.first_exceedance(y) == 2


def test_collection_cuts_at_the_failure_and_keeps_the_safe() -> None:
    peaks = iter([0.1, 0.75, 0.2, 0.3, 0.6])

    def sample_rollout() -> Array:
        return np.outer(np.linspace(0, next(peaks), 8), np.ones(6))

    unsafe, safe = twin.collect(sample_rollout, 2)
    assert [len(y) for y in unsafe] == [6, 7]
    assert [y[-1, 3] for y in safe] == pytest.approx([0.1, 0.2, 0.3])


def test_collection_gives_up_where_nothing_fails() -> None:
    with pytest.raises(RuntimeError, match="0 unsafe in 3 rollouts"):
        twin.collect(lambda: np.zeros((2, 6)), 1, max_rollouts=3)


def test_observations_are_oldest_first_and_repeat_the_first_sample() -> None:
    y = np.arange(4.0)[:, None] * np.ones(6)
    assert twin.observations(y)[:, ::6].tolist() == [[0, 0, 0], [0, 0, 1], [0, 1, 2], [1, 2, 3]]


@pytest.mark.parametrize(("t_early", "dt", "h"), [(0.25, 0.05, 5), (0.3, 0.1, 3), (0.26, 0.05, 6)])
def test_lead_rounds_up_but_not_because_of_floats(t_early: float, dt: float, h: int) -> None:
    assert twin.lead_steps(t_early, dt) == h


def test_safe_pairs_end_h_before_the_trajectory_does() -> None:
    y = np.arange(10.0)[:, None] * np.ones(6)
    observed, paired, ahead = twin.safe_observations([y], [np.array([1, 6, 7, 9])], h=3)
    assert observed[:, -1].tolist() == [1, 6, 7, 9]
    assert paired[:, -1].tolist() == [1, 6]
    assert ahead[:, 0].tolist() == [4, 9]


def test_predictors() -> None:
    rng = np.random.default_rng(5)
    o, m, mu = rng.standard_normal((60, 18)), rng.standard_normal((18, 6)), rng.standard_normal(6)
    np.testing.assert_allclose(twin.fit_linear(o, o, o @ m + mu)(o), o @ m + mu, atol=1e-10)
    assert twin.fit_identity(o, o, o)(o) is o
    assert (twin.fit_last_output(o, o, o)(o) == o[:, 12:]).all()
    flat = o[:, :6] @ rng.standard_normal((6, 18)) + 3  # six dimensions: PCA keeps distances
    mapped = twin.fit_pca(flat, flat, flat)(flat)
    assert mapped.shape == (60, 6)
    np.testing.assert_allclose(
        np.linalg.norm(mapped[1:] - mapped[0], axis=1), np.linalg.norm(flat[1:] - flat[0], axis=1)
    )


def line(*points: float) -> Array:
    return np.array(points, dtype=float)[:, None]


def test_alphas_and_p_values_by_hand() -> None:
    """Unsafe flights end at 0, 1, 3 (a fourth fails before h); safe points at -5 and 10."""
    flights = [line(9, 0), line(1), line(6, -4, 3), line()]
    safe, score = line(-5, 10), twin.SCORES["nearest neighbour"]
    at_lead = twin.calibrate(flights, safe, score, "pointwise")
    assert at_lead.tolist() == [1 - 25, 1 - 36, 4 - 49, np.inf]
    # flight 0 at 9: 36 - 1 = 35 > -24; flight 2 at 6: 25 - 16, at -4: 16 - 1, at 3: -45
    assert twin.calibrate(flights, safe, score, "trajectory").tolist() == at_lead.tolist()
    earlier = [line(0.5, 8, 0), *flights[1:]]  # at 0.5: 0.25 - 30.25, below -24
    assert twin.calibrate(earlier, safe, score, "trajectory")[0] == -30
    p = twin.p_values(np.array([-45, -44.9, -24, -23.9, 1e9]), at_lead)
    assert p.tolist() == [5 / 5, 4 / 5, 3 / 5, 2 / 5, 2 / 5]


def test_scores_by_hand() -> None:
    unsafe, safe, z = np.zeros((1, 6)), np.ones((1, 6)), np.full((1, 6), -2.0)
    z[0, 3] = 0.5
    values = {
        name: score(twin.nearest(unsafe), twin.nearest(safe))(z).item()
        for name, score in twin.SCORES.items()
    }
    assert values == {
        "nearest neighbour": 20.25 - 45.25,
        "unsafe only": 20.25,
        "safe only": -45.25,
        "|Ny|": -0.5,
    }


@pytest.mark.parametrize("name", twin.SCORES)
def test_p_values_equal_a_double_loop_in_fractions(name: str) -> None:
    """Integer points, so that ties occur and floats are exact."""
    rng = np.random.default_rng(6)
    unsafe, safe, z = (rng.integers(-3, 4, (n, 6)) for n in (7, 9, 30))

    def d2(a: Array, others: list[Array]) -> Fraction:
        return min(Fraction(int(((a - b) ** 2).sum())) for b in others)

    def s(a: Array, others: list[Array]) -> Fraction:
        to_unsafe, to_safe = d2(a, others), d2(a, list(safe))
        return {
            "nearest neighbour": to_unsafe - to_safe,
            "unsafe only": to_unsafe,
            "safe only": -to_safe,
            "|Ny|": Fraction(-abs(int(a[3]))),
        }[name]

    alphas = [s(a, [*unsafe[:i], *unsafe[i + 1 :]]) for i, a in enumerate(unsafe)]
    simple = [Fraction(1 + sum(alpha >= s(a, list(unsafe)) for alpha in alphas), 8) for a in z]
    exact = [
        Fraction(
            1
            + sum(
                s(b, [*unsafe[:i], *unsafe[i + 1 :], a]) >= s(a, list(unsafe))
                for i, b in enumerate(unsafe)
            ),
            8,
        )
        for a in z
    ]
    points = [a[None].astype(float) for a in unsafe]
    fitted = twin.calibrate(points, safe.astype(float), twin.SCORES[name], "pointwise")
    score = twin.SCORES[name](twin.nearest(unsafe.astype(float)), twin.nearest(safe.astype(float)))
    assert fitted.tolist() == [float(alpha) for alpha in alphas]
    assert twin.p_values(score(z.astype(float)), fitted).tolist() == [float(p) for p in simple]
    assert [
        twin.exact_p_value(
            a.astype(float), unsafe.astype(float), safe.astype(float), twin.SCORES[name]
        )
        for a in z
    ] == [float(p) for p in exact]


@pytest.mark.parametrize("name", twin.SCORES)
@pytest.mark.parametrize("n_early", [0, 2])
def test_exact_p_value_is_never_above_the_simple_one(name: str, n_early: int) -> None:
    rng, score = np.random.default_rng(7), twin.SCORES[name]
    unsafe, safe = rng.standard_normal((15, 6)), rng.standard_normal((40, 6)) - 0.5
    z = rng.standard_normal((24, 6))
    flights = [point[None] for point in unsafe] + [unsafe[:0]] * n_early
    alphas = twin.calibrate(flights, safe, score, "pointwise")
    simple = twin.p_values(score(twin.nearest(unsafe), twin.nearest(safe))(z), alphas)
    exact = np.array([twin.exact_p_value(point, unsafe, safe, score, n_early) for point in z])
    assert (exact <= simple).all()
    assert (exact < simple).any() == (name == "nearest neighbour")


def test_exact_trajectory_p_values_lie_between_the_smallest_and_the_simple_ones() -> None:
    rng, score = np.random.default_rng(8), twin.SCORES["nearest neighbour"]
    lengths = (5, 1, 8, 0, 3, 6, 4, 7)
    flights = [rng.standard_normal((n, 6)).cumsum(axis=0) for n in lengths]
    safe, z = 2 * rng.standard_normal((30, 6)), rng.standard_normal((40, 6)).cumsum(axis=0)
    alphas = twin.calibrate(flights, safe, score, "trajectory")
    unsafe = twin.error_points(flights)
    running = np.minimum.accumulate(score(twin.nearest(unsafe), twin.nearest(safe))(z))
    simple = twin.p_values(running, alphas)
    exact = twin.exact_trajectory_p_values(z, flights, safe)
    assert (exact <= simple).all()
    assert (exact >= 2 / 9).all()  # the test flight itself and the one that failed early


def test_exact_trajectory_p_value_of_one_point_flights_is_the_pointwise_one() -> None:
    rng, score = np.random.default_rng(9), twin.SCORES["nearest neighbour"]
    unsafe, safe = rng.standard_normal((12, 6)), rng.standard_normal((20, 6))
    for z in rng.standard_normal((20, 6)):
        exact = twin.exact_trajectory_p_values(z[None], [point[None] for point in unsafe], safe)
        assert exact.item() == twin.exact_p_value(z, unsafe, safe, score)


def test_alert_is_strict_and_late_alerts_do_not_count() -> None:
    late = np.array([0.1, 0.2, 0.9, 0.9])  # fails at 3, h = 2: only samples 0 and 1 count
    early = np.array([0.9, 0.9, 0.9, 0.9])  # fails at 1: no sample counts, always missed
    safe = np.array([0.1, 0.2, 0.3, 0.1])
    miss, power = twin.evaluate([late, early, safe], [3, 1, 4], 2, np.array([0.1, 0.2, 0.3]))
    assert miss.tolist() == [0.5, 1, 1]
    assert power.tolist() == [0, 0, 1]
    assert np.isnan(twin.evaluate([late], [3], 2, np.array([0.1]))[1]).all()


@pytest.fixture(scope="module")
def studied() -> dict[str, dict[str, tuple[Array, Array]]]:
    """Four monitors of 19 failures at each level, on the same rollouts; a third of them fail."""
    return twin.study(4, 19, 20, 30, EPSILONS, k=twin.damper(), amplitude_deg=9.0, levels=LEVELS)


@pytest.mark.parametrize("level", LEVELS)
def test_study_keeps_the_guarantee(
    studied: dict[str, dict[str, tuple[Array, Array]]], level: str
) -> None:
    """Mean miss <= epsilon + 3 standard errors: a beta scatter between fits, a binomial within."""
    n_monitors, n_unsafe, epsilons, curves = 4, 19, EPSILONS, studied[level]
    assert list(curves) == list(twin.METHODS)
    for miss, power in curves.values():
        assert miss.shape == power.shape == (n_monitors, 3)
        assert (np.diff(miss) >= 0).all()
        assert (np.diff(power) >= 0).all()
        variance = epsilons * (1 - epsilons) * (1 / (n_unsafe + 2) + 1 / 10)
        assert (miss.mean(axis=0) <= epsilons + 3 * np.sqrt(variance / n_monitors)).all()


@pytest.mark.parametrize("method", twin.METHODS)
def test_scaled_monitor_does_not_care_for_units(method: str) -> None:
    rng, pilot = np.random.default_rng(10), twin.rudder_doublet(np.deg2rad(5.0))

    def sample_rollout() -> Array:
        plant = twin.plant(twin.sample_derivatives(rng))
        return twin.rollout(twin.closed_loop(*plant), pilot, DT)

    unsafe, safe = twin.collect(sample_rollout, 10)
    times = [rng.choice(len(pilot), 20, replace=False) for _ in safe]
    tests = np.array([sample_rollout() for _ in range(10)])
    unit = np.array([57.3, 57.3, 57.3, 1.0, 57.3, 57.3])
    _, p = twin.monitor_p_values(unsafe, safe, times, tests, method, 5, scaled=True)
    _, p_deg = twin.monitor_p_values(
        [y * unit for y in unsafe], [y * unit for y in safe], times, tests * unit, method, 5,
        scaled=True,
    )  # fmt: skip
    assert (p == p_deg).all()
