"""An aircraft of JSBSim named on the command line, and the test point that it flies."""

from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from app.commands.options.fmu_simulator import dictionary_for, nominal_and_spread
from app.recipes.recipes import RecipeError, from_plain, read_plain, to_plain
from app.telemetry.units import factor, spelled
from core.recipe import instead_of
from core.simulation.flight_process import ModelSimulator, ProcessLimits
from core.simulation.jsbsim import PROPERTIES, Jsbsim, JsbsimPoint, functions_of, writes

PREFIX = "jsbsim:"


def jsbsim_simulator(name: str, point: Path | None) -> ModelSimulator:
    """An aircraft, flying a test point. RecipeError; TelemetryError for units."""
    if find_spec("jsbsim") is None:
        raise RecipeError(f"{name} needs JSBSim: install forewarn[jsbsim]")
    if not (aircraft := name.removeprefix(PREFIX)):
        raise RecipeError(
            f"--simulator {name} names no aircraft: write it as {PREFIX}NAME, such as {PREFIX}c172p"
        )
    try:
        functions = functions_of(aircraft)
    except ValueError as error:
        raise RecipeError(str(error)) from None
    if point is None:
        raise RecipeError(
            f"--simulator {name} needs --point FILE.json, with altitude_m, speed_m_s and inputs, "
            "such as fcs/elevator-cmd-norm"
        )
    recipe = from_plain(JsbsimPoint(), read_plain(point), f"{point}")
    for part in ("altitude_m", "speed_m_s"):
        if getattr(recipe, part) is None:
            raise RecipeError(f"{point} has no {part}: give that of the trimmed flight")
    if not recipe.inputs:
        raise RecipeError(f"{point} has no inputs: give some, such as fcs/elevator-cmd-norm")
    if unknown := [each for each in recipe.parameters if each not in functions]:
        raise RecipeError(
            f"{point}: {name} has no function {unknown[0]!r}: {instead_of(unknown[0], functions)}"
        )
    channels = recipe.channels or {
        key: each
        for key, each in PROPERTIES.items()
        if not each.startswith("fcs/") or writes(aircraft, each)
    }
    units = [_unit(each) for each in channels.values()]
    dictionary = dictionary_for(list(channels), units)
    known = zip(units, dictionary.channels, strict=True)
    return ModelSimulator(
        Jsbsim(
            aircraft,
            recipe.altitude_m,
            recipe.speed_m_s,
            recipe.dt,
            functions,
            list(recipe.inputs),
            list(channels.values()),
            [factor(unit, channel.unit) if unit else 1.0 for unit, channel in known],
        ),
        name,
        ProcessLimits(recipe.seconds, recipe.memory),
        about={"point": to_plain(recipe), "jsbsim": version("jsbsim")},
        channels=dictionary,
        dt=recipe.dt,
        parameters={
            each: nominal_and_spread(recipe.parameters.get(each, recipe.spread), 1.0, each)
            for each in functions
        },
        inputs=recipe.pilot(),
        noise=recipe.noise,
        distribution=recipe.distribution,
    )


def _unit(name: str) -> str:
    """The unit at the end of a property's name, rad/s of q-rad_sec; empty for none."""
    unit = name.rpartition("-")[2].replace("_sec2", "/s^2").replace("_sec", "/s")
    return unit if spelled(unit) else ""
