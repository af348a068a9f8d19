"""Collection: roll out the manoeuvre on random aircraft until enough of them turned unsafe."""

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import replace
from itertools import count

import numpy as np

from core.amplitude import suggest_amplitude
from core.card import Card, CardError
from core.channels import KEYS
from core.dataset import Dataset
from core.monitor.group import Pooled
from core.planned_test import DatasetRecipe, Rollouts, Simulator
from core.recipe import to_plain
from core.seeds import Branch, stream
from core.simulation.imperfections import channel_array
from core.simulation.maneuver import COLUMN, Steps
from core.simulation.rollout import roll_out
from core.types import Indices

Progress = Callable[[int, int], object]

FIRST_CHUNK, LARGEST_CHUNK = 256, 4096
CHUNK_STEPS = 2_000_000
"""Steps of all rollouts of a chunk: about 100 MB."""
MOST_UNSAFE = 20_000
"""Unsafe rollouts that are collected for the sake of a scarce group."""
CERTAINTY = 1e-6
FRESH_BATCH, MOST_FRESH = 1_000, 20_000
"""Fresh flights of a batch, and in all unless asked for more."""
TRAINING_ROLLOUTS = 2_000
CARD_PLANTS = 500
"""Aircraft whose step response a card knows: more change no digit of a monitor's power."""


class CollectionError(ValueError):
    """A collection that would not end, or that leaves too few safe rollouts."""


