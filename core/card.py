"""The test card: the planned input, and the responses of possible aircraft to its first step."""

from dataclasses import dataclass

import numpy as np

from core.channels import N_CHANNELS
from core.types import Array


class CardError(ValueError):
    """A manoeuvre that is not a sequence of steps, or an inconsistent card."""


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
        responses = self.step_responses
        if not len(self.steps) or self.switch_times.shape != self.steps.shape:
            raise CardError(
                f"{len(self.switch_times)} switch times and {len(self.steps)} steps were given: a "
                "card needs equal numbers of both, at least one"
            )
        if (np.diff(self.switch_times) <= 0).any() or not self.steps.all():
            raise CardError("switch times must ascend and no step may be 0")
        if responses.ndim != 3 or responses.shape[2] != N_CHANNELS or len(responses) < 2:
            raise CardError(
                f"step_responses has shape {responses.shape}: it needs (n_plants, n_lags, 6) with "
                "two aircraft or more"
            )
        if not np.isfinite(responses).all():
            raise CardError(
                "step_responses holds a non-finite number: an aircraft diverged after the first "
                "step alone; choose the predictor peak_ridge"
            )
