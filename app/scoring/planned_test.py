"""What a monitor was trained for: the only flights that its guarantee is about."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from app.recipes import from_plain
from core.channels import KEYS, N_CHANNELS
from core.collection import DatasetRecipe
from core.monitor import Monitor
from core.simulation.aircraft import Aircraft
from core.simulation.maneuver import Maneuver
from core.types import Array, Flags

SURFACES = (KEYS.index("delta_a"), KEYS.index("delta_r"))
"""Where aileron and rudder stand in y, in the order of the pilot's commands."""
SURFACE_NAMES = ("aileron", "rudder")
TRIM_SEGMENT_S = 0.5
"""[s] where a monitor does not say its own."""
ROUNDING = 1e-9
"""Of the largest weight: a channel that never moved in training has one of rounding errors."""
MAIN_INPUT = 0.5
"""Share of the largest command from which one counts as an input of its own."""


@dataclass(frozen=True, eq=False)
class PlannedTest:
    """The planned test as far as a monitor knows it.

    limits: (6,) magnitudes that must not be exceeded, infinite where there is none.
    limits_known: whether the monitor says which limits it was trained for.
    maneuver, aircraft: None where the monitor does not come from a recipe.
    """

    dt: float
    limits: Array
    maneuver: Maneuver | None = None
    aircraft: Aircraft | None = None
    limits_known: bool = True

    @classmethod
    def of(cls, test: DatasetRecipe) -> "PlannedTest":
        """All that a recipe says."""
        return cls(test.dt, test.specification.magnitudes, test.maneuver, test.aircraft)

    @property
    def duration(self) -> float | None:
        """Of a rollout [s]; None: not known."""
        return self.maneuver.duration_s if self.maneuver else None

    @property
    def trim_segment_s(self) -> float:
        """Trim before the first input [s]."""
        return self.maneuver.lead_in_s if self.maneuver else TRIM_SEGMENT_S

    @property
    def speed(self) -> float | None:
        """True airspeed of the model [m/s]; None where it has none."""
        return self.aircraft.airspeed if self.aircraft else None

    @cached_property
    def commands(self) -> Array:
        """(n, 2) planned commands of aileron and rudder [rad]; (0, 2): not known."""
        if self.maneuver is None:
            return np.empty((0, 2))
        exact = replace(self.maneuver, timing_jitter_s=0.0, amplitude_jitter=0.0)
        return exact.pilot(self.dt, 1, np.random.default_rng(0))[0]

    @property
    def amplitudes(self) -> Array:
        """(2,) largest magnitude of each command [rad]; zeros where nothing is known."""
        return np.abs(self.commands).max(axis=0, initial=0.0)

    @property
    def inputs_last(self) -> float:
        """From the first input to the end of the last one [s]; 0 where nothing is known."""
        moved = np.flatnonzero(self.commands.any(axis=1))
        return float(moved[-1] - moved[0] + 1) * self.dt if len(moved) else 0.0


def planned_test(monitor: Monitor) -> PlannedTest:
    """The test that a monitor was trained for, as far as it says."""
    recipe: dict[str, Any] = monitor.dataset_recipe
    given = {part: {part: recipe[part]} for part in ("maneuver", "aircraft") if part in recipe}
    parts = {
        part: getattr(from_plain(DatasetRecipe(), plain), part) for part, plain in given.items()
    }
    return PlannedTest(
        monitor.dt, limits_of(monitor), limits_known=monitor.limits is not None, **parts
    )


def limits_of(monitor: Monitor) -> Array:
    """(6,) magnitudes that must not be exceeded; infinite where there is none, or none is known."""
    return np.full(N_CHANNELS, np.inf) if monitor.limits is None else monitor.limits


def first_direction(deviation: Array) -> int:
    """1 or -1: which way a surface goes first, small movements left out; 0 where it rests.

    deviation: (n,) from trim, NaN where unknown.
    """
    known = np.nan_to_num(deviation)
    main = np.abs(known) >= MAIN_INPUT * np.abs(known).max(initial=0.0)
    return int(np.sign(known[main.argmax()])) if len(known) else 0


def read_channels(monitor: Monitor, *, scored: bool = False) -> Flags:
    """(6,) whether a channel has a weight, beyond rounding, in the map from observations to points.

    scored: only to that part of a point that the score looks at.
    """
    channel = monitor.recipe.score.channel
    matrix = monitor.affine.matrix
    matrix = matrix[:, channel : channel + 1] if scored and channel >= 0 else matrix
    weights = np.abs(matrix.reshape(-1, N_CHANNELS, matrix.shape[1])).max(axis=(0, 2))
    weights *= monitor.scale
    return weights > ROUNDING * weights.max()


def needed_channels(monitor: Monitor, limits: Array) -> Flags:
    """(6,) whether the monitor cannot do without a channel: it is scored by it, or limited."""
    return read_channels(monitor, scored=True) | np.isfinite(limits)
