"""Loading a portable monitor from its sections."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from core.channels import LATERAL, Dictionary
from core.kernels.assessing import Fitted
from core.kernels.p_value import SIMPLE, Transduction
from core.limits.limits import specification_from_plain
from core.monitor import ensemble, peak_ridge, response_filter
from core.monitor.combination import Combined, combination_of
from core.monitor.file import portable
from core.monitor.file.checks import (
    check_arrays,
    check_evaluation,
    check_header,
    check_specification,
    recipe_of,
)
from core.monitor.file.portable import MonitorFileError, Section
from core.monitor.group import Groups, Pooled
from core.monitor.monitor import Monitor, assemble
from core.monitor.peak_forecast import PeakForecast
from core.monitor.predictor import Affine
from core.monitor.recipe import MonitorRecipe
from core.monitor.validity.flown_input import InputSupport
from core.monitor.validity.support import Support
from core.recipe import from_plain


def load(path: str | Path) -> Monitor:
    """Read a portable monitor. MonitorFileError."""
    return from_bytes(portable.read(path), str(path))


def from_bytes(blob: bytes, name: str = "monitor") -> Monitor:
    """Read a portable monitor from memory. MonitorFileError, which calls it `name`."""
    sections = portable.unpack(blob, name)
    try:
        return _rebuild(sections)
    except KeyError as error:
        raise MonitorFileError(
            f"{name} has no {portable.in_short(error)}, because an older program wrote it: train "
            "the monitor again"
        ) from error
    except (TypeError, ValueError, AttributeError, ArithmeticError, IndexError) as error:
        raise MonitorFileError(
            f"{name} holds a monitor that this program cannot rebuild "
            f"({portable.in_short(error)}): upgrade forewarn or train the monitor again"
        ) from error


def _rebuild(sections: Mapping[str, Section]) -> Monitor:
    header, stored = sections["monitor"].header, sections["monitor"].arrays
    arrays: dict[str, Any] = {key: stored[key] for key in portable.MONITOR_ARRAYS}
    recipe = from_plain(MonitorRecipe(), header["recipe"], build=recipe_of)
    affine = Affine(stored["matrix"], stored["offset"])
    exact = _exact(sections.get("transduction"))
    check_header(header, recipe)
    dictionary = LATERAL
    if "dictionary" in sections:
        dictionary = Dictionary.from_plain(sections["dictionary"].header)
    check_arrays(recipe, affine, exact, header, arrays, len(dictionary))
    specification = sections["specification"].header["specification"]
    check_specification(specification)
    if "evaluation" in sections:
        check_evaluation(sections["evaluation"].header)
    validity, inputs = sections.get("validity"), sections.get("input")
    points = arrays["unsafe_points"], arrays["safe_points"]
    fitted = assemble(recipe, affine, *points, arrays.pop("alphas"))
    return Monitor(
        recipe=recipe,
        fitted=fitted,
        exact=exact.indexed() if recipe.is_exact else SIMPLE,
        theta_names=tuple(header["theta_names"]),
        specification=specification_from_plain(specification, dictionary),
        dictionary=dictionary,
        support=validity and Support.from_section(validity, recipe.predictor.forecasts, dictionary),
        evaluation=dict(sections["evaluation"].header) if "evaluation" in sections else None,
        inputs=inputs and InputSupport.from_section(inputs, dictionary),
        forecast=_forecast(sections, recipe, header["h"], fitted, dictionary),
        groups=_groups(sections.get("groups"), recipe),
        **{key: header[key] for key in portable.MONITOR_FIELDS} | {"dt": float(header["dt"])},
        **arrays,
    )


def _exact(section: Section | None) -> Transduction:
    if section is None:
        return SIMPLE
    arrays: dict[str, Any] = {key: section.arrays[key] for key in portable.EXACT_ARRAYS}
    return Transduction(
        **arrays, always=section.header["always"], running=section.header["running"]
    )


def _forecast(
    sections: Mapping[str, Section],
    recipe: MonitorRecipe,
    h: int,
    fitted: Fitted,
    dictionary: Dictionary,
) -> PeakForecast | None:
    """Forecast of the rest of the manoeuvre; None if the predictor makes none."""
    wanted = recipe.predictor.forecast
    for name in ("card", "peaks", "ensemble", "members"):
        if (name in sections) != (name == wanted):
            raise ValueError(f"its predictor and its section {name} do not match")
    if wanted == "members":
        return combination_of(_members(sections["members"]), recipe.n_delay, h)
    if wanted == "card":
        return response_filter.from_section(sections["card"], h, recipe.score)
    if wanted == "ensemble":
        section = sections["ensemble"]
        return ensemble.from_section(section, fitted, recipe.n_delay, dictionary)
    return peak_ridge.from_section(sections["peaks"], dictionary) if wanted else None


def _groups(section: Section | None, recipe: MonitorRecipe) -> Groups | None:
    if (section is None) != isinstance(recipe.groups, Pooled):
        raise ValueError("its recipe and its section groups do not match")
    return None if section is None else Groups.from_section(section)


def _members(section: Section) -> tuple[Monitor, ...]:
    """Members of a combination. MonitorFileError names an invalid member."""
    n_members, members = section.header["n_members"], []
    if type(n_members) is not int or n_members != len(section.arrays):
        raise ValueError(f"n_members is {n_members!r}, but there are {len(section.arrays)} files")
    for number in range(1, n_members + 1):
        name, file = f"member {number}", section.arrays[f"{number}"]
        if file.dtype != np.uint8 or file.ndim != 1:
            raise ValueError(f"{name} is {file.dtype} {file.shape} instead of a file's bytes")
        parts = portable.unpack(file.tobytes(), name)
        if Combined.section in parts:
            raise ValueError(f"{name} is itself a combination")
        members.append(_rebuild(parts))
    return tuple(members)
