"""A test point that a model flies: inputs over time, uncertain parameters, channels."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from core.bounds import NOT_NEGATIVE, Bounds, check_bounds
from core.simulation.simulator import Distribution
from core.types import Array

POSITIVE = Bounds(above=0)
Breakpoints = tuple[tuple[float, float], ...]
"""Times [s] and values, with straight lines between; a step is a time that is given twice."""


@dataclass(frozen=True)
class PointRecipe:
    """A test point, in the names and units of the model that flies it.

    channels: the output of each channel.   inputs: breakpoints of each input.
    parameters: spread of each, or nominal value and spread.
    noise: of the sensors, 1 sigma by channel, in SI units, N_y and N_z in g.
    timing_jitter_s, amplitude_jitter: scatter of the pilot, 1 sigma; it shifts all inputs of a
    flight together, and scales what they are from their first values.
    seconds, memory: allowed to a process, for a flight [s], and in MiB.
    """

    channels: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[str, Breakpoints] = field(default_factory=dict)
    parameters: Mapping[str, float | tuple[float, float]] = field(default_factory=dict)
    distribution: Distribution = "normal"
    duration_s: Annotated[float, POSITIVE] = 6.0
    dt: Annotated[float, POSITIVE] = 0.02
    noise: Mapping[str, float] = field(default_factory=dict)
    timing_jitter_s: Annotated[float, NOT_NEGATIVE] = 0.1
    amplitude_jitter: Annotated[float, NOT_NEGATIVE] = 0.15
    seconds: Annotated[float, POSITIVE] = 60.0
    memory: Annotated[int, Bounds(least=256)] = 4096

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.dt >= self.duration_s:
            raise ValueError(
                f"dt={self.dt:g} s was given: it must be shorter than duration_s, "
                f"{self.duration_s:g} s"
            )
        for name, points in self.inputs.items():
            if not points or np.any(np.diff([t for t, _ in points]) < 0):
                raise ValueError(f"input {name} has times that decrease: give [[time, value], ...]")

    def pilot(self) -> Callable[[np.random.Generator], Array]:
        """Draws the inputs (n_samples, n_inputs) of a flight."""
        t = self.dt * np.arange(round(self.duration_s / self.dt) + 1)
        tables = [np.array(points, np.float64).T for points in self.inputs.values()]

        def inputs(rng: np.random.Generator) -> Array:
            shift, factor = self.timing_jitter_s, self.amplitude_jitter
            shift, factor = rng.standard_normal(2) * [shift, factor] + [0.0, 1.0]
            flown = [
                values[0] + factor * (np.interp(t - shift, times, values) - values[0])
                for times, values in tables
            ]
            return np.array(flown).T if flown else np.empty((len(t), 0))

        return inputs
