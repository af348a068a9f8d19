"""The tree of random streams that grows from one seed: every branch, and what draws from it."""

from enum import IntEnum

import numpy as np


class Branch(IntEnum):
    """Streams of a dataset's seed, independent of each other. A number, once used, never changes:
    the same recipe would make another dataset."""

    ROLLOUTS = 0
    """Aircraft, pilot and noise of a collection; below it one stream for each chunk."""
    SAFE_TIMES = 1
    """Observation times of the safe rollouts."""
    TEST = 2
    """Fresh flights that test a monitor."""
    VALIDITY = 3
    """Fresh flights that calibrate a monitor's validity; they neither train nor test one."""
    PILOT_RUN = 4
    """Rollouts that an amplitude is suggested from."""
    PAIRS = 5
    """Flights of one aircraft through the monitor of another; below it one stream for each pair."""
    CARD = 6
    """Aircraft whose response to the card's first step a monitor knows."""
    REACTION = 7
    """How fast the crews react to the alerts on a monitor's test flights."""
    ROBUSTNESS = 8
    """Flights that differ from the planned test; below it one stream for each difference."""
    FORECAST = 9
    """Flights that a forecast of peaks learns from, beside those of the collection."""
    COMBINATION = 10
    """Failing flights that a combination of monitors is calibrated on; they train no member."""
    CLEARANCE = 11
    """Aircraft that a clearance is calibrated on; below it one for its predictions."""


def stream(seed: int, branch: Branch, *below: int) -> np.random.Generator:
    """Random stream of a branch of the seed's tree; below: which of the branch's own branches."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(int(branch), *below)))


def monitor_seeds(seed: int, n_monitors: int) -> list[tuple[int, int]]:
    """Seeds of a study's monitors, a pair each: of its dataset and of its test flights."""
    state = np.random.SeedSequence(seed).generate_state(2 * n_monitors)
    return [(int(data), int(test)) for data, test in state.reshape(-1, 2)]
