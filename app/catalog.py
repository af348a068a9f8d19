"""The catalog: all families with their members, JSON schemas of parameters, and defaults.

The page's forms and the OpenAPI document's recipe schemas come from it.
"""

from copy import deepcopy
from dataclasses import asdict, fields, is_dataclass
from functools import cache
from importlib.util import find_spec
from inspect import cleandoc
from types import GenericAlias
from typing import Any, get_args

from pydantic import TypeAdapter

from app.jobs.requests import (
    LARGEST_N_MONITORS,
    LARGEST_N_TEST,
    MOST_MEMBERS,
    N_TEST,
    CombinationRecipe,
)
from app.jobs.training import SHARES
from app.recipes import labels
from app.recipes.labels import choice_label, descriptions, kind_label, title_of, unit_of
from app.recipes.recipes import (
    LIMITS,
    STORED_LIMITS,
    TESTS,
    USUAL_DATASET,
    USUAL_MONITOR,
    USUAL_TESTS,
    Imperfect,
    limits_named,
    model_of,
)
from app.recipes.recipes import to_plain as stored_plain
from app.telemetry.formats import FORMATS, LIBRARIES
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.targets import KNOWN
from app.telemetry.units import choices
from core import __version__
from core.bounds import bounds_of
from core.channels import CHANNELS, known_channels
from core.clearance.clearance import ClearanceRecipe
from core.conditions import CONDITIONS
from core.evaluation.baselines import Baseline
from core.evaluation.epsilon_choice import ChoiceRecipe
from core.evaluation.lead_sweep import COMPARED, SweepRecipe
from core.evaluation.study import StudyRecipe
from core.flight_events import FLIGHT_MARKERS
from core.limits.limits import SPECIFICATIONS, Limits
from core.monitor import MonitorRecipe
from core.monitor.recipe import METHODS
from core.planned_test.amplitude import WANTED_SHARE
from core.planned_test.collection import DatasetRecipe
from core.planned_test.nonlinear_test import JsbsimTest, NonlinearTest
from core.planned_test.planned_test import ManeuverTest
from core.recipe import FAMILIES, Family, family_of
from core.simulation.aircraft import Aircraft
from core.simulation.jsbsim import (
    JsbsimAircraft,
    aircraft_names,
    is_installed,
    known_trim,
    usual_condition,
)
from core.simulation.maneuver import Maneuver
from core.simulation.pilot import usual_pilot

RECIPES: dict[str, Any] = {
    **TESTS,
    "monitor": MonitorRecipe(),
    "study": StudyRecipe(),
    "combination": CombinationRecipe(),
    "sweep": SweepRecipe(),
    "clearance": ClearanceRecipe(),
    "epsilon": ChoiceRecipe(most_missed=0.1, most_false_alarms=0.2),
}

USUAL: dict[str, Any] = {
    **USUAL_TESTS,
    "monitor": USUAL_MONITOR,
}
"""Recipes of an empty request, where they differ from the default."""


@cache
def catalog() -> dict[str, Any]:
    known = FAMILIES | {LIMITS: Family(LIMITS, Limits, SPECIFICATIONS)}
    families = {
        name: {
            "label": label,
            "description": first_line(known[name].base),
            "entries": {kind: _entry(kind, member) for kind, member in known[name].members.items()},
        }
        for name, label in labels.FAMILIES.items()
    }
    return {
        "version": __version__,
        "channels": [asdict(channel) for channel in CHANNELS],
        "known_channels": [asdict(channel) for channel in known_channels().values()],
        "conditions": [asdict(channel) for channel in CONDITIONS.values()],
        "families": families,
        "recipes": {name: _recipe(name, recipe) for name, recipe in RECIPES.items()},
        "methods": [
            {
                "kind": kind,
                "label": labels.METHODS[kind],
                "predictor": to_plain(predictor),
                "score": to_plain(score),
            }
            for kind, (predictor, score) in METHODS.items()
        ],
        "tried": labels.TRIED,
        "sweep_methods": {name: _method_words(method) for name, method in COMPARED.items()},
        "calibrating_share": SHARES[0],
        "flight_markers": [asdict(kind) for kind in FLIGHT_MARKERS.values()],
        "telemetry": _telemetry(),
    }


def _recipe(name: str, recipe: Any) -> dict[str, Any]:
    is_test = isinstance(recipe, ManeuverTest)
    return {
        "schema": schema_of(recipe),
        "default": to_plain(recipe),
        "as_flown": to_plain(recipe.as_trained()) if is_test else None,
        "usual": to_plain(USUAL[name]) if name in USUAL else None,
        "needs": "forewarn[jsbsim]" if name == "jsbsim" and not is_installed() else "",
        "conditions": _conditions() if name == "jsbsim" and is_installed() else {},
    }


