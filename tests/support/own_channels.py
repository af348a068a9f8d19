"""Monitors of own dictionaries, with names in Greek and with spaces; a recording of ten channels.

The channels besides those of the short period are only noise.
"""

from functools import cache
from pathlib import Path

import numpy as np
from scipy.io import savemat

from core.channels import Dictionary, channel
from core.dataset import Dataset
from core.monitor import Monitor, train
from tests.support import short_period
from tests.support.short_period import DT

RNG = np.random.default_rng
TEN = Dictionary(
    "ten",
    (
        channel("wing load", "L", "lbf", "left wing load"),
        channel("γ̇", "γ̇", "rad/s", "flight-path rate"),
        channel("pitch", "θ", "rad", "pitch", "output", "absolute"),
        channel("mass", "m", "kg", "mass", "condition", "absolute"),
        channel("load", "n", "N", "tail load"),
        channel("q_bar", "q̄", "Pa", "dynamic pressure", "condition", "absolute"),
        *short_period.DICTIONARY.channels,
    ),
)
OTHER = Dictionary(
    "other", (channel("load", "n", "lbf", "tail load"), *short_period.DICTIONARY.channels)
)


@cache
def flights(n: int) -> Dataset:
    dictionary = {4: short_period.DICTIONARY, 5: OTHER, 10: TEN}[n]
    y = short_period.with_channels(short_period.fly(RNG(1), 300)[1], n, RNG(2))
    exceeds = short_period.LIMITS.envelope.exceeds(y[..., -4:])
    fail_index = np.where(exceeds.any(axis=1), exceeds.argmax(axis=1), -1)
    return Dataset.from_rollouts(y, dt=DT, channels=dictionary, fail_index=fail_index)


@cache
def monitor(n: int) -> Monitor:
    return train(flights(n))


def ten_mat(folder: Path) -> bytes:
    """As MATLAB writes ten variables, whose names are letters, digits and underscores."""
    names = ["wing_load", "gamma", "Pitch", "mass", "load", "qBar", "ALPHA", "q", "Nz", "delta_e"]
    y = RNG(4).uniform(-0.5, 0.5, (200, 10))
    path = folder / "ten.mat"
    savemat(path, {"t": DT * np.arange(200)} | {name: y[:, k] for k, name in enumerate(names)})
    return path.read_bytes()
