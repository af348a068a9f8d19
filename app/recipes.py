"""Recipes as people write them, in files, options and requests: checked value by value."""

import json
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import fields, replace
from functools import cache
from itertools import takewhile
from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import PlainSerializer, TypeAdapter, ValidationError

from app.input_errors import given, input_errors
from core import recipe
from core.amplitude import Suggestion, suggest_amplitude
from core.channels import BEYOND_FLIGHT, CHANNELS
from core.monitor.group import Pooled
from core.monitor.recipe import METHODS, MonitorRecipe
from core.planned_test import DatasetRecipe
from core.recipe import RecipeError, family_of, to_plain
from core.simulation.aircraft import AIRCRAFT, MatrixAircraft
from core.specification import Limits

__all__ = [
    "AS_FLOWN",
    "AUTO",
    "USUAL_DATASET",
    "USUAL_MONITOR",
    "Imperfect",
    "RecipeError",
    "SentRecipe",
    "as_ordered",
    "dataset_recipe",
    "family_of",
    "from_plain",
    "limits_named",
    "matrices_renamed",
    "monitor_as_ordered",
    "overlay",
    "read_plain",
    "set_path",
    "stored_names",
    "to_plain",
]

DEFAULT_KIND: str = to_plain(DatasetRecipe())["aircraft"]["kind"]
BEFORE_IMPERFECTIONS = {entry.name for entry in fields(DatasetRecipe)} - {"imperfections"}
BEFORE_GUARANTEE = set(
    takewhile("guarantee".__ne__, (entry.name for entry in fields(MonitorRecipe)))
)
MATRICES = {"A": "a", "B": "b", "C": "c", "D": "d"}
"""Matrices of a model or a law as they are printed, and their parameters."""


def _changes(before: dict[str, Any], after: dict[str, Any]) -> dict[str, Any]:
    """What nested objects of the same keys say otherwise."""
    return {
        key: _changes(before[key], value) if isinstance(value, dict) else value
        for key, value in after.items()
        if value != before[key]
    }


AS_FLOWN: dict[str, Any] = _changes(to_plain(DatasetRecipe()), to_plain(DatasetRecipe().as_flown()))
"""Noise, jitter and imperfections as they are usual in flight: those parts of a recipe."""
Imperfect = Literal["usual", "none"]
"""Whether rollouts have gust, instrument errors, noise and pilot's scatter as usual in flight."""
USUAL_DATASET = DatasetRecipe(n_unsafe=500).as_flown()
"""What an order of a dataset means that says nothing."""
USUAL_MONITOR = MonitorRecipe(guarantee="95%")
"""What an order of a monitor means that says nothing."""
AUTO = "auto"
"""What an amplitude may say for the one that a pilot run suggests."""


LIMITS, STORED_LIMITS = "limits", "specification"
"""What people, requests and responses call the limits of a recipe, and what stored recipes do."""


def limits_named(plain: Any) -> Any:
    """A recipe as it is sent: its limits, and those of its parts, are called `limits`."""
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
    """A recipe by the names that are stored: `limits` is an alias of `specification`.

    RecipeError where a part has both.
    """
    if not isinstance(plain, dict):
        return plain
    if plain.keys() >= {LIMITS, STORED_LIMITS}:
        raise RecipeError(
            f"{where} gives {LIMITS} and {STORED_LIMITS}, two names of the same: leave one out"
        )
    return {
        STORED_LIMITS if key == LIMITS else key: stored_names(value, f"{where}.{key}")
        for key, value in plain.items()
    }


def from_plain(default: Any, plain: Any, where: str = "recipe") -> Any:
    """Return `default` with what `plain` says put in place, every value of the type it must have.

    RecipeError says which part is wrong and what would be right.
    """
    try:
        return recipe.from_plain(default, stored_names(plain, where), where, _checked)
    except RecipeError as error:
        raise RecipeError(str(error).replace(STORED_LIMITS, LIMITS)) from error


@cache
def _adapter(kind: type[Any]) -> TypeAdapter[Any]:
    """Made once: it takes milliseconds."""
    return TypeAdapter(kind)


