"""Options that make a recipe, over the defaults and a recipe file."""

import argparse
import csv
import json
import re
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args

import numpy as np

from app.commands.options.sample_interval import adjust_to_interval
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
    limits_named,
    matrices_renamed,
    monitor_as_ordered,
    read_plain,
    set_path,
    to_plain,
)
from core.channels import BY_KEY, KEYS
from core.monitor.calibration import Guarantee
from core.monitor.group import GROUPINGS
from core.monitor.predictor import PREDICTORS
from core.monitor.score import SCORES
from core.recipe import instead_of
from core.simulation.aircraft import AIRCRAFT, MatrixAircraft
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.imperfections import Imperfections
from core.simulation.maneuver import MANEUVERS

IMPERFECTIONS = "dataset.imperfections"
NAMES = tuple(field.name for field in fields(Imperfections))
ANGULAR = tuple(key for key in KEYS if key != "Ny")


def number_or_auto(text: str) -> float | str:
    return text if text == AUTO else float(text)


# option, path in the recipe, type, choices, help
SHARED: tuple[tuple[str, str, Any, Any, str], ...] = (
    ("--states", "dataset.aircraft.n_states", int, (3, 4), "states of a published aircraft"),
    (
        "--amplitude",
        "dataset.maneuver.amplitude_deg",
        number_or_auto,
        None,
        "manoeuvre's amplitude [deg]; auto: set by a pilot run so that a quarter of flights exceed "
        "a limit",
    ),
    ("--duration", "dataset.maneuver.duration_s", float, None, "length of a rollout [s]"),
    (
        "--dt",
        "dataset.dt",
        float,
        None,
        "sample interval [s]; adjusts the parameters that depend on it",
    ),
    ("--substeps", "dataset.substeps", int, None, "limit checks in each sample interval"),
    (
        "--n-unsafe",
        "dataset.n_unsafe",
        int,
        None,
        f"unsafe rollouts to collect; {USUAL_DATASET.n_unsafe} if absent in train",
    ),
    ("--n-obs", "dataset.n_obs", int, None, "observations kept of each safe rollout"),
    ("--max-rollouts", "dataset.max_rollouts", int, None, "most rollouts to simulate"),
    ("--seed", "dataset.seed", int, None, "seed of every random draw"),
    ("--t-early", "monitor.t_early", float, None, "required warning lead time [s]"),
    ("--n-delay", "monitor.n_delay", int, None, "past outputs in an observation"),
    (
        "--calibration",
        "monitor.calibration",
        str,
        ("trajectory", "pointwise"),
        "calibrate whole trajectories or single samples",
    ),
    ("--p-value", "monitor.p_value", str, ("simple", "exact"), "formula of the p-value"),
    (
        "--scaling",
        "monitor.scaling",
        str,
        ("safe_std", "raw"),
        "scale distances by the spread of safe rollouts, or not",
    ),
    ("--epsilon", "monitor.epsilon", float, None, "accepted miss rate"),
    (
        "--guarantee",
        "monitor.guarantee",
        str,
        get_args(Guarantee),
        f"promise on the miss rate; {USUAL_MONITOR.guarantee.replace('%', '%%')} if absent in "
        "train",
    ),
    (
        "--groups",
        "monitor.groups.kind",
        str,
        tuple(GROUPINGS),
        "give the promise for each of these groups of failures",
    ),
)
VALUE = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z°/]*)")
"""A number and an optional unit."""
# part of a dataset's recipe: kind whose defaults are an example, required field, what to do
EXAMPLES: dict[str, tuple[str, str, str]] = {
    "aircraft": ("matrices", "a", "give --aircraft FILE.json with your matrices"),
    "maneuver": ("table", "t_s", "give --maneuver FILE.csv with your commands"),
    "control_law": ("state_space", "d", "give its inputs, outputs, a, b, c, d in a --recipe file"),
}
METHOD: tuple[tuple[str, str, Any, Any, str], ...] = (
    ("--predictor", "monitor.predictor.kind", str, tuple(PREDICTORS), "predictor of the outputs"),
    ("--score", "monitor.score.kind", str, tuple(SCORES), "score of a prediction"),
)


