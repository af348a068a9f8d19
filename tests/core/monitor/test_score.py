"""Scores: what each one weighs, by hand and by its public face."""

import numpy as np
import pytest

from core.channels import KEYS
from core.kernels.assessing import score_all
from core.kernels.p_value import SIMPLE
from core.monitor import MonitorRecipe
from core.monitor.monitor import assemble
from core.monitor.predictor import PREDICTORS, Affine, Array
from core.monitor.score import SCORES, NegativeMagnitude, Score
from core.recipe import from_plain, to_plain


def score_of(score: Score, unsafe: Array, safe: Array, z: Array) -> Array:
    """Scores of points z (n, 6), as a flight without history would get them."""
    fitted = assemble(
        MonitorRecipe(score=score), Affine(np.eye(6), np.zeros(6)), unsafe, safe, np.zeros(1)
    )
    return score_all(fitted, SIMPLE, z, np.ones(len(z), bool), 0)[1]


OF_POINTS = [name for name, score in SCORES.items() if not score.reads_card]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("nearest_neighbor", 20.25 - 45.25),
        ("unsafe_distance", 20.25),
        ("safe_distance", -45.25),
        ("negative_magnitude", -0.5),
    ],
)
def test_score_by_hand(name: str, value: float) -> None:
    unsafe, safe, z = np.zeros((2, 6)), np.ones((2, 6)), np.full((1, 6), -2.0)
    unsafe[1], safe[1], z[0, 3] = 50, 60, 0.5
    assert score_of(SCORES[name], unsafe, safe, z).tolist() == [value]


@pytest.mark.parametrize("name", OF_POINTS)
def test_every_score_is_finite_deterministic_and_survives_json(name: str) -> None:
    rng, score = np.random.default_rng(1), SCORES[name]
    unsafe, safe, z = (rng.standard_normal((n, 6)) for n in (5, 9, 40))
    s = score_of(score, unsafe, safe, z)
    assert s.shape == (40,)
    assert np.isfinite(s).all()
    assert len(np.unique(s)) == 40
    assert (score_of(score, unsafe, safe, z) == s).all()
    assert to_plain(score)["kind"] == name
    assert from_plain(SCORES["safe_distance"], to_plain(score)) == score


@pytest.mark.parametrize("name", OF_POINTS)
def test_without_an_unsafe_point_a_distance_to_one_is_infinite(name: str) -> None:
    """Every failure came too early: nothing was learnt of what danger looks like."""
    s = score_of(SCORES[name], np.empty((0, 6)), np.ones((2, 6)), np.zeros((1, 6)))
    assert np.isinf(s).all() == (SCORES[name].unsafe_weight > 0)


@pytest.mark.parametrize("key", KEYS)
def test_negative_magnitude_reads_its_channel(key: str) -> None:
    z = np.array([[1.0, -2, 3, -4, 5, -6]])
    s = score_of(NegativeMagnitude(key), np.ones((1, 6)), np.ones((1, 6)), z)  # pyright: ignore
    assert s.tolist() == [-1.0 - KEYS.index(key)]


@pytest.mark.parametrize("name", [n for n, p in PREDICTORS.items() if not p.maps_to_outputs])
def test_negative_magnitude_needs_a_predictor_of_outputs(name: str) -> None:
    with pytest.raises(ValueError, match="reads an output: choose the predictor linear or"):
        MonitorRecipe(predictor=PREDICTORS[name], score=SCORES["negative_magnitude"])