def _checked(default: Any, values: Mapping[str, Any], where: str) -> Any:
    for key, value in values.items():
        if type(getattr(default, key, None)) in (int, float) and isinstance(value, str | bool):
            raise RecipeError(f"{where}.{key} is {given(value)}: give a number")
    try:
        return _adapter(type(default)).validate_python(values)
    except ValidationError as error:
        place, reason = input_errors(error.errors(), values)[0]
        if not place:  # the parameters do not go together
            raise RecipeError(f"{where}: {reason.partition(': ')[2]}") from error
        raise RecipeError(f"{where}.{place} {reason}") from error


def dataset_recipe(plain: Any, where: str = "dataset") -> tuple[DatasetRecipe, Suggestion | None]:
    """Read a dataset's recipe; where it says no law, doublet or limit, the aircraft's usual test.

    An `amplitude_deg` of "auto", and that of an own model where none is said, is the one that a
    pilot run suggests, which is returned too. RecipeError; AmplitudeError where there is none.
    """
    if not isinstance(plain, dict):
        return from_plain(DatasetRecipe(), plain, where), None
    plain = matrices_renamed(stored_names(plain, where), where)
    maneuver = plain.get("maneuver", {})
    is_said = isinstance(maneuver, dict) and not maneuver.keys().isdisjoint(
        {"amplitude_deg", "t_s"}
    )
    is_auto = is_said and maneuver.get("amplitude_deg") == AUTO
    if is_auto:
        rest = {key: value for key, value in maneuver.items() if key != "amplitude_deg"}
        plain = plain | {"maneuver": rest}
    read = from_plain(DatasetRecipe(), _with_usual_test(plain), where)
    _check_limits(read.specification, f"{where}.{LIMITS}")
    if not is_auto and (is_said or not _is_own_model(plain)):
        return read, None
    suggestion = suggest_amplitude(read)
    return replace(read, maneuver=read.maneuver.with_peak(suggestion.amplitude_deg)), suggestion


def as_ordered(plain: Any, unsaid: Imperfect = "usual", asked: Imperfect | None = None) -> Any:
    """A dataset's recipe as it is ordered by option or request, with what it leaves unsaid of
    noise, jitter and imperfections; and, where these are usual, with the usual number of failures.

    asked: what to fill in, which its `imperfections` may say by a word too.   unsaid: what to fill
    in where neither does, but for a recipe that is whole: as versions without imperfections stored
    it, it means none.
    """
    plain = stored_names(plain)
    if isinstance(plain, dict) and plain.get("imperfections") in get_args(Imperfect):
        asked = plain["imperfections"]
        plain = {key: value for key, value in plain.items() if key != "imperfections"}
    is_whole = isinstance(plain, dict) and plain.keys() >= BEFORE_IMPERFECTIONS
    if unsaid == "usual" and isinstance(plain, dict):
        plain = {"n_unsafe": USUAL_DATASET.n_unsafe} | plain
    if (asked or ("none" if is_whole else unsaid)) == "none":
        return plain
    return overlay(deepcopy(AS_FLOWN), plain)


def dataset_for(monitor: MonitorRecipe, dataset: DatasetRecipe) -> DatasetRecipe:
    """The dataset to simulate for a monitor: one by groups gets as many failures of each."""
    return (
        replace(dataset, groups=monitor.groups) if isinstance(dataset.groups, Pooled) else dataset
    )


def monitor_as_ordered(plain: Any) -> Any:
    """A monitor's recipe as it is ordered by option or request, with the usual guarantee.

    A predictor given alone has the score that goes with it, a score the predictor. A recipe that is
    whole, as versions without guarantees stored it, means what it says.
    """
    if not isinstance(plain, dict) or plain.keys() >= BEFORE_GUARANTEE:
        return plain
    return {"guarantee": USUAL_MONITOR.guarantee} | _method(plain) | plain


