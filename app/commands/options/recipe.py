"""Options that make a recipe, over the defaults and a recipe file."""

import argparse
import csv
import json
import sys
from collections.abc import Sequence
from dataclasses import fields
from math import ceil, inf
from pathlib import Path
from typing import Any, get_args

import numpy as np

from app.commands.options.fields import help_of, settings_of
from app.commands.options.option import option
from app.recipes.labels import FAMILIES, descriptions
from app.recipes.recipes import (
    AUTO,
    LIMITS,
    STORED_LIMITS,
    USUAL_DATASET,
    USUAL_MONITOR,
    Imperfect,
    RecipeError,
    as_ordered,
    dataset_recipe,
    default_test,
    limits_named,
    matrices_renamed,
    monitor_as_ordered,
    read_plain,
    set_path,
    to_plain,
)
from app.telemetry.limit_texts import VALUE, extended, margin_bounds
from core.channels import BY_KEY, KEYS
from core.evaluation.study import StudyRecipe
from core.limits.flight_limits import ALL_CHANNELS, LoadLimits
from core.monitor import MonitorRecipe
from core.planned_test.nonlinear_test import SixDofTest
from core.planned_test.planned_test import DatasetRecipe
from core.recipe import family_of, instead_of
from core.simulation.aircraft import AIRCRAFT, MatrixAircraft
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.imperfections import Imperfections
from core.simulation.jsbsim import JSBSIM_AIRCRAFT
from core.simulation.maneuver import MANEUVERS
from core.simulation.nonlinear_aircraft import NONLINEAR_AIRCRAFT
from core.simulation.pilot import PILOTS, Crossover

SIX_DOF_AIRCRAFT = NONLINEAR_AIRCRAFT | JSBSIM_AIRCRAFT
MOST_DELAY = 10
"""Most past outputs in an observation, however short the interval."""
IMPERFECTIONS = "dataset.imperfections"
NAMES = tuple(field.name for field in fields(Imperfections))
PILOT_NAMES = tuple(field.name for field in fields(Crossover))
ANGULAR = tuple(key for key in KEYS if key != "Ny")


def number_or_auto(text: str) -> float | str:
    return text if text == AUTO else float(text)


PATHS = {
    "states": "dataset.aircraft.n_states",
    "amplitude": "dataset.maneuver.amplitude_deg",
    "duration": "dataset.maneuver.duration_s",
    "dt": "dataset.dt",
    "substeps": "dataset.substeps",
    "n-unsafe": "dataset.n_unsafe",
    "n-obs": "dataset.n_obs",
    "max-rollouts": "dataset.max_rollouts",
    "seed": "dataset.seed",
    "t-early": "monitor.t_early",
    "n-delay": "monitor.n_delay",
    "calibration": "monitor.calibration",
    "p-value": "monitor.p_value",
    "scaling": "monitor.scaling",
    "epsilon": "monitor.epsilon",
    "guarantee": "monitor.guarantee",
    "groups": "monitor.groups.kind",
}
"""Options, and the fields of the recipe that they set."""
METHOD = {"predictor": "monitor.predictor.kind", "score": "monitor.score.kind"}
USUALLY = {
    "amplitude": "auto: set by a pilot run so that a quarter of flights exceed a limit",
    "dt": "adjusts the parameters that depend on it",
    "n-unsafe": f"{USUAL_DATASET.n_unsafe} if absent in train",
    "guarantee": f"{USUAL_MONITOR.guarantee.replace('%', '%%')} if absent in train",
}
"""Text that the help adds to the description of a field."""
# part of a dataset's recipe: kind whose defaults are an example, required field, what to do
EXAMPLES: dict[str, tuple[str, str, str]] = {
    "aircraft": ("matrices", "a", "give --aircraft FILE.json with your matrices"),
    "maneuver": ("table", "t_s", "give --maneuver FILE.csv with your commands"),
    "control_law": ("state_space", "d", "give its inputs, outputs, a, b, c, d in a --recipe file"),
}


