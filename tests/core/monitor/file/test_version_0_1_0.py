"""Monitors that version 0.1.0 saved: still read, and the same p-values to the bit."""

from dataclasses import replace

import numpy as np
import pytest

from core.limits.limits import Limits
from core.monitor import Monitor, load
from core.monitor.validity.verdict import compare
from tests.support.places import VERSION_0_1_0

FILES = {"certified": Limits(beta=0.2, Ny=0.5), "unknown_limits": None}


def saved(name: str) -> Monitor:
    return load(VERSION_0_1_0 / f"{name}.fwm")


@pytest.mark.parametrize("name", FILES)
def test_p_values_are_those_of_the_version_that_saved_it(name: str) -> None:
    with np.load(VERSION_0_1_0 / "p_values.npz") as expected:
        flights, p_values = expected["y"], expected[name]
    monitor = replace(saved(name), support=None)
    for y, expected in zip(flights, p_values, strict=True):
        assert monitor.p_values(y).tobytes() == expected.tobytes()


@pytest.mark.parametrize("name", FILES)
def test_limits_come_from_the_recipe_or_are_unknown(name: str) -> None:
    """The second was trained for beta alone by the library, which wrote no recipe."""
    assert saved(name).specification == FILES[name]


def test_only_a_calibrated_validity_withdraws() -> None:
    with np.load(VERSION_0_1_0 / "p_values.npz") as expected:
        y = expected["y"][-1] * np.array([1, 1, -1, 1, 1, 1])  # the yaw rate reversed
    certified, bare = saved("certified"), saved("unknown_limits")
    assert certified.support is not None
    assert bare.support is None
    assert np.isnan(certified.p_values(y)[-1])
    assert np.isfinite(bare.p_values(y)).all()


def test_its_validity_is_that_of_the_version_that_saved_it() -> None:
    """Residuals of its own forecasts and distances by each sample, to the bit; so its bounds."""
    monitor = saved("certified")
    basis = monitor.validity_basis
    assert basis is not None
    with np.load(VERSION_0_1_0 / "p_values.npz") as given:
        flights = np.concatenate([given["y"], given["y"] * np.array([1, 1, -1, 1, 1, 1])])
    with np.load(VERSION_0_1_0 / "validity.npz") as expected:
        largest = expected["largest"]
    t = np.arange(flights.shape[1]) * monitor.dt
    for y, so_far in zip(flights, largest, strict=True):
        assessments = monitor.assess(t, y, withdraw=False)
        assert (
            compare(basis, t, y, assessments.state, assessments.nearest_safe).largest.tobytes()
            == so_far.tobytes()
        )
    assert basis.support.bounds().tolist() == [12.921456048648304, 1.774138691339043]


@pytest.mark.parametrize("name", FILES)
def test_saved_again_it_is_the_same_monitor(name: str, tmp_path) -> None:
    monitor = saved(name)
    monitor.save(tmp_path / "again.fwm")
    again = load(tmp_path / "again.fwm")
    assert again.to_bytes() == monitor.to_bytes()
    assert again.specification == FILES[name]