def collect(
    recipe: DatasetRecipe,
    *,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Dataset:
    """Roll out until recipe.n_unsafe rollouts turned unsafe; keep the safe ones met on the way.

    Of a recipe with groups, as many at least of each group; what others have more is kept too.

    executor: where chunks are rolled out; here, on the kernels' threads, unless given. The result
    depends on the recipe alone.
    progress: called with (unsafe rollouts found, rollouts made); what it raises cancels.
    CollectionError where the budget cannot suffice or too few safe rollouts remain.
    """
    simulator, failures = Simulator(recipe), _Failures(recipe)
    parts: list[Rollouts] = []
    n_made = n_safe_stored = 0
    for rollouts in _chunks(simulator, executor):
        rollouts = rollouts.some(slice(recipe.max_rollouts - n_made))
        rollouts = rollouts.some(slice(failures.take(rollouts)))
        n_made += len(rollouts.y)
        keep = rollouts.is_unsafe | (
            n_safe_stored + np.cumsum(~rollouts.is_unsafe) <= recipe.max_safe
        )
        if not keep.all():
            rollouts = rollouts.some(keep)
        n_safe_stored += np.count_nonzero(~rollouts.is_unsafe)
        parts.append(rollouts)
        if progress:
            progress(min(failures.n, recipe.n_unsafe), n_made)
        if failures.n >= recipe.n_unsafe:
            return _dataset(simulator, parts, n_made - failures.n_met)
        _check_reach(failures, recipe, n_made)
    raise AssertionError("chunks never end")


def fresh(recipe: DatasetRecipe, most: int = MOST_FRESH) -> Iterator[Rollouts]:
    """Roll out flights that neither train nor test a monitor of this recipe, for its validity.

    Batches as large as memory likes, `most` flights in all; made as they are asked for.
    """
    simulator = Simulator(recipe)
    rng, made = stream(recipe.seed, Branch.VALIDITY), 0
    size = max(1, min(FRESH_BATCH, CHUNK_STEPS // recipe.n_steps))
    while made < most:
        flights = simulator.rollouts(min(size, most - made), rng)
        made += len(flights.y)
        yield flights


def combination_failures(
    recipe: DatasetRecipe, n: int, progress: Progress | None = None
) -> tuple[Rollouts, int]:
    """Roll out until n flights failed that taught no monitor of this recipe, for a combination.

    progress: called with (failures found, flights made); what it raises cancels.
    Returns the failing flights, and how many were made for them.   CollectionError where the
    recipe's budget of rollouts cannot suffice.
    """
    simulator, rng = Simulator(recipe), stream(recipe.seed, Branch.COMBINATION)
    size = max(1, min(FRESH_BATCH, CHUNK_STEPS // recipe.n_steps))
    parts: list[Rollouts] = []
    found = made = 0
    while found < n:
        flights = simulator.rollouts(min(size, recipe.max_rollouts - made), rng)
        failed = np.flatnonzero(flights.is_unsafe)[: n - found]
        found += len(failed)
        made += int(failed[-1]) + 1 if found == n else len(flights.y)
        parts.append(flights.some(failed))
        if progress:
            progress(found, made)
        if found < n:
            _check_budget(replace(recipe, n_unsafe=n), found, made)
    return _joined(parts), made


def evaluation_flights(recipe: DatasetRecipe, n: int) -> Rollouts:
    """Roll out n flights that neither train a monitor of this recipe nor calibrate its validity."""
    return Simulator(recipe).rollouts(n, stream(recipe.seed, Branch.TEST))


def stopped_flights(
    recipe: DatasetRecipe, n: int, which: Indices, neutral_from: Indices
) -> Indices:
    """Fly some of these n flights again, the same but that the manoeuvre is stopped on the way.

    which: (m,) numbers.   neutral_from: (m,) sample from which on the controls are held neutral.
    Returns (m,) their first sample that exceeds a limit, n_samples where none does.
    """
    return stopping_flights(recipe, n)(which, neutral_from)


def stopping_flights(recipe: DatasetRecipe, n: int) -> Callable[[Indices, Indices], Indices]:
    """The same for several times: draw the n flights once, to fly them again as is asked for."""
    return Simulator(recipe).stopping(n, stream(recipe.seed, Branch.TEST))


def training_rollouts(recipe: DatasetRecipe, n: int = TRAINING_ROLLOUTS) -> Rollouts:
    """Roll out n flights for a forecast of peaks to learn from, which calibrate and test nothing.

    The outputs of those that fail go on behind the failure.
    """
    return Simulator(recipe).rollouts(n, stream(recipe.seed, Branch.FORECAST))


def card_of(recipe: DatasetRecipe, n_plants: int = CARD_PLANTS) -> Card:
    """The card of the planned manoeuvre, for monitors that know what input is still to come.

    n_plants: aircraft whose response to its first step is simulated.
    CardError for a manoeuvre that is no sequence of steps of one surface.
    """
    maneuver = recipe.maneuver
    if not isinstance(maneuver, Steps) or not (switches := maneuver.switches):
        raise CardError(
            f"the manoeuvre {type(maneuver).__name__} is no sequence of steps, so that responses "
            "to each cannot be told apart: choose the predictor peak_ridge"
        )
    simulator, rng = Simulator(recipe), stream(recipe.seed, Branch.CARD)
    times, steps = np.array(switches).T
    n_lags = maneuver.n_samples(recipe.dt) - round(times[0] / recipe.dt)
    factor = 1.0 + maneuver.amplitude_jitter * rng.standard_normal(n_plants)
    factor *= maneuver.steps_flown(n_plants, rng)
    command = np.zeros((n_plants, n_lags, len(COLUMN)))
    command[..., COLUMN[maneuver.surface]] = (np.deg2rad(steps[0]) * factor)[:, None]
    responses = roll_out(
        simulator.plant.plants(simulator.plant.sample(n_plants, rng)),
        simulator.controller,
        recipe.control_law.actuator,
        command,
        recipe.dt,
        pedal_lag_s=maneuver.pedal_lag_s,
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
    )


def _chunks(simulator: Simulator, executor: Executor | None) -> Iterator[Rollouts]:
    """Chunks in order; with an executor, a few of them under way ahead of time."""
    if executor is None:
        yield from (_chunk(simulator, number) for number in count())
        return
    under_way = deque(executor.submit(_chunk, simulator, number) for number in range(4))
    try:
        for number in count(4):
            yield under_way.popleft().result()
            under_way.append(executor.submit(_chunk, simulator, number))
    finally:
        for future in under_way:
            future.cancel()


def _chunk(simulator: Simulator, number: int) -> Rollouts:
    """Roll out the chunk of this number of the recipe's seed, each with its own stream."""
    recipe = simulator.recipe
    largest = max(FIRST_CHUNK, min(LARGEST_CHUNK, CHUNK_STEPS // recipe.n_steps))
    size = min(FIRST_CHUNK << min(number, 30), largest)
    return simulator.rollouts(size, stream(recipe.seed, Branch.ROLLOUTS, number))


class _Failures:
    """Failing rollouts met so far.

    n_met: all of them.   n: those of the group that has fewest, `scarcest`; all of them where all
    are pooled.
    """

    def __init__(self, recipe: DatasetRecipe) -> None:
        self._recipe = recipe
        self._met: Rollouts | None = None
        self.n_met = self.n = 0
        self.scarcest = ""

    def take(self, rollouts: Rollouts) -> int:
        """Count those of a chunk up to the last one wanted; return how many rollouts that takes."""
        unsafe, before = np.flatnonzero(rollouts.is_unsafe), self.n_met
        if not isinstance(self._recipe.groups, Pooled):
            failing = rollouts.some(unsafe)
            self._met = failing if self._met is None else _joined([self._met, failing])
        self._count(before + len(unsafe))
        wanted = self._recipe.n_unsafe
        if self.n < wanted:
            return len(rollouts.y)
        more = range(1, len(unsafe) + 1)
        end = bisect_left(more, wanted, key=lambda n: self._fewest(before + n)[0])
        self._count(before + more[end])
        return int(unsafe[end]) + 1

    def _count(self, n_met: int) -> None:
        self.n_met = n_met
        self.n, self.scarcest = self._fewest(n_met)

    def _fewest(self, n_met: int) -> tuple[int, str]:
        """Of the first ones met, how many the group has that has fewest, and its name."""
        if self._met is None:
            return n_met, ""
        y, fail_index, _ = self._met.some(slice(n_met))
        found = self._recipe.groups.fit(y, fail_index, self._recipe.specification)
        if found is None:
            return 0, "a second group"
        rule, group = found
        sizes = [int(np.count_nonzero(group == k)) for k in range(len(rule.names))]
        return min(sizes), f"the group {rule.names[int(np.argmin(sizes))]!r}"


def _joined(parts: list[Rollouts]) -> Rollouts:
    return Rollouts(*map(np.concatenate, zip(*parts, strict=True)))


def _check_reach(failures: _Failures, recipe: DatasetRecipe, n_made: int) -> None:
    """CollectionError where not enough failures, of each group, can be met."""
    if not failures.scarcest:
        _check_budget(recipe, failures.n, n_made)
        return
    among = min(MOST_UNSAFE, int(recipe.max_rollouts * failures.n_met / n_made))
    highest = _highest_share(failures.n, failures.n_met)
    if n_made < recipe.max_rollouts and recipe.n_unsafe <= highest * among:
        return
    raise CollectionError(
        f"{failures.n} of {failures.n_met} unsafe rollouts were of {failures.scarcest}: "
        f"{recipe.n_unsafe} of each group are out of reach among {among} unsafe ones; change the "
        "groups or the limits, lower n_unsafe, or choose groups pooled"
    )


def _check_budget(recipe: DatasetRecipe, n_unsafe: int, n_made: int) -> None:
    highest = _highest_share(n_unsafe, n_made)
    if n_made < recipe.max_rollouts and recipe.n_unsafe <= highest * recipe.max_rollouts:
        return
    raise CollectionError(
        f"{n_unsafe} of {n_made} rollouts were unsafe (rate about {n_unsafe / n_made:.2g}, surely "
        f"below {highest:.2g}): {recipe.n_unsafe} unsafe ones are out of reach within "
        f"{recipe.max_rollouts} rollouts; raise the amplitude, lower the limit or raise "
        f"max_rollouts. {_working_amplitude(recipe)}"
    )


def _highest_share(k: int, n: int) -> float:
    """Largest share of which k of n are as good as ever found."""
    from scipy.special import betaincinv  # slow to import, and only needed here

    return float(betaincinv(k + 1, n - k or 1, 1 - CERTAINTY))


def _working_amplitude(recipe: DatasetRecipe) -> str:
    """What a pilot run says of the amplitude, as the end of an error."""
    try:
        return f"{suggest_amplitude(recipe)}"
    except ValueError as error:
        return f"No amplitude was found: {error}"


def _dataset(simulator: Simulator, parts: list[Rollouts], n_safe_met: int) -> Dataset:
    recipe = simulator.recipe
    y, fail_index, theta = _joined(parts)
    is_unsafe = fail_index < y.shape[1]
    if n_safe_met == 0:
        raise CollectionError(
            f"all {recipe.n_unsafe} rollouts were unsafe and a monitor needs safe ones too: lower "
            f"the amplitude, raise the limit or raise n_unsafe. {_working_amplitude(recipe)}"
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
        dt=recipe.dt,
        theta_names=simulator.plant.names,
        n_safe_met=n_safe_met,
        seed=recipe.seed,
        recipe=to_plain(recipe),
        specification=recipe.specification,
    )


def _safe_times(recipe: DatasetRecipe, n_safe: int, n_samples: int) -> Indices:
    """(n_safe, n_obs) random sample indices of each safe rollout, without repetition, ascending."""
    rng = stream(recipe.seed, Branch.SAFE_TIMES)
    times = np.empty((n_safe, recipe.n_obs), np.int64)
    for start in range(0, n_safe, LARGEST_CHUNK):
        part = times[start : start + LARGEST_CHUNK]
        order = rng.random((len(part), n_samples)).argsort(axis=1)
        part[:] = np.sort(order[:, : recipe.n_obs], axis=1)
    return times
