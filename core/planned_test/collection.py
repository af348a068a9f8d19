"""Collection: roll out the manoeuvre on random aircraft until enough of them turn unsafe."""

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import replace
from itertools import count, starmap
from math import ceil
from typing import Any, NamedTuple, TypeVar

import numpy as np

from core.card import Card, CardError
from core.channels import KEYS
from core.dataset import Dataset
from core.monitor.group import Pooled
from core.planned_test.amplitude import AmplitudeError, suggest_amplitude
from core.planned_test.own import OwnTest
from core.planned_test.planned_test import (
    LARGEST_CHUNK,
    DatasetRecipe,
    ManeuverTest,
    Replans,
)
from core.seeds import Branch, stream
from core.simulation.imperfections import channel_array
from core.simulation.maneuver import COLUMN, LATERAL_SURFACES, Steps
from core.simulation.rollout import roll_out
from core.simulation.simulator import Rollouts, Simulator, Stopped, Stops
from core.tasks import Tasks
from core.types import Flags, Indices

Progress = Callable[[int, int], object]
SimulatedTest = ManeuverTest | OwnTest
Made = TypeVar("Made")

FIRST_CHUNK, CHUNKS_AHEAD = 256, 4
"""Rollouts of the first chunk, and chunks that an executor computes ahead."""
MOST_UNSAFE = 20_000
"""Largest number of unsafe rollouts collected for a scarce group."""
CERTAINTY = 1e-6
FRESH_BATCH, MOST_FRESH = 1_000, 20_000
"""Fresh flights in a batch, and the default total."""
TRAINING_ROLLOUTS = 2_000
CARD_PLANTS = 500
"""Aircraft whose step response a card holds; more do not improve a monitor."""


class CollectionError(ValueError):
    """A collection that would not end, or that has no safe rollouts."""


def replanned(test: SimulatedTest) -> DatasetRecipe | None:
    """The recipe from which a test can be planned otherwise; None if its simulator cannot."""
    simulator = test.simulator()
    return simulator.recipe if isinstance(simulator, Replans) else None