def add_recipe_options(
    parser: argparse.ArgumentParser,
    *counts: str,
    of: type = StudyRecipe,
    method: bool = False,
    imperfections: Imperfect = "usual",
) -> None:
    """counts: fields of `of` besides its dataset and monitor.   method: also choose its parts.

    imperfections: the default. With "usual", the number of failures and the guarantee have their
    usual defaults too.
    """
    group = parser.add_argument_group("recipe")
    option(group, "--recipe FILE", "recipe as JSON; other options change it", type=Path)
    option(
        group,
        "--aircraft NAME|FILE",
        f"{', '.join((*AIRCRAFT, *SIX_DOF_AIRCRAFT))}, or a JSON file of matrices; also sets "
        "the aircraft's control law, doublet and limit",
    )
    option(group, "--control-law NAME", ", ".join(CONTROL_LAWS))
    group.add_argument(
        "--maneuver",
        "--manoeuvre",
        metavar="NAME|FILE",
        help=f"{', '.join(MANEUVERS)}, or a CSV table",
    )
    option(
        group,
        "--pilot NAME",
        f"{', '.join(PILOTS)}: who flies it; by default crossover for captures. Set parameters "
        f"with --set dataset.pilot.NAME=VALUE; names: {', '.join(PILOT_NAMES)}",
        choices=tuple(PILOTS),
    )
    option(
        group,
        "--limit CHANNEL=VALUE",
        "limit, such as Ny=0.5g or beta=7deg, instead of the default; train also takes a stability "
        "margin of the aircraft, 'phase margin > 30 deg', which only labels rollouts",
        action="append",
    )
    option(
        group, "--noise CHANNEL=SIGMA", "sensor noise, 1 sigma, such as p=0.2deg/s", action="append"
    )
    option(
        group,
        "--imperfections",
        "gusts, instrument errors, noise and pilot scatter: as usual in flight, or none; "
        f"{imperfections} if absent, none if a complete --recipe has none. Set single ones with "
        f"--set {IMPERFECTIONS}.NAME=VALUE; names: {', '.join(NAMES)}",
        choices=get_args(Imperfect),
    )
    parser.set_defaults(usual_imperfections=imperfections)
    paths = PATHS | (METHOD if method else {}) | {name.replace("_", "-"): name for name in counts}
    for name, path in paths.items():
        text, settings = _option(of(), path)
        text = f"{text}; {USUALLY[name]}" if name in USUALLY else text
        option(group, f"--{name}", text, dest=path if "." in path else f".{path}", **settings)
    option(group, "--set PATH=VALUE", "any parameter, such as dataset.n_obs=3", action="append")
    option(group, "--print-recipe", "print the complete recipe as JSON and stop")


def _option(recipe: Any, path: str) -> tuple[str, dict[str, Any]]:
    """Help of the option for a part of a recipe, and how to read it."""
    *parents, last = path.split(".")
    above = recipe
    for parent in parents:
        recipe, above = getattr(recipe, parent), recipe
    if last == "kind":
        family = family_of(recipe)
        assert family is not None
        text = descriptions(type(above)).get(
            parents[-1], f"{FAMILIES[family.name].lower()} of the monitor"
        )
        return text.rstrip("."), {"choices": tuple(family.members)}
    settings = settings_of(type(recipe), last)
    if last == "amplitude_deg":
        settings["type"] = number_or_auto
    return help_of(type(recipe), last), settings


