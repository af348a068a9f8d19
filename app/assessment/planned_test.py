"""The test a monitor was trained for: its guarantee covers these flights only."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from app.recipes.recipes import from_plain, simulated_test
from core.channels import LATERAL, Dictionary
from core.limits.limits import Envelope, envelope_of
from core.monitor import Monitor
from core.monitor.validity.flown_input import FreshInputs, InputSupport
from core.planned_test.planned_test import DatasetRecipe, ManeuverTest
from core.simulation.aircraft import Aircraft
from core.simulation.maneuver import COLUMN, Maneuver
from core.types import Array, Flags

TRIM_SEGMENT_S = 0.5
"""[s] Used where a monitor does not record its own."""
ROUNDING = 1e-9
"""Share of the largest weight. Below it, a weight is rounding error of a constant channel."""
ENDS_EARLY = 0.2
"""A recording may end this share of the planned duration before its end, as inputs begin late."""
MAIN_INPUT = 0.5
"""Share of the largest command from which a movement counts as an input."""


@dataclass(frozen=True, eq=False)
class PlannedTest:
    """The planned test, as far as the monitor records it.

    limits: infinite where there is no limit.
    limits_known: whether the monitor records the limits it was trained for.
    maneuver, aircraft: None where the monitor does not come from a recipe.
    flown: (n_controls,) usual largest movement of each control in flights of its training, and
    length: their length [s]; for a monitor of other channels than the lateral ones, or whose pilot
    captures a target.   shortest: of these lengths, among the safe flights [s].
    """

    dt: float
    limits: Envelope
    maneuver: Maneuver | None = None
    aircraft: Aircraft | None = None
    limits_known: bool = True
    dictionary: Dictionary = LATERAL
    flown: Array | None = None
    length: float | None = None
    shortest: float | None = None

    @classmethod
    def of(cls, test: ManeuverTest) -> "PlannedTest":
        limits = envelope_of(test.judged_by) or Envelope.unlimited(len(test.dictionary))
        aircraft = test.aircraft if isinstance(test, DatasetRecipe) else None
        return cls(test.dt, limits, test.maneuver, aircraft, dictionary=test.dictionary)

    @property
    def controls(self) -> tuple[int, ...]:
        """Columns of the controls in y."""
        return self.dictionary.of_role("control")

    @property
    def duration(self) -> float | None:
        """Duration of a rollout [s]; None where unknown."""
        return self.maneuver.duration_s if self.maneuver else self.length

    @property
    def least_flown(self) -> float | None:
        """Time after the trim that a recording of the whole manoeuvre has at least [s]."""
        length = self.maneuver.duration_s if self.maneuver else self.shortest
        return None if length is None else (1.0 - ENDS_EARLY) * length - self.trim_segment_s

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
        """(n, n_controls) planned commands [rad]; n = 0 where unknown."""
        if self.maneuver is None or self.maneuver.captured:
            return np.empty((0, len(self.controls)))
        exact = replace(self.maneuver, timing_jitter_s=0.0, amplitude_jitter=0.0)
        flown = exact.pilot(self.dt, 1, np.random.default_rng(0))[0]
        by_key = {f"delta_{surface[0]}": c for surface, c in COLUMN.items()}
        columns = [by_key.get(self.dictionary.keys[c], len(COLUMN)) for c in self.controls]
        return np.pad(flown, ((0, 0), (0, len(COLUMN) + 1 - flown.shape[1])))[:, columns]

    @property
    def amplitudes(self) -> Array:
        """(n_controls,) largest planned movement of each; zeros where unknown."""
        if self.flown is not None:
            return self.flown
        return np.abs(self.commands).max(axis=0, initial=0.0)


def planned_test(monitor: Monitor) -> PlannedTest:
    """The test a monitor was trained for, as far as it records it."""
    if monitor.dictionary == LATERAL:
        test = _recipe_test(monitor.dt, limits_of(monitor), monitor.dataset_recipe)
        if test.maneuver is not None and test.maneuver.captured:
            test = replace(test, flown=_movements(LATERAL, monitor.inputs))
    else:
        last = np.zeros(1 + monitor.safe_where[:, 0].max(), np.int64)
        np.maximum.at(last, *monitor.safe_where.T)
        length, shortest = (float(edge(last[last > 0])) * monitor.dt for edge in (np.max, np.min))
        about = monitor.dt, limits_of(monitor), monitor.dictionary
        test = _flown_test(*about, monitor.inputs, length)
        recipe = simulated_test(monitor.dataset_recipe)
        if recipe is not None:
            test = replace(test, maneuver=recipe.maneuver)
        test = replace(test, shortest=shortest)
    return replace(test, limits_known=monitor.envelope is not None)


def known_test(monitor: Monitor) -> PlannedTest:
    """The planned test; without inputs if it is none of ours."""
    try:
        return planned_test(monitor)
    except ValueError:
        return PlannedTest(monitor.dt, limits_of(monitor))


def rollouts_test(
    y: Array, dt: float, dictionary: Dictionary, recipe: dict[str, Any]
) -> PlannedTest:
    """The test of rollouts: that of their recipe, or as their controls moved and they lasted.

    y: (n, n_samples, n_channels) NaN after the end.   dt: [s].
    """
    unlimited = Envelope.unlimited(len(dictionary))
    if "maneuver" in recipe and dictionary == LATERAL:
        return _recipe_test(dt, unlimited, recipe)
    inputs = None
    if dictionary.of_role("control"):
        fresh = FreshInputs(dt, dictionary)
        fresh.add(y, np.full(len(y), y.shape[1]))
        inputs = fresh.support
    return _flown_test(dt, unlimited, dictionary, inputs, (y.shape[1] - 1) * dt)


def _recipe_test(dt: float, limits: Envelope, recipe: dict[str, Any]) -> PlannedTest:
    given = {part: {part: recipe[part]} for part in ("maneuver", "aircraft") if part in recipe}
    if "maneuver" in given and "pilot" in recipe:
        given["maneuver"]["pilot"] = recipe["pilot"]
    parts = {
        part: getattr(from_plain(DatasetRecipe(), plain), part) for part, plain in given.items()
    }
    return PlannedTest(dt, limits, **parts)


def _flown_test(
    dt: float,
    limits: Envelope,
    dictionary: Dictionary,
    inputs: InputSupport | None,
    length: float,
) -> PlannedTest:
    """The test of flights of any simulator. inputs: how their controls moved.   length: [s]."""
    flown = _movements(dictionary, inputs)
    return PlannedTest(dt, limits, dictionary=dictionary, flown=flown, length=length)


def _movements(dictionary: Dictionary, inputs: InputSupport | None) -> Array:
    """(n_controls,) usual largest movement of each control; zeros where unknown."""
    controls = dictionary.of_role("control")
    flown = np.zeros(len(controls))
    if inputs is not None:
        for c, usual in zip(inputs.surfaces.tolist(), inputs.usual.tolist(), strict=True):
            flown[controls.index(c)] = usual
    return flown


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
