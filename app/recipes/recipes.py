"""Recipes from files, options and requests, with every value checked."""

import json
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import fields, is_dataclass, replace
from functools import cache
from itertools import takewhile
from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import PlainSerializer, TypeAdapter, ValidationError

from app.recipes.input_errors import given, input_errors
from app.telemetry.recording import TelemetryError
from app.telemetry.targets import check_limits
from core import recipe
from core.channels import BEYOND_FLIGHT, CHANNELS, Channel
from core.limits.flight_limits import LoadLimits
from core.limits.limits import Limits
from core.monitor.group import Pooled
from core.monitor.predictor import Ensemble, Scope
from core.monitor.recipe import METHODS, MonitorRecipe
from core.monitor.score import SCORES
from core.planned_test.amplitude import Suggestion, suggest_amplitude
from core.planned_test.nonlinear_test import JsbsimTest, NonlinearTest, SixDofTest
from core.planned_test.planned_test import DatasetRecipe, ManeuverTest
from core.recipe import RecipeError as RecipeError
from core.recipe import to_plain as to_plain
from core.simulation.aircraft import AIRCRAFT, MatrixAircraft
from core.simulation.jsbsim import JSBSIM_AIRCRAFT
from core.simulation.maneuver import MANEUVERS
from core.simulation.nonlinear_aircraft import NONLINEAR_AIRCRAFT
from core.simulation.pilot import usual_pilot

DEFAULT_KIND: str = to_plain(DatasetRecipe())["aircraft"]["kind"]
BEFORE_IMPERFECTIONS = {entry.name for entry in fields(DatasetRecipe)} - {
    *("imperfections", "pilot", "margins")
}
BEFORE_GUARANTEE = set(
    takewhile("guarantee".__ne__, (entry.name for entry in fields(MonitorRecipe)))
)
MATRICES = {"A": "a", "B": "b", "C": "c", "D": "d"}
"""Names of matrices as printed, and their parameters."""


Test = TypeVar("Test", bound=ManeuverTest)


def _changes(before: dict[str, Any], after: dict[str, Any]) -> dict[str, Any]:
    """Entries of `after` that differ from `before`, for nested objects with the same keys."""
    return {
        key: _changes(before[key], value) if isinstance(value, dict) else value
        for key, value in after.items()
        if value != before[key]
    }


TESTS: dict[str, ManeuverTest] = {
    "dataset": DatasetRecipe(),
    "nonlinear": NonlinearTest(),
    "jsbsim": JsbsimTest(),
}
"""The default test of each model of aircraft."""


def model_of(plain: Any) -> str:
    """The model of a test's aircraft, of TESTS."""
    aircraft = plain.get("aircraft") if isinstance(plain, dict) else None
    kind = aircraft.get("kind") if isinstance(aircraft, dict) else None
    models = {"nonlinear": NONLINEAR_AIRCRAFT, "jsbsim": JSBSIM_AIRCRAFT}
    return next((model for model, kinds in models.items() if kind in [*kinds]), "dataset")


def default_test(plain: Any) -> ManeuverTest:
    """The default recipe of a test with this aircraft."""
    model = model_of(plain)
    name = plain["aircraft"].get("model") if model == "jsbsim" else None
    return JsbsimTest.of(name) if isinstance(name, str) else TESTS[model]


@cache
def as_flown(model: str) -> dict[str, Any]:
    """The parts of a recipe with noise, jitter and imperfections as usual in flight."""
    return _changes(to_plain(TESTS[model]), to_plain(TESTS[model].as_trained()))


Imperfect = Literal["usual", "none"]
"""Whether rollouts have gusts, instrument errors, noise and pilot scatter as usual in flight."""
USUAL_DATASET = DatasetRecipe(n_unsafe=500).as_trained()
"""The default dataset."""
USUAL_TESTS = {
    model: replace(test, n_unsafe=USUAL_DATASET.n_unsafe).as_trained()
    for model, test in TESTS.items()
}
"""The default dataset of each model of aircraft."""
USUAL_MONITOR = MonitorRecipe(
    predictor=Ensemble(scope="near"), score=SCORES["highest_risk"], guarantee="95%"
)
"""The default monitor."""
NO_FLIGHT_LIMITS = {
    each.name: None for each in fields(LoadLimits) if not is_dataclass(each.default)
}
"""A nonlinear aircraft has the limits that are given, and no others."""
AUTO = "auto"
"""Value of an amplitude: the one that a pilot run suggests."""