def add_recipe_options(
    parser: argparse.ArgumentParser, *, method: bool, imperfections: Imperfect
) -> None:
    """method: add the choice of predictor and score.

    imperfections: the default. With "usual", the number of failures and the guarantee have their
    usual defaults too.
    """
    group = parser.add_argument_group("recipe")
    group.add_argument(
        "--recipe", type=Path, metavar="FILE", help="recipe as JSON; other options change it"
    )
    group.add_argument(
        "--aircraft",
        metavar="NAME|FILE",
        help=f"{', '.join(AIRCRAFT)}, or a JSON file of matrices; also sets the aircraft's control "
        "law, doublet and limit",
    )
    group.add_argument("--control-law", metavar="NAME", help=", ".join(CONTROL_LAWS))
    group.add_argument(
        "--maneuver",
        "--manoeuvre",
        metavar="NAME|FILE",
        help=f"{', '.join(MANEUVERS)}, or a CSV table",
    )
    group.add_argument(
        "--limit",
        action="append",
        metavar="CHANNEL=VALUE",
        help="limit of a channel, such as Ny=0.5g or beta=7deg; replaces the default limits",
    )
    group.add_argument(
        "--noise",
        action="append",
        metavar="CHANNEL=SIGMA",
        help="sensor noise, 1 sigma, such as Ny=0.005g or p=0.2deg/s",
    )
    group.add_argument(
        "--imperfections",
        choices=get_args(Imperfect),
        help="gusts, instrument errors, noise and pilot scatter: as usual in flight, or none; "
        f"{imperfections} if absent, none if a complete --recipe has none. Set single ones with "
        f"--set {IMPERFECTIONS}.NAME=VALUE; names: {', '.join(NAMES)}",
    )
    parser.set_defaults(usual_imperfections=imperfections)
    for option, path, kind, choices, text in SHARED + (METHOD if method else ()):
        name = None if choices else "NUMBER"
        group.add_argument(option, dest=path, type=kind, choices=choices, metavar=name, help=text)
    group.add_argument(
        "--set",
        action="append",
        metavar="PATH=VALUE",
        help="any other parameter, such as dataset.maneuver.timing_jitter_s=0.1",
    )
    group.add_argument(
        "--print-recipe", action="store_true", help="print the complete recipe as JSON and stop"
    )


def add_number(parser: argparse.ArgumentParser, option: str, text: str) -> None:
    """Add a number outside the recipe's dataset and monitor: --n-test sets n_test."""
    name = option.removeprefix("--").replace("-", "_")
    parser.add_argument(option, type=int, dest=f".{name}", metavar="NUMBER", help=text)


def plain_recipe(options: argparse.Namespace) -> dict[str, Any]:
    """The recipe from the options and the recipe file: "dataset" is read, the rest plain data."""
    plain = read_plain(options.recipe) if options.recipe else {}
    if not isinstance(plain, dict):
        raise RecipeError(f"{options.recipe} is not a JSON object: begin it with {{")
    unsaid: Imperfect = options.usual_imperfections
    plain["dataset"] = as_ordered(plain.get("dataset", {}), unsaid, options.imperfections)
    for path, value in vars(options).items():
        if "." in path and value is not None:
            set_path(plain, path.removeprefix("."), value)
    if options.aircraft is not None and options.aircraft.endswith(".json"):
        model = MatrixAircraft.from_json(read_plain(Path(options.aircraft)))
        set_path(plain, "dataset.aircraft", to_plain(model))
    elif options.aircraft is not None:
        set_path(plain, "dataset.aircraft.kind", options.aircraft)
    if options.control_law is not None:
        set_path(plain, "dataset.control_law.kind", options.control_law)
    if options.maneuver is not None and options.maneuver.endswith(".csv"):
        for key, value in maneuver_table(Path(options.maneuver)).items():
            set_path(plain, f"dataset.maneuver.{key}", value)
    elif options.maneuver is not None:
        set_path(plain, "dataset.maneuver.kind", options.maneuver)
    if options.limit:
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
    if unsaid == "usual":
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


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text
