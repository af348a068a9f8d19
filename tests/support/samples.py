"""The layout of stored samples, for tests that make some by hand."""

import numpy as np

SAMPLE_LIKE = np.dtype(
    [
        ("t", "f8"),
        ("y", "f8", 6),
        ("p_value", "f8"),
        ("withdrawn", "f8"),
        ("alert", "?"),
        ("state", "u1"),
        ("manoeuvre", "i2"),
        ("y_hat", "f8", 6),
        ("attitude", "f8", 3),
    ]
)