SIMULATOR = "simulator"
"""Key of a recipe that names a user's simulator."""
LIMITS, STORED_LIMITS = "limits", "specification"
"""The name of the limits in requests and responses, and in stored recipes."""


def limits_named(plain: Any) -> Any:
    """A recipe with the names of requests and responses: `limits`, also in its parts."""
    if isinstance(plain, list):
        return [limits_named(value) for value in plain]
    if not isinstance(plain, dict):
        return plain
    return {
        LIMITS if key == STORED_LIMITS else key: limits_named(value) for key, value in plain.items()
    }


SentRecipe = Annotated[dict[str, Any], PlainSerializer(limits_named, dict[str, Any])]
"""A stored recipe in a response."""


def stored_names(plain: Any, where: str = "dataset") -> Any:
    """A recipe with the stored names: `limits` becomes `specification`.

    RecipeError if a part has both.
    """
    if not isinstance(plain, dict):
        return plain
    if plain.keys() >= {LIMITS, STORED_LIMITS}:
        raise RecipeError(
            f"{where} gives {LIMITS} and {STORED_LIMITS}, two names of one parameter: omit one"
        )
    return {
        STORED_LIMITS if key == LIMITS else key: stored_names(value, f"{where}.{key}")
        for key, value in plain.items()
    }


def from_plain(default: Any, plain: Any, where: str = "recipe") -> Any:
    """`default` with the values of `plain`, each checked for its type. RecipeError."""
    if isinstance(default, ManeuverTest) and isinstance(plain, dict) and SIMULATOR in plain:
        raise RecipeError(f"{where} {_not_simulated(plain)}")
    return recipe.from_plain(default, plain, where, _checked, {STORED_LIMITS: LIMITS})


def _not_simulated(plain: Mapping[str, Any]) -> str:
    if SIMULATOR not in plain:
        return "was not simulated here"
    return (
        f"is flown by the simulator {given(plain[SIMULATOR])}, which runs only on the command "
        "line, by forewarn train, never by a request or an upload"
    )


def simulated_test(plain: dict[str, Any]) -> ManeuverTest | None:
    """The recipe that a dataset or a monitor stores as plain data; None if it has no known one."""
    try:
        return from_plain(default_test(plain), plain, "dataset") if plain else None
    except ValueError:
        return None


def test_of(plain: dict[str, Any], what: str, remedy: str) -> ManeuverTest:
    """The recipe that `what` stores as plain data. RecipeError if it has no known one."""
    test = simulated_test(plain)
    if test is None:
        raise RecipeError(f"{what} {_not_simulated(plain)}: {remedy}")
    return test


@cache
def _adapter(kind: type[Any]) -> TypeAdapter[Any]:
    """Cached: making one takes milliseconds."""
    return TypeAdapter(kind)


def _checked(default: Any, values: Mapping[str, Any], where: str) -> Any:
    for key, value in values.items():
        if type(getattr(default, key, None)) in (int, float) and isinstance(value, str | bool):
            raise RecipeError(f"{where}.{key} is {given(value)}: give a number")
    try:
        return _adapter(type(default)).validate_python(values)
    except ValidationError as error:
        place, reason = input_errors(error.errors(), values)[0]
        if not place:  # parameters that contradict each other
            words = reason.partition(": ")[2]
            is_test = isinstance(default, ManeuverTest)  # whose words need no path
            raise RecipeError(words if is_test else f"{where}: {words}") from error
        raise RecipeError(f"{where}.{place} {reason}") from error


