"""Requests for long work, checked in full before they are queued."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

from app.jobs.training import calibrating, test_to_fly
from app.recipes.labels import aircraft_label, kind_label
from app.recipes.recipes import (
    USUAL_DATASET,
    USUAL_MONITOR,
    Imperfect,
    RecipeError,
    as_ordered,
    dataset_for,
    dataset_recipe,
    from_plain,
    monitor_as_ordered,
    simulated_test,
    test_of,
    to_plain,
)
from app.store.store import Store
from core.bounds import Bounds, check_bounds, quoted
from core.channels import CHANNELS
from core.evaluation.epsilon_choice import ChoiceRecipe
from core.evaluation.lead_sweep import SweepRecipe, check_leads, planned_tests
from core.evaluation.study import StudyRecipe
from core.monitor import Monitor, MonitorRecipe
from core.monitor.calibration import Guarantee, check_epsilon
from core.monitor.combination import check_members
from core.monitor.predictor import NOT_TRAINED
from core.monitor.recipe import MISS_RATE
from core.monitor.training import check_lead
from core.planned_test.amplitude import WANTED_SHARE, Suggestion, suggest_amplitude
from core.planned_test.collection import LARGEST_CHUNK, DatasetRecipe, card_of
from core.planned_test.planned_test import ManeuverTest
from core.simulation.maneuver import Maneuver

LONGEST_NAME = 200
LARGEST_N_MONITORS = 100
N_TEST = 2000
"""Fresh flights of a monitor's evaluation, by default."""
LARGEST_N_TEST = 100_000
MOST_MEMBERS, MOST_LEADS = 16, 20
BYTES = 8


Requested = str | ManeuverTest
"""The id of a stored dataset, or a recipe to simulate."""


class MonitorRequest(NamedTuple):
    """A monitor to train, its dataset, and the number of fresh test flights.

    choose: whether own flights choose its method.
    """

    name: str
    dataset: Requested
    recipe: MonitorRecipe
    n_test: int
    choose: bool = False


@dataclass(frozen=True)
class CombinationRecipe:
    """How to combine several monitors of one planned test."""

    lead: Annotated[float, Bounds(above=0, words="the lead must be positive")] = 0.5
    """warning lead time [s]: equal to that of a member; an alert of any member in time counts."""
    n_unsafe: Annotated[int, Bounds(least=2, below=LARGEST_N_TEST + 1)] = USUAL_DATASET.n_unsafe
    """fresh failures: failing flights that calibrate the common rule."""
    epsilon: Annotated[float, MISS_RATE] = USUAL_MONITOR.epsilon
    """accepted miss rate epsilon: accepted share of missed failures."""
    guarantee: Guarantee = USUAL_MONITOR.guarantee
    """promise on the miss rate: on `average` over many such combinations, or for this one with
    `95%` confidence, which is exact because these flights chose nothing else."""
    n_test: Annotated[int, Bounds(least=0, below=LARGEST_N_TEST + 1)] = N_TEST
    """fresh test flights."""

    def __post_init__(self) -> None:
        check_bounds(self)
        check_epsilon(self.epsilon, self.n_unsafe, self.guarantee)


def dataset_request(plain: dict[str, Any], max_bytes: int) -> tuple[str, ManeuverTest]:
    """Read the body of a request for a dataset: its name and recipe. RecipeError."""
    plain = dict(plain)
    name = _name(plain)
    recipe = _dataset_recipe(plain, max_bytes)
    return name or dataset_name(recipe), recipe


def amplitude_suggestion(plain: dict[str, Any], max_bytes: int) -> tuple[Suggestion, Maneuver]:
    """The suggested amplitude for a dataset's recipe and the wanted `share` of failing flights.

    Also returns the manoeuvre at this amplitude.   RecipeError, also if no amplitude gives it.
    """
    plain = dict(plain)
    share = plain.pop("share", WANTED_SHARE)
    if isinstance(share, bool) or not isinstance(share, int | float):
        raise RecipeError(f"share is {quoted(share)}: give a number between 0 and 1")
    plain.pop("name", None)
    recipe = _dataset_recipe(plain, max_bytes)
    with _refusing():
        suggestion = suggest_amplitude(recipe, share)
    return suggestion, recipe.maneuver.with_peak(suggestion.amplitude_deg)


