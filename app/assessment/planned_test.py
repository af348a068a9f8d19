"""The test a monitor was trained for: its guarantee covers these flights only."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from app.recipes.recipes import from_plain
from core.channels import LATERAL, Dictionary
from core.limits.limits import Envelope
from core.monitor import Monitor
from core.planned_test.collection import DatasetRecipe
from core.simulation.aircraft import Aircraft
from core.simulation.maneuver import Maneuver
from core.types import Array, Flags

TRIM_SEGMENT_S = 0.5
"""[s] Used where a monitor does not record its own."""
ROUNDING = 1e-9
"""Share of the largest weight. Below it, a weight is rounding error of a constant channel."""
MAIN_INPUT = 0.5
"""Share of the largest command from which a movement counts as an input."""


@dataclass(frozen=True, eq=False)
class PlannedTest:
    """The planned test, as far as the monitor records it.

    limits: infinite where there is no limit.
    limits_known: whether the monitor records the limits it was trained for.
    maneuver, aircraft: None where the monitor does not come from a recipe.
    flown: (n_controls,) usual largest movement of each control in flights of its training, and
    length: their length [s]; for a monitor without a recipe.
    """

    dt: float
    limits: Envelope
    maneuver: Maneuver | None = None
    aircraft: Aircraft | None = None
    limits_known: bool = True
    dictionary: Dictionary = LATERAL
    flown: Array | None = None
    length: float | None = None

    @classmethod
    def of(cls, test: DatasetRecipe) -> "PlannedTest":
        return cls(test.dt, test.specification.envelope, test.maneuver, test.aircraft)

    @property
    def controls(self) -> tuple[int, ...]:
        """Columns of the controls in y; of aileron and rudder in the order of the commands."""
        return self.dictionary.of_role("control")

    @property
    def duration(self) -> float | None:
        """Duration of a rollout [s]; None where unknown."""
        return self.maneuver.duration_s if self.maneuver else self.length

    @property
    def trim_segment_s(self) -> float:
        """Trim before the first input [s]."""
        return self.maneuver.lead_in_s if self.maneuver else TRIM_SEGMENT_S

    @property
    def speed(self) -> float | None:
        """True airspeed of the model [m/s]; None where it has none."""
        return self.aircraft.condition.airspeed if self.aircraft else None

    @cached_property
    def commands(self) -> Array:
        """(n, n_controls) planned commands of aileron and rudder [rad]; n = 0 where unknown."""
        if self.maneuver is None:
            return np.empty((0, len(self.controls)))
        exact = replace(self.maneuver, timing_jitter_s=0.0, amplitude_jitter=0.0)
        return exact.pilot(self.dt, 1, np.random.default_rng(0))[0]

    @property
    def amplitudes(self) -> Array:
        """(n_controls,) largest planned movement of each; zeros where unknown."""
        if self.flown is not None:
            return self.flown
        return np.abs(self.commands).max(axis=0, initial=0.0)


def planned_test(monitor: Monitor) -> PlannedTest:
    """The test a monitor was trained for, as far as it records it."""
    if monitor.dictionary != LATERAL:
        return _flown_test(monitor)
    recipe: dict[str, Any] = monitor.dataset_recipe
    given = {part: {part: recipe[part]} for part in ("maneuver", "aircraft") if part in recipe}
    parts = {
        part: getattr(from_plain(DatasetRecipe(), plain), part) for part, plain in given.items()
    }
    return PlannedTest(
        monitor.dt, limits_of(monitor), limits_known=monitor.envelope is not None, **parts
    )


def _flown_test(monitor: Monitor) -> PlannedTest:
    """The test of a monitor that was trained on flights of any simulator."""
    controls = monitor.dictionary.of_role("control")
    flown = np.zeros(len(controls))
    if monitor.inputs is not None:
        moved = zip(monitor.inputs.surfaces.tolist(), monitor.inputs.usual.tolist(), strict=True)
        for c, usual in moved:
            flown[controls.index(c)] = usual
    return PlannedTest(
        monitor.dt,
        limits_of(monitor),
        limits_known=monitor.envelope is not None,
        dictionary=monitor.dictionary,
        flown=flown,
        length=float(monitor.safe_where[:, 1].max()) * monitor.dt,
    )


def limits_of(monitor: Monitor) -> Envelope:
    """Its limits; infinite where there is no limit or it is unknown."""
    return monitor.envelope or Envelope.unlimited(len(monitor.dictionary))


def first_direction(deviation: Array) -> int:
    """Direction of the first large movement of a surface, 1 or -1; 0 where it does not move.

    deviation: (n,) from trim, NaN where unknown.
    """
    known = np.nan_to_num(deviation)
    main = np.abs(known) >= MAIN_INPUT * np.abs(known).max(initial=0.0)
    return int(np.sign(known[main.argmax()])) if len(known) else 0


def read_channels(monitor: Monitor, *, scored: bool = False) -> Flags:
    """(n_channels,) whether a channel has more than a rounding-error weight in the predictor.

    scored: count only the outputs that the score uses.
    """
    channel = monitor.recipe.score.channel
    matrix = monitor.affine.matrix
    matrix = matrix[:, channel : channel + 1] if scored and channel >= 0 else matrix
    weights = np.abs(matrix.reshape(-1, len(monitor.scale), matrix.shape[1])).max(axis=(0, 2))
    weights *= monitor.scale
    return weights > ROUNDING * weights.max()


def needed_channels(monitor: Monitor) -> Flags:
    """(n_channels,) whether it needs a channel: the score uses it, or it has a limit."""
    return read_channels(monitor, scored=True) | limits_of(monitor).limited


def input_of(y: Array, needed: Flags) -> Array:
    """Samples as the monitor reads them: 0 for a missing channel that it does not need.

    y: (..., n_channels).
    """
    return np.where(needed | np.isfinite(y), y, 0.0)