def dataset_recipe(plain: Any, where: str = "dataset") -> tuple[ManeuverTest, Suggestion | None]:
    """Read a dataset's recipe; a missing law, manoeuvre or limit is that of the usual test.

    `amplitude_deg` "auto", or none for a user's own model, becomes the amplitude that a pilot run
    suggests, which is also returned. RecipeError; AmplitudeError if there is none.
    """
    if not isinstance(plain, dict):
        return from_plain(DatasetRecipe(), plain, where), None
    plain = matrices_renamed(plain, where)
    maneuver = plain.get("maneuver", {})
    has_amplitude = isinstance(maneuver, dict) and not maneuver.keys().isdisjoint(
        {"amplitude_deg", "t_s"}
    )
    is_auto = has_amplitude and maneuver.get("amplitude_deg") == AUTO
    if is_auto:
        rest = {key: value for key, value in maneuver.items() if key != "amplitude_deg"}
        plain = plain | {"maneuver": rest}
    if isinstance(maneuver, dict) and "pilot" not in plain:
        flown = MANEUVERS.get(str(maneuver.get("kind")))
        if flown is not None and flown.captured:
            plain = plain | {"pilot": to_plain(usual_pilot(flown))}
    default, limits = default_test(plain), plain.get(STORED_LIMITS)
    if isinstance(default, SixDofTest) and isinstance(limits, dict):
        plain = plain | {STORED_LIMITS: NO_FLIGHT_LIMITS | limits}
    read: ManeuverTest = from_plain(default, _with_usual_test(plain), where)
    if isinstance(read, SixDofTest):
        turn = "load_factor" not in plain.get("condition", {})
        read = read.with_usual(limits=STORED_LIMITS not in plain, load_factor=turn)
    else:
        _check_limits(read.specification, f"{where}.{LIMITS}")
    if read.margins.label:
        read.first_margins()  # refuses those that there are not
    if not is_auto and (has_amplitude or not _is_own_model(plain)):
        return read, None
    suggestion = suggest_amplitude(read)
    return replace(read, maneuver=read.maneuver.with_peak(suggestion.amplitude_deg)), suggestion


def as_ordered(plain: Any, default: Imperfect = "usual", requested: Imperfect | None = None) -> Any:
    """A requested dataset recipe, completed with noise, jitter and imperfections, and, if these are
    as usual in flight, with the usual number of failures.

    requested: how to complete it; its `imperfections` may be this word too.   default: how to
    complete it if neither is given. A complete recipe of a version without imperfections has none.
    """
    plain = stored_names(plain)
    if isinstance(plain, dict) and plain.get("imperfections") in get_args(Imperfect):
        requested = plain["imperfections"]
        plain = {key: value for key, value in plain.items() if key != "imperfections"}
    is_whole = isinstance(plain, dict) and plain.keys() >= BEFORE_IMPERFECTIONS
    if default == "usual" and isinstance(plain, dict):
        plain = {"n_unsafe": USUAL_DATASET.n_unsafe} | plain
    if (requested or ("none" if is_whole else default)) == "none":
        return plain
    return overlay(deepcopy(as_flown(model_of(plain))), plain)


def dataset_for(monitor: MonitorRecipe, dataset: Test) -> Test:
    """The dataset for a monitor; a monitor with groups gets equally many failures of each."""
    return (
        replace(dataset, groups=monitor.groups) if isinstance(dataset.groups, Pooled) else dataset
    )


def monitor_as_ordered(plain: Any) -> Any:
    """A requested monitor recipe, completed with the usual guarantee and method.

    A predictor alone gets its usual score, and a score its predictor. Exact p-values and pointwise
    calibration without a method mean the paper's method. A complete recipe of a version without
    guarantees is not changed.
    """
    if not isinstance(plain, dict) or plain.keys() >= BEFORE_GUARANTEE:
        return plain
    ordered = {"guarantee": USUAL_MONITOR.guarantee} | _method(plain) | plain
    predictor = ordered.get("predictor")
    if isinstance(predictor, dict) and predictor.get("kind") == "ensemble":
        given = plain.get("predictor", {})
        ordered["predictor"] = predictor | {"scope": _usual_scope(plain)} | given
    return ordered


def _usual_scope(plain: dict[str, Any]) -> Scope:
    """The scope of an ensemble if none is given; groups need the planned one."""
    groups = plain.get("groups", {})
    is_pooled = isinstance(groups, dict) and groups.get("kind", "pooled") == "pooled"
    return "near" if is_pooled else "planned"


def _method(plain: dict[str, Any]) -> dict[str, Any]:
    """Predictor and score of the first method that has the given one; else the paper's."""
    given = {part: plain[part] for part in ("predictor", "score") if part in plain}
    is_of_neighbors = plain.get("p_value") == "exact" or plain.get("calibration") == "pointwise"
    if len(given) == 2 or (not given and is_of_neighbors):
        return {}
    for predictor, score in METHODS.values():
        method = {"predictor": to_plain(predictor), "score": to_plain(score)}
        kinds = {part: isinstance(m, dict) and m.get("kind") for part, m in given.items()}
        if all(kind == method[part]["kind"] for part, kind in kinds.items()):
            return method
    return {}


