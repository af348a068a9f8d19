import pytest

from core.dataset import Dataset
from core.monitor import Monitor, train
from tests.support.told_clock import ToldClock


@pytest.fixture
def clock() -> ToldClock:
    return ToldClock()


@pytest.fixture(scope="session")
def trained(dataset: Dataset) -> Monitor:
    return train(dataset)
