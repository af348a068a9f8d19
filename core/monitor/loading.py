"""Reading a portable monitor: from its sections to one that is ready to assess."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from core.channels import N_CHANNELS
from core.kernels.p_value import SIMPLE, Transduction
from core.monitor import portable
from core.monitor.monitor import Monitor, assemble
from core.monitor.portable import MonitorFileError, Section
from core.monitor.predictor import Affine
from core.monitor.recipe import MonitorRecipe
from core.monitor.support import Support
from core.recipe import from_plain
from core.specification import specification_from_plain


def load(path: str | Path) -> Monitor:
    """Read a portable monitor; MonitorFileError says what is wrong with the file."""
    return from_bytes(portable.read(path), str(path))


def from_bytes(blob: bytes, name: str = "monitor") -> Monitor:
    """Read a portable monitor from memory; `name` is what errors call it."""
    sections = portable.unpack(blob, name)
    try:
        return _rebuild(sections)
    except KeyError as error:
        raise MonitorFileError(
            f"{name} has no {error}: it was written by an older program, train the monitor again"
        ) from error
    except (TypeError, ValueError) as error:
        raise MonitorFileError(
            f"{name} holds a monitor that this program cannot rebuild ({error}): upgrade forewarn "
            "or train the monitor again"
        ) from error


def _rebuild(sections: Mapping[str, Section]) -> Monitor:
    header = sections["monitor"].header
    arrays: dict[str, Any] = dict(sections["monitor"].arrays)
    recipe = from_plain(MonitorRecipe(), header["recipe"])
    affine = Affine(arrays.pop("matrix"), arrays.pop("offset"))
    exact = _exact(sections.get("transduction"))
    _check_arrays(recipe, affine, exact, header, arrays)
    points = arrays["unsafe_points"], arrays["safe_points"]
    evaluation = sections.get("evaluation")
    return Monitor(
        recipe=recipe,
        fitted=assemble(recipe, affine, *points, arrays.pop("alphas")),
        exact=exact,
        theta_names=tuple(header["theta_names"]),
        specification=specification_from_plain(sections["specification"].header["specification"]),
        support=_support(sections.get("validity")),
        evaluation=None if evaluation is None else dict(evaluation.header),
        **{key: header[key] for key in portable.MONITOR_FIELDS},
        **arrays,
    )


def _exact(section: Section | None) -> Transduction:
    if section is None:
        return SIMPLE
    arrays = {key: section.arrays[key] for key in portable.EXACT_ARRAYS}
    return Transduction(
        **arrays, always=section.header["always"], running=section.header["running"]
    )


def _support(section: Section | None) -> Support | None:
    """The support; None where the monitor's validity is not calibrated."""
    if section is None:
        return None
    arrays = {key: section.arrays[key] for key in portable.SUPPORT_ARRAYS}
    support = Support(**arrays, **{key: section.header[key] for key in portable.SUPPORT_FIELDS})
    support.check()
    return support


def _check_arrays(
    recipe: MonitorRecipe,
    affine: Affine,
    exact: Transduction,
    header: Mapping[str, Any],
    arrays: Mapping[str, npt.NDArray[Any]],
) -> None:
    """Refuse arrays that do not fit together: kernels trust them without looking again."""
    d, n_parameters = len(affine.offset), len(header["theta_names"])
    if recipe.predictor.maps_to_outputs and d != N_CHANNELS:
        raise ValueError(f"its points have {d} entries instead of {N_CHANNELS}")
    n_failures, n_samples = len(exact.alphas), len(exact.points)
    shapes = {
        "matrix": (affine.matrix, (N_CHANNELS * (recipe.n_delay + 1), d)),
        "offset": (affine.offset, (d,)),
        "scale": (arrays["scale"], (N_CHANNELS,)),
        "training_max_abs": (arrays["training_max_abs"], (N_CHANNELS,)),
        "alphas": (arrays["alphas"], (len(arrays["alphas"]),)),
        "exact points": (exact.points, (n_samples, d if n_samples else 1)),
        "exact unsafe": (exact.unsafe, (n_samples,)),
        "exact safe": (exact.safe, (n_samples,)),
        "exact alphas": (exact.alphas, (n_failures,)),
    }
    counts = [("exact start", exact.start, n_samples)] if len(exact.start) else []
    for side in ("unsafe", "safe"):
        points, where = arrays[f"{side}_points"], arrays[f"{side}_where"]
        theta = arrays[f"theta_{side}"]
        shapes[f"{side} points"] = (points, (len(points), d))
        shapes[f"theta {side}"] = (theta, (len(theta), n_parameters))
        if where.shape != (len(points), 2):
            raise ValueError(f"{side} where has shape {where.shape}")
        counts.append((f"{side} where", where[:, 0], len(theta) - 1))
    for name, (array, shape) in shapes.items():
        if array.dtype != np.float64 or array.shape != shape:
            raise ValueError(f"{name} is {array.dtype} {array.shape} instead of float64 {shape}")
    for name, array, most in counts:
        if array.dtype != np.int64 or (len(array) and not 0 <= array.min() <= array.max() <= most):
            raise ValueError(f"{name} holds numbers outside 0 to {most}")
    if len(exact.start) and (
        len(exact.start) != n_failures + 1 or (np.diff(exact.start) < 0).any()
    ):
        raise ValueError("exact start does not delimit the failures' histories")
    if len(exact.points) and not len(exact.start):
        raise ValueError("exact points belong to no failure")