def matrices_renamed(plain: dict[str, Any], where: str = "dataset") -> dict[str, Any]:
    """A dataset's recipe with the matrices of aircraft and law under their parameters' names.

    An aircraft given as matrices needs neither its kind nor names of states, as in a model's file.
    RecipeError if a matrix is given twice, in capitals and in small letters.
    """
    renamed = {}
    for part in {"aircraft", "control_law"} & plain.keys():
        given = plain[part]
        if not isinstance(given, dict):
            continue
        if twice := [name for name, key in MATRICES.items() if {name, key} <= given.keys()]:
            raise RecipeError(f"{where}.{part} has the matrix {twice[0]} twice: omit one")
        renamed[part] = {MATRICES.get(key, key): value for key, value in given.items()}
        if part == "aircraft" and "a" in renamed[part]:
            renamed[part] = {"kind": "matrices", "states": []} | renamed[part]
    return plain | renamed


def _check_limits(limits: Limits, where: str) -> None:
    """RecipeError for an implausibly large limit, such as degrees given as radians."""
    for channel in CHANNELS:
        limit = getattr(limits, channel.key)
        if limit is None or limit <= BEYOND_FLIGHT.get(channel.unit, inf):
            _check_reached(channel, limit, where)
            continue
        meant = f"{limit:g}{channel.display_unit}"
        raise RecipeError(
            f"{where}.{channel.key} is {limit:g} {channel.unit}, which is "
            f"{channel.read(limit)} and implausibly large: for {meant} give "
            f"{limit / channel.display_factor:.4g} {channel.unit}, or on the command line "
            f"--limit {channel.key}={meant}"
        )


def _check_reached(channel: Channel, limit: float | None, where: str) -> None:
    try:
        check_limits(channel, limit)
    except TelemetryError as error:
        raise RecipeError(f"{where}: {error}") from None


def _is_own_model(plain: dict[str, Any]) -> bool:
    """Whether the aircraft is given as matrices, without a known usual amplitude."""
    aircraft = plain.get("aircraft")
    return isinstance(aircraft, MatrixAircraft) or (isinstance(aircraft, dict) and "a" in aircraft)


def _with_usual_test(plain: dict[str, Any]) -> dict[str, Any]:
    """Complete a dataset's recipe from the usual test of its aircraft."""
    aircraft = plain.get("aircraft", {"kind": DEFAULT_KIND})
    kind = aircraft.get("kind", DEFAULT_KIND) if isinstance(aircraft, dict) else None
    if not (isinstance(kind, str) and kind in AIRCRAFT):
        return plain
    usual = DatasetRecipe.usual(AIRCRAFT[kind])
    filled = plain if LIMITS in plain else {STORED_LIMITS: usual.specification} | plain
    for part in ("control_law", "maneuver"):
        default, given = to_plain(getattr(usual, part)), plain.get(part, {})
        if isinstance(given, dict) and given.get("kind", default["kind"]) == default["kind"]:
            filled[part] = default | given
    return filled


def overlay(below: Any, above: Any) -> Any:
    """Nested plain data: values of `above` replace those of `below`."""
    if not (isinstance(below, dict) and isinstance(above, dict)):
        return above
    return below | {key: overlay(below.get(key), value) for key, value in above.items()}


def read_plain(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RecipeError(f"{path} is not readable ({error.strerror}): give a JSON file") from error
    except ValueError as error:
        raise RecipeError(f"{path} is not JSON ({error}): correct it") from error


def set_path(plain: dict[str, Any], dotted: str, value: Any) -> None:
    """Set `a.b.c` in nested objects, creating missing ones.

    Another kind of a monitor's part begins with its own defaults.
    """
    *parents, last = dotted.split(".")
    for parent in parents:
        plain = plain.setdefault(parent, {})
        if not isinstance(plain, dict):
            raise RecipeError(f"{dotted} cannot be set: {parent} is a value, not an object")
    if parents[:1] == ["monitor"] and last == "kind" and plain.get(last, value) != value:
        plain.clear()
    plain[last] = value
