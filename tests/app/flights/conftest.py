"""The monitor and the flight that tests of flights share."""

import pytest

from core.monitor import Monitor
from tests.support.flying import exact_monitor, failing_flight
from tests.support.oscillator import Array


@pytest.fixture
def exact() -> Monitor:
    return exact_monitor()


@pytest.fixture
def failing() -> Array:
    return failing_flight()
