"""The test card: the planned input, and the responses of possible aircraft to its first step."""

from dataclasses import dataclass

import numpy as np

from core.types import Array


class CardError(ValueError):
    """A manoeuvre that is not a sequence of steps, or whose steps have no finite responses."""


@dataclass(frozen=True, eq=False)
class Card:
    """A planned input of steps on one surface, and responses to its first step.

    surface: number of the channel it moves.
    switch_times: (n_switches,) [s] from the start of the manoeuvre, ascending.
    steps: (n_switches,) signed change of the command at each switch [rad].
    duration_s: length of the manoeuvre [s].   dt: sample interval [s].
    timing_jitter_s: standard deviation of the first switch and of the time between two [s].
    noise_std: (6,) standard deviation of sensor noise, SI units, N_y in g.
    step_responses: (n_plants, n_lags, 6) outputs without noise to the first step alone, from its
    switch on; aircraft drawn from D_theta, pilots with scatter in amplitude.
    asymmetry: standard deviation of the part by which inputs to one side are larger, to the other
    smaller.   lag_s: largest transport lag of a recorded channel [s].
    """

    surface: int
    switch_times: Array
    steps: Array
    duration_s: float
    dt: float
    timing_jitter_s: float
    noise_std: Array
    step_responses: Array
    asymmetry: float = 0.0
    lag_s: float = 0.0

    def __post_init__(self) -> None:
        if not np.isfinite(self.step_responses).all():
            raise CardError(
                "step_responses holds a non-finite number: an aircraft diverged after the first "
                "step alone; choose the predictor peak_ridge"
            )
