"""A functional mock-up unit named on the command line, and the test point that it flies."""

from collections.abc import Mapping, Sequence
from hashlib import file_digest
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from app.recipes.recipes import RecipeError, from_plain, read_plain, to_plain
from app.telemetry.recording import TelemetryError
from app.telemetry.rollouts import own_dictionary
from app.telemetry.units import PLAIN, factor
from core.channels import Dictionary, known_channels
from core.recipe import instead_of
from core.rollouts import dictionary_of
from core.simulation.flight_process import ModelSimulator, ProcessLimits
from core.simulation.fmu import Fmu
from core.simulation.point import PointRecipe

BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
"""Base units of FMI."""
REALS = ("Real", "Float64")


def fmu_simulator(name: str, point: Path | None) -> ModelSimulator:
    """The model in a file, flying a test point. RecipeError; TelemetryError for its units."""
    if find_spec("fmpy") is None:
        raise RecipeError(f"{name} needs FMPy: install forewarn[fmu]")
    description = _description(name)
    variables = {each.name: each for each in description.modelVariables}
    version = int(description.fmiVersion[0])
    if point is None:
        raise RecipeError(f"--simulator {name} needs --point FILE.json, with {_choice(variables)}")
    recipe = from_plain(PointRecipe(), read_plain(point), f"{point}")
    for part in ("channels", "parameters"):
        if not getattr(recipe, part):
            raise RecipeError(f"{point} has no {part}: give some, of {_choice(variables)}")

    def chosen(part: str, names: Sequence[str], *causalities: str) -> list[Any]:
        known = {
            key: each
            for key, each in variables.items()
            if each.type in REALS and not each.dimensions and each.causality in causalities
        }
        for each in names:
            if each not in known:
                raise RecipeError(
                    f"{point}: {name} has no real {part} {each!r}: {instead_of(each, known)}"
                )
        return [known[each] for each in names]

    parameters = chosen("parameter", list(recipe.parameters), "parameter")
    inputs = chosen("input", list(recipe.inputs), "input")
    outputs = chosen("output", list(recipe.channels.values()), "output", "local", "input")
    dictionary = dictionary_for(list(recipe.channels), [each.unit or "" for each in outputs])
    scaling = [
        _to_si(each, channel.unit, description)
        for each, channel in zip(outputs, dictionary.channels, strict=True)
    ]
    with open(name, "rb") as file:
        digest = file_digest(file, "sha256").hexdigest()
    return ModelSimulator(
        Fmu(
            str(Path(name).absolute()),
            version,
            recipe.dt,
            *([each.valueReference for each in some] for some in (parameters, inputs, outputs)),
            *zip(*scaling, strict=True),
        ),
        name,
        ProcessLimits(recipe.seconds, recipe.memory),
        about={"point": to_plain(recipe), "sha256": digest},
        channels=dictionary,
        dt=recipe.dt,
        parameters={
            each.name: nominal_and_spread(
                recipe.parameters[each.name], each.start, f"{point}: {each.name}"
            )
            for each in parameters
        },
        inputs=recipe.pilot(),
        noise=recipe.noise,
        distribution=recipe.distribution,
    )


def _description(name: str) -> Any:
    from fmpy import platform, read_model_description, supported_platforms
    from fmpy.fmi3 import platform_tuple

    needed = "give a model for co-simulation by FMI 2 or 3"
    try:
        with open(name, "rb"):
            description = read_model_description(name, validate=False)
        platforms = supported_platforms(name)
    except OSError as error:
        raise RecipeError(f"{name} is not readable ({error.strerror}): {needed}") from None
    except Exception as error:
        raise RecipeError(f"{name} is not a functional mock-up unit ({error}): {needed}") from None
    version = f"{description.fmiVersion}"
    if version[0] not in "23" or description.coSimulation is None:
        kind = "without co-simulation" if description.coSimulation is None else ""
        raise RecipeError(f"{name} is of FMI {version} {kind}".rstrip() + f": {needed}")
    if not {platform, platform_tuple} & {*platforms}:
        raise RecipeError(
            f"{name} is compiled for {', '.join(platforms) or 'no platform'}: export it for "
            f"{platform}"
        )
    return description


def _choice(variables: Mapping[str, Any]) -> str:
    """The parameters, inputs and outputs of a model, with their units."""
    texts = []
    for causality in ("parameter", "input", "output"):
        some = [each for each in variables.values() if each.causality == causality]
        named = (f"{each.name}{f' [{each.unit}]' if each.unit else ''}" for each in some)
        texts.append(f"{causality}s {', '.join(named) or 'none'}")
    return "; ".join(texts)


def dictionary_for(keys: Sequence[str], units: Sequence[str]) -> Dictionary:
    if set(keys) <= known_channels().keys():
        return dictionary_of(keys)
    return own_dictionary(keys, units)


def _to_si(variable: Any, unit: str, description: Any) -> tuple[float, float]:
    """Scale and offset of a variable to a channel's unit, from the model's own unit definitions.

    TelemetryError if neither these nor the unit's name give them.
    """
    if not variable.unit:
        return 1.0, 0.0
    defined = {each.name: each.baseUnit for each in description.unitDefinitions}
    base = defined.get(variable.unit)
    if base is not None:
        powers = [(each, getattr(base, each)) for each in BASE if getattr(base, each)]
        text = "*".join(f"{each}^{power}" for each, power in powers) or PLAIN
        try:
            scale = factor(text, unit)
        except TelemetryError:
            pass  # its name may be clearer than its definition: an angle without radians
        else:
            return base.factor * scale, base.offset * scale
    try:
        return factor(variable.unit, unit), 0.0
    except TelemetryError as error:
        raise TelemetryError(f"{variable.name}: {error}") from None


def nominal_and_spread(
    given: float | Sequence[float], nominal: float | str | None, where: str
) -> tuple[float, float]:
    """Nominal value and spread of a parameter at a test point. RecipeError.

    nominal: used if only the spread is given; None if unknown.   where: for the error.
    """
    if not isinstance(given, int | float):
        nominal, spread = given
        return float(nominal), spread
    if nominal is None:
        raise RecipeError(f"{where} has no start value in the model: give [nominal, spread]")
    return float(nominal), given