def _conditions() -> dict[str, dict[str, float]]:
    """What suits each aircraft of JSBSim, by its name."""
    usual = {name: usual_condition(name) for name in aircraft_names()}
    return {name: {"altitude_m": high, "mach": mach} for name, (high, mach) in usual.items()}


def to_plain(recipe: Any) -> Any:
    """A recipe with the names of the API."""
    return limits_named(stored_plain(recipe))


def _method_words(method: tuple[Any, Any] | Baseline) -> str:
    """The label of a sweep's method, or of its parts if it has none; a baseline's assumption."""
    if isinstance(method, Baseline):
        return f"no promise by itself; assumes that {method.assumption}"
    titles = (labels.METHODS[kind] for kind, pair in METHODS.items() if pair == method)
    parts = (to_plain(part)["kind"] for part in method)
    return next(titles, "") or ", ".join(map(kind_label, parts))


def _entry(kind: str, member: Any) -> dict[str, Any]:
    return {
        "kind": kind,
        "label": kind_label(kind),
        "description": getattr(member, "description", None) or first_line(type(member)),
        **(
            {"aircraft_class": member.condition.aircraft_class}
            if isinstance(member, Aircraft)
            else {}
        ),
        "schema": schema_of(member),
        "default": {key: value for key, value in to_plain(member).items() if key != "kind"},
        "usual_tests": _usual_tests(member),
    }


def _usual_tests(member: Any) -> dict[str, dict[str, Any]]:
    """What a linear aircraft, or a manoeuvre, brings to a test of each model of aircraft: parts of
    its recipe."""
    if isinstance(member, Aircraft):
        recipe = to_plain(DatasetRecipe.usual(member))
        return {"dataset": {part: recipe[part] for part in ("control_law", "maneuver", LIMITS)}}
    if not isinstance(member, Maneuver):
        return {}
    pilot = usual_pilot(member)
    tests: list[ManeuverTest] = [NonlinearTest(maneuver=member, pilot=pilot).with_usual()]
    if member.captured is None:
        tests.append(JsbsimTest(maneuver=member).with_usual())
    brought = {"dataset": {"pilot": to_plain(pilot)}}
    for test in tests:
        recipe = to_plain(test)
        parts = {part: recipe[part] for part in ("condition", LIMITS)}
        brought[model_of(recipe)] = parts | {"pilot": to_plain(pilot)}
    return brought


def _telemetry() -> dict[str, Any]:
    """Formats, targets with their units, units of time, and derivations, as plain data."""
    return {
        "formats": [
            {
                "key": file_format.key,
                "title": file_format.title,
                "endings": list(file_format.endings),
                "extra": file_format.extra or None,
                "installed": not file_format.extra
                or find_spec(LIBRARIES[file_format.extra]) is not None,
                "experimental": file_format.experimental,
            }
            for file_format in FORMATS.values()
        ],
        "targets": [asdict(target) | {"units": choices(target.unit)} for target in KNOWN.values()],
        "time_units": choices("s"),
        "derivations": [
            {"key": way.key, "target": way.target, "title": way.title, "needs": list(way.needs)}
            for way in DERIVATIONS.values()
        ],
    }


def schema_of(member: Any) -> dict[str, Any]:
    """JSON schema of the parameters of a recipe or a family member; `member` has the defaults.

    Every property has a title, a description, `x-unit` and a default; there is no `$ref`. A family
    property has `x-family` and takes a `kind` with its parameters; an `enum` has the labels of its
    values in `x-labels`.
    """
    kind, properties = type(member), {}
    known = _definitions()[kind.__name__].get("properties", {})
    described = descriptions(kind)
    fewer = member.fewer if isinstance(member, ManeuverTest) else {}
    for field in fields(member):
        if field.name in fewer and not list(fewer[field.name]):
            continue
        value, words = getattr(member, field.name), described.get(field.name, "")
        entry: dict[str, Any] = _property(known[field.name], value)
        for path, kept in fewer.items():
            if path.partition(".")[0] == field.name:
                name = path.partition(".")[2] or "kind"
                entry["properties"] |= {name: {"enum": list(kept)}}
        if isinstance(member, JsbsimAircraft) and field.name == "model" and is_installed():
            entry["enum"] = list(aircraft_names())
        if (bounds := bounds_of(kind).get(field.name)) is not None:
            entry |= bounds.as_schema
        name = LIMITS if field.name == STORED_LIMITS else field.name
        entry |= {"title": title_of(name, words), "default": to_plain(value)}
        entry["description"] = words or entry.get("description", "")
        if unit := unit_of(field.name, "" if isinstance(value, tuple) else words):
            entry["x-unit"] = unit
        if "enum" in entry:
            label_of = _jsbsim_label if isinstance(member, JsbsimAircraft) else choice_label
            entry["x-labels"] = [label_of(field.name, choice) for choice in entry["enum"]]
        properties[name] = entry
    return {
        "type": "object",
        "title": kind.__name__,
        "description": first_line(kind),
        "properties": properties,
        "additionalProperties": False,
    }


