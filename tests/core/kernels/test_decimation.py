import numpy as np
import pytest
from scipy.signal import upfirdn

from core.kernels.decimation import decimated


@pytest.mark.parametrize("n", [1, 3, 4, 5, 1001])
@pytest.mark.parametrize(("n_weights", "stride"), [(1, 1), (7, 1), (22, 2), (102, 5), (4, 9)])
def test_rows_are_those_of_a_filter_of_all_rows_bit_for_bit(
    n: int, n_weights: int, stride: int
) -> None:
    """Against scipy's, which keeps every stride-th row too, and needs zeros for the others."""
    rng = np.random.default_rng(n)
    weights, x = rng.normal(size=n_weights), rng.normal(size=(n - 1) * stride + n_weights)
    spare = -(n_weights - 1) % stride
    taps = np.concatenate([np.zeros(spare), weights[::-1]])
    skipped = (len(taps) - 1) // stride
    expected = upfirdn(taps, x, 1, stride)[skipped : skipped + n]
    np.testing.assert_array_equal(decimated(x, weights, stride, n), expected)
