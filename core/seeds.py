"""The tree of random streams that grows from one seed, branch by branch."""

from enum import IntEnum

import numpy as np


class Branch(IntEnum):
    """Independent streams of a dataset's seed. A number never changes once used: the same recipe
    would give another dataset."""

    ROLLOUTS = 0
    """Aircraft, pilot and noise of a collection; below it one stream for each chunk."""
    SAFE_TIMES = 1
    """Observation times of the safe rollouts."""
    TEST = 2
    """Fresh flights that test a monitor."""
    VALIDITY = 3
    """Fresh flights that calibrate a monitor's validity; they neither train nor test one."""
    PILOT_RUN = 4
    """Rollouts for suggesting an amplitude."""
    PAIRS = 5
    """Flights of one aircraft through the monitor of another; below it one stream for each pair."""
    CARD = 6
    """Aircraft whose response to the first step is on a card."""
    REACTION = 7
    """How fast the crews react to the alerts on a monitor's test flights."""
    ROBUSTNESS = 8
    """Flights that differ from the planned test; below it one stream for each difference."""
    FORECAST = 9
    """Flights for training a forecast of peaks, besides those of the collection."""
    COMBINATION = 10
    """Failing flights for calibrating a combination of monitors; they train no member."""
    CLEARANCE = 11
    """Aircraft for calibrating a clearance; below it one stream for its predictions."""
    ENSEMBLE = 12
    """Failing flights for calibrating an ensemble; they train no part of it."""
    NEAR = 13
    """Flights of aircraft and hands near the planned ones: 0 to train a forecast, then one stream
    for each population to calibrate a rule."""
    CHOICE = 14
    """Flights on which methods are tried, to choose one; nothing else is done with them."""


def stream(seed: int, branch: Branch, *below: int) -> np.random.Generator:
    """Random stream of a branch. below: numbers of its own branches."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(int(branch), *below)))


def monitor_seeds(seed: int, n_monitors: int) -> list[tuple[int, int]]:
    """Seeds of a study's monitors: (dataset, test flights) for each."""
    state = np.random.SeedSequence(seed).generate_state(2 * n_monitors)
    return [(int(data), int(test)) for data, test in state.reshape(-1, 2)]
