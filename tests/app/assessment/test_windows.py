"""Moving windows give the same bits as scipy."""

import numpy as np
import pytest
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d, uniform_filter1d

from app.assessment.windows import extent, medians_of_three, running_mean


@pytest.mark.parametrize("n", [1, 2, 3, 40, 1000])
@pytest.mark.parametrize("size", [1, 3, 5, 21, 51, 99])
def test_windows_equal_those_of_scipy(n: int, size: int) -> None:
    x = np.random.default_rng(n + size).normal(size=(n, 2)) * 10.0 ** np.arange(-3, 1, 3)
    x[n // 3 : n // 2] = 0.25
    most, least = (
        each(x, size, axis=0, mode="nearest") for each in (maximum_filter1d, minimum_filter1d)
    )
    np.testing.assert_array_equal(extent(x, size), most - least)
    mean = uniform_filter1d(x, size, axis=0, mode="nearest")
    assert running_mean(x, size).tobytes() == mean.tobytes()
    np.testing.assert_array_equal(
        medians_of_three(x[:, 0]), median_filter(x[:, 0], 3, mode="nearest")
    )
