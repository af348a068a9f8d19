"""What the tests share: how Hypothesis runs, and one small dataset."""

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from core.dataset import Dataset
from core.monitor import Monitor
from tests.support import oscillator
from tests.support.attas import trained

settings.register_profile(
    "forewarn",
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],  # no test fails by the clock
)
settings.load_profile("forewarn")


@pytest.fixture(scope="session")
def dataset() -> Dataset:
    """Twelve failures of the oscillator, and the safe flights met on the way."""
    return oscillator.collect(np.random.default_rng(11), n_unsafe=12)


@pytest.fixture(scope="session")
def flights() -> np.ndarray:
    """Twenty fresh flights (20, 61, 6), failed and safe."""
    return oscillator.fly(np.random.default_rng(12), 20)[1]


@pytest.fixture(scope="session")
def attas() -> Monitor:
    """A transport's monitor for a rudder doublet, its validity calibrated."""
    return trained()
