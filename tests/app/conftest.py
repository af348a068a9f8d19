import pytest

from tests.support.told_clock import ToldClock


@pytest.fixture
def clock() -> ToldClock:
    return ToldClock()
