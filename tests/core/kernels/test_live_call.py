"""A sample by the table of addresses is what it is by the arrays themselves."""

from itertools import product

import numpy as np
import pytest

from core.dataset import Dataset
from core.kernels.assessing import update
from core.kernels.live_call import live_call, update_at
from core.monitor import MonitorRecipe, train
from core.monitor.score import SCORES
from core.types import Array
from tests.support.oscillator import DT


@pytest.mark.parametrize(
    ("score", "p_value"),
    list(product(["nearest_neighbor", "negative_magnitude"], ["simple", "exact"])),
)
def test_the_table_gives_the_bits_of_the_arrays(
    score: str, p_value: str, dataset: Dataset, flights: Array
) -> None:
    monitor = train(dataset, MonitorRecipe(score=SCORES[score], p_value=p_value))  # pyright: ignore
    kinds = [], []
    for kind, by_table in zip(kinds, (False, True), strict=True):
        buffer, status = np.zeros((monitor.recipe.n_delay + 1, 6)), np.array([0, 0, -1, -1])
        clock, point = np.array([np.nan, np.inf, np.nan, np.nan, 0.0]), np.empty(monitor.fitted.d)
        arrays = monitor.fitted, monitor.exact, buffer, status, clock
        call = live_call(*arrays, point, DT)
        for k, y in enumerate(np.ascontiguousarray(flights[0])):
            said = (
                update_at(*call, k * DT, y) if by_table else update(*arrays, DT, k * DT, y, point)
            )
            state = (array.tobytes() for array in (buffer, status, clock, point))
            kind.append((np.array(said).tobytes(), *state))
    assert kinds[0] == kinds[1]
    assert len(set(kinds[0])) == len(flights[0])


def test_arrays_that_are_not_in_rows_are_refused(dataset: Dataset) -> None:
    monitor = train(dataset)
    across = np.asfortranarray(np.zeros((3, 6)))
    numbers = np.array([0, 0, -1, -1]), np.zeros(5), np.empty(6)
    with pytest.raises(ValueError, match="C-contiguous"):
        live_call(monitor.fitted, monitor.exact, across, *numbers, DT)