def monitor_request(plain: dict[str, Any], store: Store, max_bytes: int) -> MonitorRequest:
    """Read the body of a request for a monitor. RecipeError."""
    plain = dict(plain)
    name = _name(plain)
    requested = _requested_dataset(plain, store, max_bytes)
    n_test = _count(plain, "n_test", N_TEST, 0, LARGEST_N_TEST)
    choose = plain.keys().isdisjoint({"predictor", "score"})
    recipe = _recipe(MonitorRecipe(), monitor_as_ordered(plain), "monitor")
    if recipe.predictor.forecast == "members":
        raise RecipeError(f"monitor.predictor: {NOT_TRAINED}")
    if isinstance(requested, str):
        info = store.datasets.info(requested)
        duration, n_unsafe = (info.n_samples - 1) * info.dt, info.n_unsafe
        if simulated_test(info.recipe) is None:
            n_unsafe = calibrating(n_unsafe)  # no fresh ones can be simulated
            if recipe.predictor.forecast == "ensemble" and not choose:
                n_unsafe -= n_unsafe // 2  # the others train
    else:
        requested = dataset_for(recipe, requested)
        duration, n_unsafe = requested.maneuver.duration_s, requested.n_unsafe
        _check_test_size(requested, n_test, max_bytes)
    with _refusing("monitor."):
        check_lead(recipe.t_early, duration)
    with _refusing():
        check_epsilon(recipe.epsilon, n_unsafe, recipe.guarantee)
    if recipe.predictor.forecast == "card":
        with _refusing("monitor.predictor: "):
            remedy = "or choose the predictor peak_ridge"
            card_of(_linear(_test_of(requested, store, remedy), remedy), 2)
    return MonitorRequest(name or f"{recipe.t_early:g} s ahead", requested, recipe, n_test, choose)


def combination_request(
    plain: dict[str, Any], store: Store, max_bytes: int
) -> tuple[str, list[str], CombinationRecipe]:
    """Read the body of a request for a combination: name, ids and recipe. RecipeError."""
    plain = dict(plain)
    name, ids = _name(plain), plain.pop("monitors", None)
    if not (
        isinstance(ids, list)
        and all(isinstance(monitor_id, str) for monitor_id in ids)
        and 2 <= len(set(ids)) == len(ids) <= MOST_MEMBERS
    ):
        raise RecipeError(
            f"monitors is {quoted(ids)}: give the ids of 2 to {MOST_MEMBERS} stored monitors of "
            "one planned test, each once"
        )
    recipe = _recipe(CombinationRecipe(), plain, "combination")
    with _refusing():
        dataset = planned_test([store.monitors.get(each) for each in ids], recipe.lead)
    _check_test_size(dataset, max(recipe.n_test, recipe.n_unsafe), max_bytes)
    name = name or f"{len(ids)} monitors as one, {recipe.lead:g} s ahead"
    return name, ids, recipe


def planned_test(members: Sequence[Monitor], lead: float) -> ManeuverTest:
    """The planned test of all members, one of which has this lead [s].

    ValueError if they do not fit together or were not trained on simulated flights.
    """
    return test_of(
        check_members(members, lead).dataset_recipe,
        "the test of the members",
        "combine them in Python, core.monitor.combine(members, flights, lead=...), on failing "
        "flights of your own",
    )


def study_request(plain: dict[str, Any], store: Store, max_bytes: int) -> StudyRecipe:
    """Read the body of a request for the study; a stored dataset gives its recipe."""
    plain = dict(plain)
    requested = _requested_dataset(plain, store, max_bytes, default="none")
    dataset = _test_of(requested, store)
    recipe: StudyRecipe = _recipe(StudyRecipe(), plain, "study")
    _check_most(recipe, "study", n_monitors=LARGEST_N_MONITORS, n_test=LARGEST_N_TEST)
    _check_test_size(dataset, recipe.n_test, max_bytes)
    with _refusing():
        return replace(recipe, dataset=dataset)


def sweep_request(
    plain: dict[str, Any], store: Store, max_bytes: int
) -> tuple[SweepRecipe, Mapping[str, ManeuverTest]]:
    """Read the body of a request for a sweep: its recipe, and planned tests by name. RecipeError.

    A `dataset` replaces `tests`.
    """
    plain = dict(plain)
    requested = _requested_dataset(plain, store, max_bytes) if "dataset" in plain else None
    if requested and not {"tests", "imperfections"}.isdisjoint(plain):
        raise RecipeError(
            "dataset was given with tests or imperfections: its recipe has both; leave them out"
        )
    recipe: SweepRecipe = _recipe(SweepRecipe(), plain, "sweep")
    numbers = dict.fromkeys(("n_test", "n_unsafe"), LARGEST_N_TEST)
    _check_most(recipe, "sweep", n_monitors=LARGEST_N_MONITORS, leads_s=MOST_LEADS, **numbers)
    if requested is None:
        tests = planned_tests(recipe.tests, recipe.imperfections)
    else:
        dataset = _test_of(requested, store)
        tests = {dataset_name(dataset): dataset}
        if recipe.ceiling:
            _linear(dataset, "for sweep.ceiling, or leave it out")
        if recipe.ceiling and not dataset.imperfections.are_none:
            raise RecipeError(
                "sweep.ceiling works only without imperfections: leave it out, or give a dataset "
                "whose recipe has none"
            )
    for test in tests.values():
        _check_test_size(test, max(recipe.n_test, recipe.n_unsafe), max_bytes)
    with _refusing():
        check_leads(recipe, tests)
    return recipe, tests


def _test_of(requested: Requested, store: Store, remedy: str = "") -> ManeuverTest:
    """The recipe, given or stored. RecipeError if a stored dataset was not simulated."""
    if isinstance(requested, ManeuverTest):
        return requested
    remedy = f"give a recipe instead {remedy}".strip()
    return test_of(store.datasets.info(requested).recipe, f"dataset {requested}", remedy)