def collect(
    recipe: SimulatedTest,
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Dataset:
    """Roll out until recipe.n_unsafe rollouts turn unsafe; keep the safe ones on the way.

    With groups, at least n_unsafe of each group; surplus ones are kept.

    executor: rolls out the chunks; default: this thread and the kernels' threads. The result
    depends on the recipe alone.
    progress: called with (unsafe rollouts, rollouts made); an exception cancels.
    CollectionError if the budget cannot suffice or no safe rollouts remain.
    """
    simulator, failures = recipe.simulator(), _Failures(recipe)
    parts: list[Rollouts] = []
    n_made = n_safe_stored = 0
    numbered = ((recipe, simulator, number, recipe.max_safe - n_safe_stored) for number in count())
    for chunk in _results(_chunk, numbered, executor):
        chunk = chunk.first(recipe.max_rollouts - n_made)
        chunk = chunk.first(failures.add(chunk.is_unsafe, chunk.stored))
        n_made += len(chunk.is_unsafe)
        stored = _storable(chunk.stored, recipe.max_safe - n_safe_stored)
        n_safe_stored += int(np.count_nonzero(~stored.is_unsafe))
        parts.append(stored)
        if progress:
            progress(min(failures.n, recipe.n_unsafe), n_made)
        if failures.n >= recipe.n_unsafe:
            return _dataset(recipe, simulator, parts, n_made - failures.n_met)
        _check_reach(failures, recipe, n_made)
    raise AssertionError("chunks never end")


def fresh(
    recipe: SimulatedTest, most: int = MOST_FRESH, executor: Executor | None = None
) -> Iterator[Rollouts]:
    """Roll out flights to calibrate a monitor's validity; they neither train nor test it.

    Yields batches on demand, `most` flights in total.   executor: see `_batches`.
    """
    return _batches(recipe, most, Branch.VALIDITY, executor)


def combination_failures(
    recipe: SimulatedTest,
    n: int,
    progress: Progress | None = None,
    branch: Branch = Branch.COMBINATION,
    executor: Executor | None = None,
) -> tuple[Rollouts, int]:
    """Roll out until n flights fail, to calibrate a rule of several parts; they train none of them.

    With groups, until n of each group fail.
    progress: called with (failures, flights made); an exception cancels.   branch: of the seed.
    executor: see `_batches`.
    Returns the failing flights, and the number of flights made.   CollectionError if the recipe's
    budget of rollouts cannot suffice.
    """
    wanted = replace(recipe, n_unsafe=n)
    failures, parts, made = _Failures(wanted), list[Rollouts](), 0
    for flights in _batches(recipe, recipe.max_rollouts, branch, executor):
        flights = flights.some(slice(failures.add(flights.is_unsafe, flights)))
        made += len(flights.y)
        parts.append(flights.some(flights.is_unsafe))
        if progress:
            progress(failures.n, made)
        if failures.n >= n:
            break
        _check_reach(failures, wanted, made)
    return _joined(parts), made


def evaluation_flights(
    recipe: SimulatedTest, n: int, branch: Branch = Branch.TEST, executor: Executor | None = None
) -> Rollouts:
    """Roll out n flights to test a monitor; they neither train it nor calibrate its validity.

    executor: see `_batches`; flights that can be stopped are one batch, for `stopping_flights`.
    """
    if not isinstance(recipe.simulator(), Stops):
        return _joined([*_batches(recipe, n, branch, executor)])
    return recipe.simulator().rollouts(n, stream(recipe.seed, branch))


def stopping_flights(recipe: SimulatedTest, n: int) -> Stopped:
    """Draw these n flights, to fly some again with the manoeuvre stopped on the way.

    ValueError if the simulator cannot stop.
    """
    simulator = recipe.simulator()
    if not isinstance(simulator, Stops):
        raise ValueError("the simulator cannot stop a manoeuvre: choose one that can")
    return simulator.stopping(n, stream(recipe.seed, Branch.TEST))


def training_rollouts(
    recipe: SimulatedTest, n: int = TRAINING_ROLLOUTS, executor: Executor | None = None
) -> Rollouts:
    """Roll out n flights to train a forecast of peaks; they neither calibrate nor test.

    Outputs of failing flights continue after the failure.   executor: see `_batches`.
    """
    return evaluation_flights(recipe, n, Branch.FORECAST, executor)


def card_of(test: SimulatedTest, n_plants: int = CARD_PLANTS) -> Card:
    """The card of the planned manoeuvre, for monitors that use the remaining planned input.

    n_plants: aircraft to simulate the response to the first step on.
    CardError for a manoeuvre that is unknown, or not a sequence of steps on one surface.
    """
    if (recipe := replanned(test)) is None:
        raise CardError("the simulator knows no step responses: choose the predictor peak_ridge")
    maneuver = recipe.maneuver
    if not isinstance(maneuver, Steps) or not (switches := maneuver.switches):
        raise CardError(
            f"the manoeuvre {type(maneuver).__name__} is not a sequence of steps, so it has no "
            "step responses: choose the predictor peak_ridge"
        )
    simulator, rng = recipe.simulator(), stream(recipe.seed, Branch.CARD)
    if simulator.crew is not None:
        raise CardError(
            "a pilot in the loop adds to the planned steps, so their responses are not the "
            "aircraft's alone: choose the predictor peak_ridge"
        )
    times, steps = np.array(switches).T
    n_lags = maneuver.n_samples(recipe.dt) - round(times[0] / recipe.dt)
    factor = 1.0 + maneuver.amplitude_jitter * rng.standard_normal(n_plants)
    factor *= maneuver.steps_flown(n_plants, rng)
    command = np.zeros((n_plants, n_lags, LATERAL_SURFACES))
    command[..., COLUMN[maneuver.surface]] = (np.deg2rad(steps[0]) * factor)[:, None]
    responses = roll_out(
        simulator.plant.plants(simulator.plant.sample(n_plants, rng)),
        simulator.controller,
        recipe.control_law.actuator,
        command,
        recipe.dt,
        pedal_lag_s=maneuver.pedal_lag_s + recipe.imperfections.softness_s / 2,
    )
    return Card(
        surface=KEYS.index({"aileron": "delta_a", "rudder": "delta_r"}[maneuver.surface]),
        switch_times=times,
        steps=np.deg2rad(steps),
        duration_s=maneuver.duration_s,
        dt=recipe.dt,
        timing_jitter_s=maneuver.timing_jitter_s,
        noise_std=channel_array(recipe.noise),
        step_responses=responses,
        asymmetry=recipe.imperfections.asymmetry,
        lag_s=recipe.imperfections.lag_s,
    )


def _batches(
    recipe: SimulatedTest, most: int, branch: Branch, executor: Executor | None
) -> Iterator[Rollouts]:
    """Batches of flights on demand, `most` flights in total.

    executor: rolls them out, a few ahead, each with its own random stream. A linear aircraft
    is fast, and one stream draws all its flights.
    """
    size = min(FRESH_BATCH, recipe.most_at_once)
    sizes = [min(size, most - made) for made in range(0, most, size)]
    simulator = recipe.simulator()
    if isinstance(recipe, DatasetRecipe):
        rng = stream(recipe.seed, branch)
        yield from (simulator.rollouts(n, rng) for n in sizes)
        return
    numbered = ((simulator, n, (recipe.seed, branch, number)) for number, n in enumerate(sizes))
    yield from _results(_batch, numbered, executor)


def _results(
    task: Callable[..., Made], arguments: Iterable[tuple[Any, ...]], executor: Executor | None
) -> Iterator[Made]:
    """Results of a task in the order of its arguments; an executor computes a few of them ahead."""
    if executor is None:
        yield from starmap(task, arguments)
        return
    with Tasks(executor) as tasks:
        yield from tasks.results(task, arguments, CHUNKS_AHEAD)


def _batch(simulator: Simulator, n: int, seeded: tuple[Any, ...]) -> Rollouts:
    return simulator.rollouts(n, stream(*seeded))


class _Chunk(NamedTuple):
    """A chunk of rollouts.

    is_unsafe, is_stored: (n,).   stored: the rollouts of `is_stored`, all unsafe ones among them.
    """

    is_unsafe: Flags
    is_stored: Flags
    stored: Rollouts

    def first(self, n: int) -> "_Chunk":
        is_stored = self.is_stored[:n]
        n_stored = np.count_nonzero(is_stored)
        return _Chunk(self.is_unsafe[:n], is_stored, self.stored.some(slice(n_stored)))


def _chunk(recipe: SimulatedTest, simulator: Simulator, number: int, most_safe: int) -> _Chunk:
    """Roll out one numbered chunk, with its own random stream. most_safe: rollouts to store."""
    size = min(FIRST_CHUNK << min(number, 30), max(FIRST_CHUNK, recipe.most_at_once))
    rollouts = simulator.rollouts(size, stream(recipe.seed, Branch.ROLLOUTS, number))
    is_stored = _is_storable(rollouts, most_safe)
    return _Chunk(rollouts.is_unsafe, is_stored, _storable(rollouts, most_safe))


def _is_storable(rollouts: Rollouts, most_safe: int) -> Flags:
    """(n,) all unsafe rollouts, and the first `most_safe` safe ones."""
    return rollouts.is_unsafe | (np.cumsum(~rollouts.is_unsafe) <= most_safe)


def _storable(rollouts: Rollouts, most_safe: int) -> Rollouts:
    is_storable = _is_storable(rollouts, most_safe)
    return rollouts if is_storable.all() else rollouts.some(is_storable)


class _Failures:
    """Failing rollouts so far.

    n_met: all of them.   n: those in the smallest group, `scarcest`; all if groups are pooled.
    """

    def __init__(self, recipe: SimulatedTest) -> None:
        self._recipe = recipe
        self._met: Rollouts | None = None
        self.n_met = self.n = 0
        self.scarcest = ""

    def add(self, is_unsafe: Flags, rollouts: Rollouts) -> int:
        """Count failures up to the last one wanted; return the number of rollouts used.

        is_unsafe: (n,) of each one made.   rollouts: of these, at least the unsafe ones.
        """
        unsafe, before = np.flatnonzero(is_unsafe), self.n_met
        if not isinstance(self._recipe.groups, Pooled):
            failing = rollouts.some(rollouts.is_unsafe)
            self._met = failing if self._met is None else _joined([self._met, failing])
        self._count(before + len(unsafe))
        wanted = self._recipe.n_unsafe
        if self.n < wanted:
            return len(is_unsafe)
        more = range(1, len(unsafe) + 1)
        end = bisect_left(more, wanted, key=lambda n: self._fewest(before + n)[0])
        self._count(before + more[end])
        return int(unsafe[end]) + 1

    def _count(self, n_met: int) -> None:
        self.n_met = n_met
        self.n, self.scarcest = self._fewest(n_met)

    def _fewest(self, n_met: int) -> tuple[int, str]:
        """Size of the smallest group among the first n_met failures, and its name."""
        if self._met is None:
            return n_met, ""
        y, fail_index, _ = self._met.some(slice(n_met))
        grouping = self._recipe.groups.fit(y, fail_index, self._recipe.judged_by)
        if grouping is None:
            return 0, "a second group"
        rule, group = grouping
        sizes = [int(np.count_nonzero(group == k)) for k in range(len(rule.names))]
        return min(sizes), f"the group {rule.names[int(np.argmin(sizes))]!r}"


def _joined(parts: list[Rollouts]) -> Rollouts:
    return Rollouts(*map(np.concatenate, zip(*parts, strict=True)))


def _check_reach(failures: _Failures, recipe: SimulatedTest, n_made: int) -> None:
    """CollectionError if enough failures of each group are out of reach."""
    if not failures.scarcest:
        _check_budget(recipe, failures.n, n_made)
        return
    among = min(MOST_UNSAFE, int(recipe.max_rollouts * failures.n_met / n_made))
    highest = _highest_share(failures.n, failures.n_met)
    if n_made < recipe.max_rollouts and recipe.n_unsafe <= highest * among:
        return
    raise CollectionError(
        f"{failures.n} of {failures.n_met} unsafe rollouts were in {failures.scarcest}: "
        f"{recipe.n_unsafe} of each group are out of reach among {among} unsafe ones; change the "
        "groups or the limits, lower n_unsafe, or choose groups pooled"
    )


def _check_budget(recipe: SimulatedTest, n_unsafe: int, n_made: int) -> None:
    highest = _highest_share(n_unsafe, n_made)
    if n_made < recipe.max_rollouts and recipe.n_unsafe <= highest * recipe.max_rollouts:
        return
    enough = f" to about {ceil(recipe.n_unsafe * n_made / n_unsafe)}" if n_unsafe else ""
    remedy = recipe.for_more
    planned = replanned(recipe)
    if n_unsafe or planned is None or not planned.margins.label:
        remedy += f" or raise max_rollouts{enough}"
    try:
        remedy += f". {_working_amplitude(recipe)}"
    except AmplitudeError as error:
        remedy = f"{error}" if not n_unsafe else f"{remedy}. No suitable amplitude found: {error}"
    raise CollectionError(
        f"{n_unsafe} of {n_made} rollouts were unsafe (rate about {n_unsafe / n_made:.2g}, at "
        f"most {highest:.2g}): {recipe.n_unsafe} unsafe ones are out of reach within "
        f"{recipe.max_rollouts} rollouts; {remedy}".rstrip(". ")
    )


def _highest_share(k: int, n: int) -> float:
    """Upper confidence bound on a share of which k in n are known; wrong with CERTAINTY."""
    from scipy.special import betaincinv  # slow to import, and only needed here

    return float(betaincinv(k + 1, n - k or 1, 1 - CERTAINTY))


def _working_amplitude(test: SimulatedTest) -> str:
    """The suggested amplitude, as the last sentence of an error; empty if none can be searched.
    AmplitudeError if there is none."""
    if (recipe := replanned(test)) is None or recipe.margins.label:
        return ""
    return f"{suggest_amplitude(recipe)}"


def _dataset(
    recipe: SimulatedTest, simulator: Simulator, parts: list[Rollouts], n_safe_met: int
) -> Dataset:
    y, fail_index, theta = _joined(parts)
    is_unsafe = fail_index < y.shape[1]
    if n_safe_met == 0:
        remedy = f"{recipe.for_fewer} or raise n_unsafe"
        try:
            remedy += f". {_working_amplitude(recipe)}"
        except AmplitudeError as error:
            remedy = f"{error}"
        raise CollectionError(
            f"all {recipe.n_unsafe} rollouts were unsafe, but a monitor needs safe ones too: "
            f"{remedy}".rstrip(". ")
        )
    unsafe, fail_index = y[is_unsafe], fail_index[is_unsafe]
    unsafe[np.arange(y.shape[1]) > fail_index[:, None]] = np.nan
    safe = y[~is_unsafe]
    return Dataset(
        unsafe=unsafe,
        fail_index=fail_index,
        safe=safe,
        safe_times=_safe_times(recipe, len(safe), y.shape[1]),
        theta_unsafe=theta[is_unsafe],
        theta_safe=theta[~is_unsafe],
        dt=simulator.dt,
        theta_names=simulator.parameters.names,
        n_safe_met=n_safe_met,
        seed=recipe.seed,
        recipe=recipe.to_plain(),
        specification=recipe.judged_by,
        dictionary=simulator.dictionary,
    )


def _safe_times(recipe: SimulatedTest, n_safe: int, n_samples: int) -> Indices:
    """(n_safe, n_obs) random sample indices of each safe rollout, without repetition, ascending."""
    rng = stream(recipe.seed, Branch.SAFE_TIMES)
    times = np.empty((n_safe, recipe.n_obs), np.int64)
    for start in range(0, n_safe, LARGEST_CHUNK):
        part = times[start : start + LARGEST_CHUNK]
        order = rng.random((len(part), n_samples)).argsort(axis=1)
        part[:] = np.sort(order[:, : recipe.n_obs], axis=1)
    return times