def _jsbsim_label(parameter: str, choice: str) -> str:
    unknown = parameter == "model" and known_trim(choice) is None
    return f"{choice} (no known trim)" if unknown else choice


@cache
def _definitions() -> dict[str, Any]:
    """JSON schema of every class in recipes, and of their bases."""
    members = [m for family in FAMILIES.values() for m in family.members.values()]
    classes = [c for m in (*members, *RECIPES.values()) for c in type(m).__mro__ if is_dataclass(c)]
    every: Any = GenericAlias(tuple, tuple(dict.fromkeys(classes)))
    return TypeAdapter(every).json_schema()["$defs"]


def first_line(kind: type) -> str:
    """First paragraph of a class's docstring, on one line."""
    return " ".join(cleandoc(kind.__doc__ or "").partition("\n\n")[0].split())


def _property(schema: dict[str, Any], value: Any) -> dict[str, Any]:
    family = family_of(value)
    if family is not None:
        return {
            "type": "object",
            "description": first_line(family.base),
            "x-family": family.name,
            "properties": {"kind": {"enum": list(family.members)}},
        }
    if is_dataclass(value):
        return schema_of(value)
    return dict(schema)


def _request(
    title: str, schema: dict[str, Any], *required: str, **properties: Any
) -> dict[str, Any]:
    """JSON schema of a request's body: a recipe, and its properties besides."""
    schema["properties"] |= properties
    return schema | {"title": title} | ({"required": [*required]} if required else {})


def dataset_request_schema() -> dict[str, Any]:
    return _request("Dataset to simulate", _ordered(USUAL_DATASET), name=_NAME)


def amplitude_request_schema() -> dict[str, Any]:
    schema = dataset_request_schema()
    return _request("Test to find an amplitude for", schema, share=_SHARE)


def monitor_request_schema() -> dict[str, Any]:
    more = {"name": _NAME, "dataset": _dataset_choice(USUAL_DATASET), "n_test": _N_TEST}
    return _request("Monitor to train", schema_of(USUAL_MONITOR), "dataset", **more)


def combination_request_schema() -> dict[str, Any]:
    members = {"type": "array", "items": {"type": "string"}, "uniqueItems": True}
    members |= {"minItems": 2, "maxItems": MOST_MEMBERS}
    members["description"] = "ids of trained monitors of one planned test"
    schema = schema_of(RECIPES["combination"])
    return _request("Monitors to combine", schema, "monitors", name=_NAME, monitors=members)


def study_request_schema() -> dict[str, Any]:
    schema = schema_of(RECIPES["study"])
    schema["properties"]["n_test"] |= {"minimum": 1, "maximum": LARGEST_N_TEST}
    schema["properties"]["n_monitors"] |= {"minimum": 1, "maximum": LARGEST_N_MONITORS}
    return _request("Study to run", schema, "dataset", dataset=_dataset_choice(DatasetRecipe()))


def sweep_request_schema() -> dict[str, Any]:
    schema = schema_of(RECIPES["sweep"])
    return _request("Leads to try", schema, dataset=_dataset_choice(USUAL_DATASET))


def choice_request_schema() -> dict[str, Any]:
    return _request("Epsilon to choose", schema_of(RECIPES["epsilon"]))


_NAME = {
    "title": "name",
    "description": "name for people; made from the recipe if absent",
    "anyOf": [{"type": "string", "minLength": 1, "maxLength": 200}, {"type": "null"}],
}


_N_TEST = {
    "title": "fresh flights of the evaluation",
    "description": "number of fresh flights for the evaluation; 0 for none",
    "type": "integer",
    "default": N_TEST,
    "minimum": 0,
    "maximum": LARGEST_N_TEST,
}
_SHARE = {
    "title": "wanted share",
    "description": "wanted share of rollouts that exceed a limit",
    "type": "number",
    "exclusiveMinimum": 0,
    "exclusiveMaximum": 1,
    "default": WANTED_SHARE,
}


def _ordered(recipe: DatasetRecipe) -> dict[str, Any]:
    """JSON schema of a dataset's recipe in a request; `recipe` has the defaults."""
    schema = schema_of(recipe)
    whole = schema["properties"]["imperfections"]
    words = {"enum": list(get_args(Imperfect)), "description": _IMPERFECT}
    choice = {"anyOf": [whole, words]} | {key: whole[key] for key in ("title", "description")}
    schema["properties"]["imperfections"] = choice
    return schema


_IMPERFECT = (
    "`usual`: noise, jitter and imperfections as usual in flight, except those given; `none`: only "
    "those given"
)


def _dataset_choice(recipe: DatasetRecipe) -> dict[str, Any]:
    return {
        "title": "dataset",
        "description": "id of a stored dataset, or the recipe of one to simulate",
        "anyOf": [{"type": "string", "minLength": 1}, deepcopy(_ordered(recipe))],
    }
