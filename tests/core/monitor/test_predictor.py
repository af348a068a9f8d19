"""Predictors: each against its public peer, and all against what a predictor promises."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.decomposition import PCA
from sklearn.linear_model import LinearRegression

from core.monitor import predictor
from core.monitor.predictor import PREDICTORS, Affine, Array, Linear, PrincipalComponents
from core.recipe import from_plain, to_plain


def pairs(n: int = 300) -> tuple[Array, Array]:
    """Observations (n, 18) and outputs ahead (n, 6), the last tenth unknown."""
    rng = np.random.default_rng(3)
    o = rng.standard_normal((n, 18)) @ rng.standard_normal((18, 18)) + rng.standard_normal(18)
    ahead = o @ rng.standard_normal((18, 6)) + 0.3 * rng.standard_normal((n, 6)) + 2
    ahead[-n // 10 :] = np.nan
    return o, ahead


def apply(affine: Affine, o: Array) -> Array:
    return o @ affine.matrix + affine.offset


@pytest.mark.parametrize("n", [1, 20, 301, 302, 303, 604, 1_000])
def test_blocks_give_the_triangle_of_the_whole_centred_matrix(
    n: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    o, ahead = pairs(n + 1)
    ahead[: n // 2 + 1] = np.nan_to_num(ahead[: n // 2 + 1], nan=1.0)
    whole = np.hstack([o, ahead])[~np.isnan(ahead[:, 0])]
    expected = whole - whole.mean(axis=0)
    assert predictor.BLOCK // 25 - 25 == 302
    for task in (predictor.ROWS_A_TASK, 302, 7):
        monkeypatch.setattr(predictor, "ROWS_A_TASK", task)
        mean, triangle = predictor._centred_triangle(o, ahead)
        np.testing.assert_allclose(mean, whole.mean(axis=0), rtol=1e-12, atol=1e-14)
        np.testing.assert_array_equal(triangle, np.triu(triangle))
        np.testing.assert_allclose(
            triangle.T @ triangle, expected.T @ expected, rtol=1e-12, atol=1e-10
        )


def test_means_far_from_zero_are_taken_out() -> None:
    o, ahead = (columns[:250] + 100.0 for columns in pairs())
    whole = np.hstack([o, ahead])
    expected = whole - whole.mean(axis=0)
    mean, triangle = predictor._centred_triangle(o, ahead)
    np.testing.assert_allclose(mean, whole.mean(axis=0), rtol=1e-13)
    np.testing.assert_allclose(triangle.T @ triangle, expected.T @ expected, rtol=1e-10, atol=1e-8)


@pytest.mark.parametrize("name", PREDICTORS)
def test_every_predictor_keeps_its_promises(name: str) -> None:
    (o, ahead), recipe = pairs(), PREDICTORS[name]
    before = o.copy(), ahead.copy()
    affine = recipe.fit(o, ahead)
    d = len(affine.offset)
    assert affine.matrix.shape == (18, d)
    assert affine.matrix.dtype == affine.offset.dtype == np.float64
    assert np.isfinite(affine.matrix).all()
    assert np.isfinite(affine.offset).all()
    again = recipe.fit(o, ahead)
    assert all((a == b).all() for a, b in zip(affine, again, strict=True))
    np.testing.assert_array_equal(o, before[0])
    np.testing.assert_array_equal(ahead, before[1])
    assert d == 6 or not recipe.maps_to_outputs
    assert recipe.maps_to_outputs or not recipe.forecasts
    assert to_plain(recipe)["kind"] == name
    assert from_plain(PREDICTORS["identity"], to_plain(recipe)) == recipe


@pytest.mark.parametrize("name", PREDICTORS)
def test_every_predictor_maps_unscaled_observations_to_the_same_points(name: str) -> None:
    (o, ahead), scale = pairs(), np.geomspace(0.01, 100, 18)
    affine = PREDICTORS[name].fit(o / scale, ahead)
    expected = apply(affine, o / scale)
    np.testing.assert_allclose(apply(affine.in_units(scale), o), expected, rtol=1e-10, atol=1e-10)


def degenerate(kind: str) -> tuple[Array, Array]:
    o, ahead = pairs()
    if "constant" in kind:
        o[:, [3, 9, 15]] = 0.7
    if "duplicated" in kind:
        o[:, 6:12] = o[:, :6]
    if kind == "too few":
        return o[:10], ahead[:10]
    return o, ahead


@pytest.mark.parametrize(
    "kind", ["regular", "constant", "duplicated", "constant and duplicated", "too few"]
)
def test_linear_predicts_as_scikit_learn_does(kind: str) -> None:
    o, ahead = degenerate(kind)
    known = ~np.isnan(ahead[:, 0])
    peer = LinearRegression().fit(o[known], ahead[known])
    affine = Linear().fit(o, ahead)
    fresh = pairs(50)[0]  # also off the plane of the observations: both take the least norm
    np.testing.assert_allclose(apply(affine, fresh), peer.predict(fresh), rtol=1e-9, atol=1e-8)


def test_linear_does_not_depend_on_the_block_size(monkeypatch: pytest.MonkeyPatch) -> None:
    o, ahead = pairs()
    whole = Linear().fit(o, ahead)
    for block in (1, 25 * (25 + 26), 25 * (25 + 64), 25 * (25 + 299)):
        monkeypatch.setattr(predictor, "BLOCK", block)
        np.testing.assert_allclose(apply(Linear().fit(o, ahead), o), apply(whole, o), atol=1e-10)


def test_linear_without_an_output_ahead_is_refused() -> None:
    o, ahead = pairs()
    with pytest.raises(ValueError, match="no safe observation has an output t_early later"):
        Linear().fit(o, np.full_like(ahead, np.nan))


@pytest.mark.parametrize("n_components", [1, 6, 18])
def test_pca_equals_scikit_learn_to_sign(n_components: int) -> None:
    o, ahead = pairs()
    mapped = apply(PrincipalComponents(n_components).fit(o, ahead), o)
    expected = PCA(n_components).fit_transform(o)
    signs = np.sign((mapped * expected).sum(axis=0))
    np.testing.assert_allclose(mapped * signs, expected, atol=1e-9)


def test_pca_signs_do_not_depend_on_the_order_of_the_observations() -> None:
    o, ahead = pairs()
    one = PrincipalComponents().fit(o, ahead).matrix
    other = PrincipalComponents().fit(o[::-1].copy(), ahead).matrix
    np.testing.assert_allclose(one, other, atol=1e-9)
    assert (one.max(axis=0) == np.abs(one).max(axis=0)).all()


@pytest.mark.parametrize("n_components", [0, 19])
def test_pca_of_an_impossible_size_is_refused(n_components: int) -> None:
    message = f"n_components={n_components} was given: observations have 18 entries"
    with pytest.raises(ValueError, match=message):
        replace(PrincipalComponents(), n_components=n_components).fit(*pairs())


def test_identity_and_last_output_pass_on_the_observation() -> None:
    o, ahead = pairs()
    assert (apply(PREDICTORS["identity"].fit(o, ahead), o) == o).all()
    assert (apply(PREDICTORS["last_output"].fit(o, ahead), o) == o[:, 12:]).all()