def plain_recipe(options: argparse.Namespace) -> dict[str, Any]:
    """The recipe from the options and the recipe file: "dataset" is read, the rest plain data."""
    plain = read_plain(options.recipe) if options.recipe else {}
    if not isinstance(plain, dict):
        raise RecipeError(f"{options.recipe} is not a JSON object: begin it with {{")
    default: Imperfect = options.usual_imperfections
    if options.aircraft in SIX_DOF_AIRCRAFT:
        set_path(plain, "dataset.aircraft.kind", options.aircraft)
    plain["dataset"] = as_ordered(plain.get("dataset", {}), default, options.imperfections)
    for path, value in vars(options).items():
        if "." in path and value is not None:
            set_path(plain, path.removeprefix("."), value)
    if options.aircraft is not None and options.aircraft.endswith(".json"):
        model = MatrixAircraft.from_json(read_plain(Path(options.aircraft)))
        set_path(plain, "dataset.aircraft", to_plain(model))
    elif options.aircraft is not None:
        set_path(plain, "dataset.aircraft.kind", options.aircraft)
    test = default_test(plain["dataset"])
    if "n_states" in plain["dataset"].get("aircraft", {}) and isinstance(test, SixDofTest):
        raise RecipeError(
            f"--states was given with {plain['dataset']['aircraft']['kind']}, which flies in six "
            "degrees of freedom with all its states: omit it, or choose a linear aircraft"
        )
    if options.control_law is not None:
        set_path(plain, "dataset.control_law.kind", options.control_law)
    if options.maneuver is not None and options.maneuver.endswith(".csv"):
        for key, value in maneuver_table(Path(options.maneuver)).items():
            set_path(plain, f"dataset.maneuver.{key}", value)
    elif options.maneuver is not None:
        set_path(plain, "dataset.maneuver.kind", options.maneuver)
    if options.pilot is not None:
        set_path(plain, "dataset.pilot.kind", options.pilot)
    if bounds := margin_bounds(options.limit or ()):
        set_path(plain, "dataset.margins", bounds)
    elif options.limit and isinstance(default_test(plain["dataset"]), SixDofTest):
        set_path(plain, f"dataset.{STORED_LIMITS}", flight_limits(options.limit))
    elif options.limit:
        limits = dict.fromkeys(KEYS) | dict(map(channel_value, options.limit))
        set_path(plain, f"dataset.{STORED_LIMITS}", limits)
    for key, value in map(channel_value, options.noise or ()):
        set_path(plain, f"dataset.noise.{key}", value)
    for assignment in options.set or ():
        path, equals, value = assignment.partition("=")
        if not equals:
            raise RecipeError(f"--set {assignment!r}: write it as PATH=VALUE")
        stored = path.replace(f"dataset.{LIMITS}", f"dataset.{STORED_LIMITS}", 1)
        set_path(plain, stored, _value(value))
    if default == "usual":
        plain["monitor"] = monitor_as_ordered(plain.get("monitor", {}))
    if isinstance(plain.get("dataset"), dict):
        plain["dataset"] = matrices_renamed(plain["dataset"], "recipe.dataset")
    for part, (kind, field, remedy) in EXAMPLES.items():
        given = plain.get("dataset", {}).get(part, {})
        if isinstance(given, dict) and given.get("kind") == kind and field not in given:
            raise RecipeError(f"{part} {kind!r} is only an example: {remedy}")
    interval = getattr(options, "dataset.dt")
    adjusted = adjust_to_interval(plain, interval) if interval is not None else []
    plain["dataset"], suggestion = dataset_recipe(plain.get("dataset", {}), "recipe.dataset")
    if adjusted:
        print(f"forewarn: for --dt {interval:g}: {', '.join(adjusted)}", file=sys.stderr)
    if suggestion:
        print(f"forewarn: {suggestion}", file=sys.stderr)
    return plain


def monitor_options(options: argparse.Namespace) -> dict[str, Any]:
    """The plain monitor recipe from the options and the recipe file."""
    plain = read_plain(options.recipe) if options.recipe else {}
    for path, value in vars(options).items():
        if path.startswith("monitor.") and value is not None:
            set_path(plain, path, value)
    return plain.get("monitor", {})


def print_recipe(recipe: Any) -> int:
    print(json.dumps(limits_named(to_plain(recipe)), indent=2))
    return 0