def _method(plain: dict[str, Any]) -> dict[str, Any]:
    """Predictor and score of the first method that has the one of them that is said."""
    said = {part: plain[part] for part in ("predictor", "score") if part in plain}
    for predictor, score in METHODS.values() if len(said) == 1 else ():
        method = {"predictor": to_plain(predictor), "score": to_plain(score)}
        if all(isinstance(m, dict) and m.get("kind") == method[p]["kind"] for p, m in said.items()):
            return method
    return {}


def matrices_renamed(plain: dict[str, Any], where: str = "dataset") -> dict[str, Any]:
    """A dataset's recipe with the matrices of aircraft and law by their parameters' names.

    An aircraft of matrices need not say its kind, nor names of its states, as in a model's file:
    those of the catalog's example are not its own. RecipeError where a matrix
    is given in capitals and in small letters.
    """
    named = {}
    for part in {"aircraft", "control_law"} & plain.keys():
        given = plain[part]
        if not isinstance(given, dict):
            continue
        if twice := [name for name, key in MATRICES.items() if {name, key} <= given.keys()]:
            raise RecipeError(f"{where}.{part} gives the matrix {twice[0]} twice: leave one out")
        named[part] = {MATRICES.get(key, key): value for key, value in given.items()}
        if part == "aircraft" and "a" in named[part]:
            named[part] = {"kind": "matrices", "states": []} | named[part]
    return plain | named


def _check_limits(limits: Limits, where: str) -> None:
    """RecipeError for a limit that no flight comes near, as of degrees given as radians."""
    for channel in CHANNELS:
        limit = getattr(limits, channel.key)
        if limit is None or limit <= BEYOND_FLIGHT.get(channel.unit, inf):
            continue
        meant = f"{limit:g}{channel.display_unit}"
        raise RecipeError(
            f"{where}.{channel.key} is {limit:g} {channel.unit}, which is "
            f"{channel.read(limit)} and no flight comes near it: if {meant} was meant, give "
            f"{limit / channel.display_factor:.4g} {channel.unit}, or on the command line "
            f"--limit {channel.key}={meant}"
        )


def _is_own_model(plain: dict[str, Any]) -> bool:
    """Whether matrices are given, of which no usual amplitude is known."""
    aircraft = plain.get("aircraft")
    return isinstance(aircraft, MatrixAircraft) or (isinstance(aircraft, dict) and "a" in aircraft)


def _with_usual_test(plain: dict[str, Any]) -> dict[str, Any]:
    """Add to a dataset's recipe what the usual test of its aircraft says, where it says nothing."""
    aircraft = plain.get("aircraft", {"kind": DEFAULT_KIND})
    kind = aircraft.get("kind", DEFAULT_KIND) if isinstance(aircraft, dict) else None
    if not (isinstance(kind, str) and kind in AIRCRAFT):
        return plain
    usual = DatasetRecipe.usual(AIRCRAFT[kind])
    filled = {"specification": usual.specification} | plain
    for part in ("control_law", "maneuver"):
        own, given = to_plain(getattr(usual, part)), plain.get(part, {})
        if isinstance(given, dict) and given.get("kind", own["kind"]) == own["kind"]:
            filled[part] = own | given
    return filled


def overlay(below: Any, above: Any) -> Any:
    """Nested objects of plain data, what `above` says in place of what `below` does."""
    if not (isinstance(below, dict) and isinstance(above, dict)):
        return above
    return below | {key: overlay(below.get(key), value) for key, value in above.items()}


def read_plain(path: Path) -> Any:
    """Read a JSON file; RecipeError says where it is not JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise RecipeError(f"{path} cannot be read ({error.strerror}): give a JSON file") from error
    except ValueError as error:
        raise RecipeError(f"{path} is not JSON ({error}): correct it there") from error


def set_path(plain: dict[str, Any], dotted: str, value: Any) -> None:
    """Put a value at `a.b.c` of nested objects, making them where they are missing."""
    *parents, last = dotted.split(".")
    for parent in parents:
        plain = plain.setdefault(parent, {})
        if not isinstance(plain, dict):
            raise RecipeError(f"{dotted} cannot be set: {parent} holds a value, not parameters")
    plain[last] = value