def _linear(recipe: ManeuverTest, remedy: str) -> DatasetRecipe:
    """The recipe if its aircraft is linear. RecipeError."""
    if isinstance(recipe, DatasetRecipe):
        return recipe
    raise RecipeError(f"dataset.aircraft is nonlinear: choose a linear aircraft {remedy}".strip())


def choice_request(
    plain: dict[str, Any], store: Store, monitor_id: str
) -> tuple[Monitor, ChoiceRecipe]:
    """Read the body of a request to choose a stored monitor's epsilon. RecipeError."""
    monitor = store.monitors.get(monitor_id)
    with _refusing():
        test_to_fly(monitor)
    absent = {"most_missed": None, "most_false_alarms": None}
    recipe: ChoiceRecipe = _recipe(ChoiceRecipe(0.1, 0.2), absent | plain, "epsilon")
    _check_most(recipe, "epsilon", n_test=LARGEST_N_TEST)
    return monitor, recipe


def check_size(recipe: ManeuverTest, max_bytes: int) -> None:
    """RecipeError if the recipe's arrays may need more memory than the server allows."""
    samples = recipe.maneuver.duration_s / recipe.dt + 1
    stored = (min(recipe.max_safe, recipe.max_rollouts) + recipe.n_unsafe) * samples
    run_up = recipe.imperfections.run_up(recipe.dt)
    chunk = LARGEST_CHUNK * (run_up + samples) * recipe.substeps
    needed = max(stored, chunk) * _channels(recipe) * BYTES
    if needed > max_bytes:
        raise RecipeError(
            f"{samples:.6g} samples a rollout, substeps={recipe.substeps}, "
            f"n_unsafe={recipe.n_unsafe} and max_safe={recipe.max_safe} may need "
            f"{needed / 2**30:.3g} GiB, this server allows {max_bytes / 2**30:.3g}: ask for fewer, "
            "or raise FOREWARN_MAX_ARRAY_BYTES"
        )


def _dataset_recipe(plain: Any, max_bytes: int, default: Imperfect = "usual") -> ManeuverTest:
    with _refusing():
        recipe, _ = dataset_recipe(as_ordered(plain, default))
    check_size(recipe, max_bytes)
    with _refusing():
        recipe.maneuver.n_samples(recipe.dt)
        recipe.simulator()
    return recipe


def _recipe(default: Any, plain: Any, where: str) -> Any:
    with _refusing():
        return from_plain(default, plain, where)


@contextmanager
def _refusing(where: str = "") -> Iterator[None]:
    """Raise ValueError and OverflowError of the block as RecipeError."""
    try:
        yield
    except RecipeError:
        raise
    except OverflowError as error:
        raise RecipeError(f"{where}a number is out of range: {error}") from None
    except ValueError as error:
        raise RecipeError(f"{where}{error}") from None


def _check_most(recipe: Any, where: str, **most: int) -> None:
    """RecipeError for a number, or a list, larger than this server allows."""
    for name, largest in most.items():
        value = getattr(recipe, name)
        value = len(value) if isinstance(value, tuple) else value
        if value > largest:
            raise RecipeError(f"{where}.{name} is {value}: this server allows at most {largest}")


def _requested_dataset(
    plain: dict[str, Any], store: Store, max_bytes: int, default: Imperfect = "usual"
) -> Requested:
    given = plain.pop("dataset", None)
    if isinstance(given, str):
        store.datasets.info(given)
        return given
    if isinstance(given, dict):
        return _dataset_recipe(given, max_bytes, default)
    raise RecipeError(
        f"dataset is {given!r}: give the id of a stored dataset, or its recipe, an object"
    )


def _name(plain: dict[str, Any]) -> str | None:
    name = plain.pop("name", None)
    if name is None:
        return None
    if not isinstance(name, str) or not 0 < len(name) <= LONGEST_NAME:
        raise RecipeError(f"name is {quoted(name)}: give 1 to {LONGEST_NAME} characters")
    return name


def _count(plain: dict[str, Any], key: str, default: int, lowest: int, highest: int) -> int:
    value = plain.pop(key, default)
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool) or not lowest <= value <= highest:
        raise RecipeError(f"{key} is {quoted(value)}: give an integer from {lowest} to {highest}")
    return value


def _check_test_size(recipe: ManeuverTest, n_test: int, max_bytes: int) -> None:
    run_up = recipe.imperfections.run_up(recipe.dt)
    samples = (run_up + recipe.maneuver.duration_s / recipe.dt + 1) * recipe.substeps
    if n_test * samples * _channels(recipe) * BYTES > max_bytes:
        raise RecipeError(
            f"n_test={n_test} fresh flights are too many for this server: ask for fewer"
        )


def _channels(recipe: ManeuverTest) -> int:
    if isinstance(recipe, DatasetRecipe):
        return len(CHANNELS)
    return len(recipe.specification.dictionary)


def dataset_name(recipe: ManeuverTest) -> str:
    plain = to_plain(recipe)
    maneuver = kind_label(plain["maneuver"]["kind"])
    return f"{aircraft_label(plain['aircraft'])}, {maneuver}, seed {recipe.seed}"
