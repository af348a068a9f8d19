"""A simulator named on the command line: `package.module:name`, or a model's file."""

import argparse
import sys
from dataclasses import fields, replace
from importlib import import_module
from pathlib import Path
from typing import Any

from app.commands.options.fmu_simulator import fmu_simulator
from app.commands.options.jsbsim_simulator import PREFIX, jsbsim_simulator
from app.commands.options.recipe import PATHS
from app.commands.output.results import progress_bar
from app.recipes.recipes import RecipeError
from app.telemetry.limit_texts import specified
from app.telemetry.rollouts import RolloutFile
from core.monitor.training import check_lead
from core.planned_test.own import OwnSimulator, OwnTest
from core.recipe import instead_of
from core.simulation.python_simulator import OwnCodeError, running

PILOT_FLIGHTS = 100
"""Flights that show trim, and whether flights are reproducible and unlike each other."""
ITS_OWN = (
    *("aircraft", "control_law", "maneuver", "noise", "imperfections", "set", "print_recipe"),
    *("rollouts", "dictionary"),
)
"""Options for properties that a simulator already has."""


FMU = ".fmu"


def load(name: str, point: Path | None = None) -> OwnSimulator:
    """The simulator of a name.   point: test point of a model. RecipeError, OwnCodeError."""
    if name.endswith(FMU):
        return OwnSimulator.of(fmu_simulator(name, point), name)
    if name.startswith(PREFIX):
        return OwnSimulator.of(jsbsim_simulator(name, point), name)
    if point is not None:
        raise RecipeError(f"--point was given with --simulator {name}, which has its own: omit it")
    return OwnSimulator.of(_imported(name), name)


def _imported(name: str) -> Any:
    """Import an object, also from a module in the current folder."""
    module_name, _, attribute = name.partition(":")
    if not (module_name and attribute) or module_name.endswith(".py"):
        raise RecipeError(
            f"--simulator {name!r}: write it as package.module:name, such as sim:fly for fly in "
            "sim.py"
        )
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.insert(0, here)
    try:
        with running(name):
            module = import_module(module_name)
    except OwnCodeError as error:
        missing = getattr(error.__cause__, "name", "") or " "
        if isinstance(error.__cause__, ModuleNotFoundError) and module_name.startswith(missing):
            raise RecipeError(
                f"--simulator {name}: there is no module {missing} in {here} or installed: run the "
                "command in the folder that holds it"
            ) from error
        raise
    if not hasattr(module, attribute):
        known = [each for each in vars(module) if not each.startswith("_")]
        raise RecipeError(f"{module_name} has no {attribute!r}: {instead_of(attribute, known)}")
    return getattr(module, attribute)


def own_test(options: argparse.Namespace, t_early: float) -> OwnTest:
    """The test that the simulator flies, judged by the limits of the options. ValueError.

    t_early: warning lead time [s].
    """
    given = [name for name, value in vars(options).items() if value]
    sizes = {field.name: f"dataset.{field.name}" for field in fields(OwnTest)}
    names = {path: name for name, path in PATHS.items()}
    for name in given:
        if name in ITS_OWN or (name.startswith("dataset.") and name not in sizes.values()):
            word = names.get(name, name.replace("_", "-"))
            raise RecipeError(f"--{word} was given with --simulator, which has its own: omit one")
    asked = {name: getattr(options, path, None) for name, path in sizes.items()}
    asked = {name: value for name, value in asked.items() if value is not None}
    simulator = load(options.simulator, options.point)
    if simulator.dt > t_early:
        raise RecipeError(
            f"{simulator.name} has dt={simulator.dt:g} s, longer than the warning lead time of "
            f"{t_early:g} s: give its sample interval in seconds, or a longer --t-early"
        )
    test = OwnTest(simulator, **asked)
    with progress_bar("first rollouts", simulator.counts):
        y = simulator.outputs(PILOT_FLIGHTS, test.seed)
    check_lead(t_early, (y.shape[1] - 1) * simulator.dt)
    first = RolloutFile(y, simulator.dt, simulator.dictionary)
    dictionary, limits, ahead = specified(first, options.channel or (), options.limit or ())
    if ahead:
        raise RecipeError(
            f"{ahead[0].text!r} needs later samples, so it labels only whole rollouts: give them "
            "by --rollouts, or write it with words that look back"
        )
    n_obs = min(test.n_obs, y.shape[1])
    judged = simulator.judged(dictionary, limits, y.shape[1])
    return replace(test, flown_by=judged, n_obs=n_obs, pilot=judged.reached(y))
