"""Which failures a joined point lowers, against going through every sample of every failure."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.kernels.compiled import jit
from core.kernels.p_value import Transduction, p_value_of
from core.monitor import MonitorRecipe
from core.monitor.monitor import assemble
from core.monitor.predictor import Affine
from core.monitor.score import SCORES
from core.types import Array
from tests.support.repetition import examples


@jit
def exact_p(fitted, exact, z, s):
    return p_value_of(fitted, exact, z, s, s)


def plain_p(exact: Transduction, weight: float, z: Array, s: float) -> float:
    """The exact p-value by its definition."""
    total = np.zeros(len(exact.points))
    for k in range(len(z)):  # in this order: a sum of another rounds otherwise
        total += (z[k] - exact.points[:, k]) ** 2
    joined = np.fmin(exact.unsafe, weight * total) - exact.safe
    staying = sum(
        not (alpha < s or (joined[a:b] < s).any())
        for alpha, (a, b) in zip(exact.alphas, pairwise(exact.start), strict=True)
    )
    return (exact.always + staying + 1) / (exact.always + len(exact.alphas) + 1)


def histories(rng: np.random.Generator, n: int, longest: int, d: int, whole: bool) -> Transduction:
    """So many failures with random histories, some of them empty; of whole numbers, with ties."""
    lengths = rng.integers(0, longest + 1, n)
    lengths[-1] = longest
    n_samples = lengths.sum()
    start = np.concatenate([[0], lengths.cumsum()])
    points = rng.standard_normal((n_samples, d)).cumsum(axis=0)
    unsafe, safe = d * rng.exponential(4, n_samples), d * rng.exponential(2, n_samples)
    if whole:
        points, unsafe, safe = np.floor(points % 5), np.floor(unsafe), np.floor(safe)
    alphas = np.array([(unsafe - safe)[a:b].min(initial=9.0) for a, b in pairwise(start)])
    return Transduction(points, unsafe, safe, start, alphas, 1, False).indexed()


@pytest.mark.parametrize("score", ["nearest_neighbor", "unsafe_distance", "safe_distance"])
@settings(max_examples=examples(100), deadline=None)
@given(
    seed=st.integers(0, 2**32),
    n=st.sampled_from([1, 2, 7, 40]),
    longest=st.sampled_from([1, 3, 33, 90]),
    d=st.sampled_from([1, 6, 9]),
    whole=st.booleans(),
)
def test_exact_p_value_equals_its_definition(
    score: str, seed: int, n: int, longest: int, d: int, whole: bool
) -> None:
    rng = np.random.default_rng(seed)
    exact = histories(rng, n, longest, d, whole)
    points = np.empty((0, d))
    fitted = assemble(
        MonitorRecipe(score=SCORES[score]),
        Affine(np.zeros((18, d)), np.zeros(d)),
        points,
        points,
        np.zeros(n + 1),
    )
    near = exact.points[rng.integers(len(exact.points), size=12)]
    queries = near + np.round(rng.standard_normal(near.shape)) * rng.choice([0, 1, 20], (12, 1))
    queries[-2:, 0] = np.nan, 1e200
    levels = [*rng.choice(exact.alphas, 5), *rng.normal(0, 5 * d, 3), np.nan, np.inf, -np.inf]
    for z in queries:
        for s in levels:
            with np.errstate(over="ignore", invalid="ignore"):
                expected = plain_p(exact, fitted.unsafe_weight, z, s)
            assert exact_p(fitted, exact, z, s) == expected