def maneuver_table(path: Path) -> dict[str, Any]:
    """Read a manoeuvre with columns t_s, delta_a_deg, delta_r_deg; a missing surface stays at 0."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except (OSError, UnicodeDecodeError) as error:
        raise RecipeError(f"{path} cannot be read ({error}): give a CSV table") from error
    surfaces = ("delta_a_deg", "delta_r_deg")
    columns = set(rows[0]) if rows else set()
    if "t_s" not in columns or not columns.intersection(surfaces) or columns - {"t_s", *surfaces}:
        raise RecipeError(
            f"{path} has the columns {', '.join(map(str, columns)) or 'none'}: a manoeuvre needs "
            "rows with t_s and delta_a_deg or delta_r_deg"
        )
    try:
        table = {
            key: [float(row.get(key) or ("x" if key in columns else 0)) for row in rows]
            for key in ("t_s", *surfaces)
        }
    except ValueError:
        raise RecipeError(f"{path} has a cell without a number: give only numbers") from None
    return {"kind": "table", **table}


def channel_value(assignment: str) -> tuple[str, float]:
    """(channel key, value in SI) of `Ny=0.5`, `beta=7deg`, `p=20deg/s` or `beta_deg=8`."""
    name, _, text = assignment.partition("=")
    key = name.removesuffix("_deg")
    if key not in KEYS or (name != key and key not in ANGULAR):
        raise RecipeError(f"{assignment!r}: unknown channel {name!r}: {instead_of(name, KEYS)}")
    match = VALUE.fullmatch(text.strip())
    if match is None:
        raise RecipeError(
            f"{assignment!r}: write it as CHANNEL=NUMBER, such as Ny=0.5 or beta=7deg"
        )
    number, unit = float(match[1]), match[2]
    if name != key and not unit:
        return key, float(np.radians(number))
    channel = BY_KEY[key]
    factors = {"": 1.0, channel.unit: 1.0, channel.display_unit: 1.0 / channel.display_factor}
    factors[channel.display_unit.replace("deg", "°")] = 1.0 / channel.display_factor
    if unit not in factors or (name != key and unit):
        units = " or ".join(dict.fromkeys((channel.display_unit, channel.unit)))
        raise RecipeError(
            f"{assignment!r}: {name} was given in {unit!r}, but {channel.label} is in {units}: "
            f"write {key}={match[1]}{channel.display_unit} if that is meant"
        )
    return key, number * factors[unit]


def flight_limits(texts: Sequence[str]) -> dict[str, float | None]:
    """Parameters of `Nz=-1..4.9g`, `alpha=..15deg` or `fin_load=50kN`. RecipeError."""
    try:
        _, ends, requirements = extended(ALL_CHANNELS, (), texts)
        if requirements:
            raise ValueError("a nonlinear aircraft is limited by channel: write it as Nz=LOW..HIGH")
        if not ends.keys() <= set(ALL_CHANNELS.keys):
            raise ValueError(
                f"{', '.join(texts)} was given, and limits with a time and requirements need "
                "--rollouts or --simulator: limit a nonlinear aircraft as Nz=LOW..HIGH"
            )
        return LoadLimits.given(ends)
    except ValueError as error:
        raise RecipeError(str(error)) from None


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def adjust_to_interval(plain: dict[str, Any], dt: float) -> list[str]:
    """Adjust the parameters that the recipe does not give, in place; list the adjustments.

    Afterwards the duration is a whole number of steps, limits are checked at least as often, there
    are no more observations than samples, and past outputs cover the same time.
    """
    usual, past = DatasetRecipe(), MonitorRecipe().n_delay
    dataset, monitor = plain.setdefault("dataset", {}), plain.setdefault("monitor", {})
    maneuver = dataset.get("maneuver", {}) if isinstance(dataset, dict) else {}
    if not (isinstance(maneuver, dict) and isinstance(monitor, dict) and 0.0 < dt < inf):
        return []  # reading the recipe reports the error
    kind = MANEUVERS.get(maneuver.get("kind", ""), usual.maneuver)
    duration = maneuver.get("duration_s", kind.duration_s)
    steps = ceil(duration / dt - 1e-6) if isinstance(duration, int | float) else 0
    whole = round(steps * dt, 9)
    substeps = ceil(dt / usual.dt - 1e-6)
    n_obs = min(usual.n_obs, steps + 1)
    n_delay = min(MOST_DELAY, max(1, round(past * usual.dt / dt)))
    adjusted = (
        ("dataset.maneuver.duration_s", duration, whole, f"a duration of {whole:g} s"),
        ("dataset.substeps", usual.substeps, substeps, f"{substeps} limit checks an interval"),
        ("dataset.n_obs", usual.n_obs, n_obs, f"{n_obs} observations of each safe rollout"),
        ("monitor.n_delay", past, n_delay, f"{n_delay} past outputs in an observation"),
    )
    adjustments = []
    for path, before, value, text in adjusted:
        if value != before and not _is_given(plain, path):
            set_path(plain, path, value)
            adjustments.append(text)
    return adjustments


def _is_given(plain: dict[str, Any], path: str) -> bool:
    *parents, last = path.split(".")
    for parent in parents:
        plain = plain.get(parent, {})
    return last in plain
