"""Checks of a monitor's file, field by field, because kernels trust its content.

Every check raises ValueError in the words of the file.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt

from core.bounds import quoted
from core.channels import N_CHANNELS
from core.kernels.innovation import N_RESPONSES, Innovation
from core.kernels.p_value import Transduction
from core.monitor.observation import lead_steps
from core.monitor.predictor import Affine
from core.monitor.recipe import MonitorRecipe
from core.monitor.validity.support import Support
from core.recipe import RecipeError
from core.types import Array

MOST_LEAD = 100_000
"""Largest lead in samples: each flight stores that many forecasts."""
MAY_BE_INFINITE = ("alphas", "training_max_abs")
AT_EPSILON = ("misses", "false_alerts")


def check_header(header: Mapping[str, Any], recipe: MonitorRecipe) -> None:
    dt, h = header["dt"], header["h"]
    if not (_is_number(dt) and 0 < dt < math.inf):
        raise ValueError(f"dt is {dt!r} instead of a positive number of seconds")
    if not (_is_count(h) and 1 <= h <= MOST_LEAD):
        raise ValueError(f"h is {h!r} instead of 1 to {MOST_LEAD} samples")
    if h != lead_steps(recipe.t_early, dt):
        raise ValueError(f"h is {h}, which does not match t_early={recipe.t_early} s at dt={dt} s")
    seed, names = header["seed"], header["theta_names"]
    if not (seed is None or _is_count(seed, math.inf)):
        raise ValueError(f"seed is {seed!r} instead of an integer of 0 or more")
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
        raise ValueError("theta_names is not a list of names")
    for key, kind in (("dataset_recipe", dict), ("dataset_digest", str), ("version", str)):
        if not isinstance(header[key], kind):
            raise ValueError(f"{key} is {quoted(header[key])}")


def recipe_of(default: Any, values: Mapping[str, Any], where: str) -> Any:
    """Recipe of the default's class, with values of the same types as the default's."""
    for field in fields(default):
        default_value, value = getattr(default, field.name), values[field.name]
        if isinstance(default_value, float) and _is_number(value):
            continue
        if type(value) is not type(default_value) and not hasattr(
            default_value, "__dataclass_fields__"
        ):
            raise RecipeError(f"{where}.{field.name} is {quoted(value)}")
    return type(default)(**values)


def check_arrays(
    recipe: MonitorRecipe,
    affine: Affine,
    exact: Transduction,
    header: Mapping[str, Any],
    arrays: Mapping[str, npt.NDArray[Any]],
) -> None:
    """Refuse arrays that do not fit together or hold impossible values."""
    _check_shapes(recipe, affine, exact, header, arrays)
    scale, alphas = arrays["scale"], arrays["alphas"]
    finite = affine._asdict() | {key: a for key, a in arrays.items() if key not in MAY_BE_INFINITE}
    finite |= {"exact points": exact.points, "exact safe": exact.safe}
    for name, array in finite.items():
        if not np.isfinite(array).all():
            raise ValueError(f"{name} holds a value that is not finite")
    if (scale <= 0).any():
        raise ValueError(f"scale holds {scale.min()}, which is not positive")
    if not (arrays["training_max_abs"] >= 0).all():
        raise ValueError("training_max_abs holds a negative value or NaN")
    check_alphas(alphas, header["n_early"])
    n_points, n_timely = len(arrays["unsafe_points"]), len(alphas) - _early(alphas)
    most = n_timely if recipe.score.looks_up_neighbors else len(alphas)
    fits = recipe.score.of_members or n_timely <= n_points <= most
    if recipe.score.channel < 0 and not (len(arrays["safe_points"]) and fits):
        raise ValueError("the numbers of points and failures do not match")
    _check_exact(recipe, exact, alphas)


def check_alphas(alphas: Array, n_early: object) -> None:
    """Refuse unsorted calibration scores, and a wrong count of early failures.

    n_early: failures too early for a warning, whose score is +inf.
    """
    if not len(alphas) or np.isnan(alphas).any() or alphas[0] == -math.inf:
        raise ValueError("alphas is empty, or holds NaN or -inf")
    if (alphas[1:] < alphas[:-1]).any():
        raise ValueError("alphas is not sorted")
    if not (_is_count(n_early) and n_early == _early(alphas)):
        raise ValueError(
            f"n_early is {n_early!r}, but {_early(alphas)} of {len(alphas)} failures came too "
            "early for a warning"
        )


def _check_exact(recipe: MonitorRecipe, exact: Transduction, alphas: Array) -> None:
    if recipe.is_exact != bool(len(exact.start)):
        raise ValueError(f"p_value is {recipe.p_value}, which contradicts the section transduction")
    if not recipe.is_exact:
        return
    if type(exact.running) is not bool or not _is_count(exact.always):
        raise ValueError(f"transduction has always={exact.always!r}, running={exact.running!r}")
    if exact.running != (recipe.calibration == "trajectory"):
        raise ValueError(f"exact running contradicts the calibration {recipe.calibration!r}")
    expected = np.sort(np.append(exact.alphas, np.full(min(exact.always, len(alphas)), math.inf)))
    if not np.array_equal(expected, alphas):
        raise ValueError("exact alphas differ from alphas")
    if np.isnan(exact.unsafe).any() or (exact.unsafe < 0).any() or (exact.safe < 0).any():
        raise ValueError("exact unsafe or exact safe holds a negative distance or NaN")


def _check_shapes(
    recipe: MonitorRecipe,
    affine: Affine,
    exact: Transduction,
    header: Mapping[str, Any],
    arrays: Mapping[str, npt.NDArray[Any]],
) -> None:
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
        counts.append((f"{side} where", where[:, 1], 2**31 - 1))
    for name, (array, shape) in shapes.items():
        if array.dtype != np.float64 or array.shape != shape:
            raise ValueError(f"{name} is {array.dtype} {array.shape} instead of float64 {shape}")
    for name, array, most in counts:
        if array.dtype != np.int64 or (len(array) and not 0 <= array.min() <= array.max() <= most):
            raise ValueError(f"{name} holds numbers outside 0 to {most}")
    if len(exact.start) and (
        len(exact.start) != n_failures + 1
        or (exact.start[0], exact.start[-1]) != (0, n_samples)
        or (np.diff(exact.start) < 0).any()
    ):
        raise ValueError("exact start does not delimit the failures' histories")
    if len(exact.points) and not len(exact.start):
        raise ValueError("exact points belong to no failure")


def check_specification(plain: object) -> None:
    """Refuse a specification that is neither limits by channel, nor a label, nor null."""
    if isinstance(plain, dict):
        if wrong := [key for key, n in plain.items() if not (n is None or _is_number(n))]:
            raise ValueError(f"the limit of {wrong[0]!r} is {plain[wrong[0]]!r}")
    elif not (plain is None or isinstance(plain, str)):
        raise ValueError(f"its specification is {plain!r}")


def check_support(support: Support) -> None:
    support.check()
    if not (_is_count(support.n_samples) and support.n_samples >= 1):
        raise ValueError(f"support n_samples is {support.n_samples!r}")
    if not _is_number(support.level):
        raise ValueError(f"support level is {support.level!r}")


def check_residuals(support: Support, forecasts: bool) -> None:
    """Refuse deviations that do not match the predictor. forecasts: whether it forecasts."""
    known = np.isfinite(support.sigma)
    if forecasts != known.all() or forecasts != known.any() or (support.sigma <= 0).any():
        raise ValueError("support sigma does not match its forecasts")


def check_innovation(innovation: Innovation) -> None:
    """Refuse an innovation forecast that is impossible or that kernels cannot read."""
    for name in ("n_past", "spacing", "window"):
        if not (_is_count(number := getattr(innovation, name), MOST_LEAD)):
            raise ValueError(f"innovation {name} is {number!r} instead of 0 to {MOST_LEAD} samples")
    n_past, spacing, window = innovation.n_past, innovation.spacing, innovation.window
    if len({n_past > 0, spacing > 0, window > 0}) > 1 or innovation.history > MOST_LEAD:
        raise ValueError(f"innovation has n_past={n_past}, spacing={spacing}, window={window}")
    n_known = N_CHANNELS * (n_past + 1) if n_past else 0
    for name, shape in (
        ("matrix", (n_known, 2 * N_RESPONSES)),
        ("offset", (2 * N_RESPONSES,)),
        ("sigma", (N_RESPONSES,)),
    ):
        array = getattr(innovation, name)
        if array.dtype != np.float64 or array.shape != shape or not np.isfinite(array).all():
            raise ValueError(f"innovation {name} is {array.dtype} {array.shape}, not {shape}")
    if (innovation.sigma <= 0).any():
        raise ValueError("innovation sigma holds a value that is not positive")


def check_evaluation(evaluation: Mapping[str, Any]) -> None:
    """Refuse an evaluation that cannot give a certificate."""
    n_unsafe, n_safe = evaluation["n_unsafe"], evaluation["n_safe"]
    if not (_is_count(n_unsafe) and _is_count(n_safe)):
        raise ValueError(f"evaluation counts n_unsafe={n_unsafe!r} and n_safe={n_safe!r}")
    at, curves = evaluation["at_epsilon"], evaluation["curves"]
    if not (isinstance(at, dict) and isinstance(curves, dict)):
        raise ValueError("evaluation at_epsilon or curves is not a mapping")
    if not all(isinstance(values, list) for values in curves.values()):
        raise ValueError("evaluation curves are not lists")
    if len({len(values) for values in curves.values()}) > 1:
        raise ValueError("evaluation curves have unequal lengths")
    _check_counts([evaluation["epsilon"]], {key: [count] for key, count in at.items()}, evaluation)
    _check_counts(curves["epsilon"], curves, evaluation)
    if "leads" in evaluation:
        leads = evaluation["leads"]
        if not all(_is_count(leads[name], n_unsafe) for name in ("n_timely", "n_without")):
            raise ValueError("evaluation leads exceed the number of flights")
        times = [leads[name] for name in ("p05", "median", "p95")]
        if not (times == [None] * 3 or all(map(_is_number, times))):
            raise ValueError(f"evaluation leads are {times}")
    if "prevention" in evaluation:
        _check_prevention(evaluation["prevention"])
    for robustness in evaluation.get("robustness", {}).values():
        if not (type(robustness["words"]) is str and _is_count(robustness["n_unsafe"])):
            raise ValueError("evaluation robustness has no text, or no count of flights")
        counts = {key: [count] for key, count in robustness.items()}
        _check_counts([robustness["epsilon"]], counts, robustness)
    for group in evaluation.get("groups", []):
        _check_group(group, n_unsafe)


def _check_group(group: Mapping[str, Any], n_unsafe: int) -> None:
    """Refuse a group without text or flights, or with counts above its flights."""
    if not (type(group["rule"]) is str and type(group["name"]) is str):
        raise ValueError("evaluation groups have no text")
    n = group["n_unsafe"]
    if not (_is_count(n, n_unsafe) and n > 0):
        raise ValueError(f"evaluation counts {n!r} of {n_unsafe} failing flights in a group")
    counts = group["misses"], group["withdrawn"]
    if not (all(_is_count(count) for count in counts) and sum(counts) <= n):
        raise ValueError("evaluation groups exceed their number of flights")
    low, high = group["miss_interval"]
    if not (_is_number(low) and _is_number(high) and 0 <= low <= high <= 1):
        raise ValueError(f"evaluation groups have a miss interval of {low!r} to {high!r}")


def _check_prevention(prevention: Mapping[str, Any]) -> None:
    """Refuse reactions and counts that do not match the number of flights."""
    n_unsafe, n_safe, stopped = prevention["n_unsafe"], prevention["n_safe"], prevention["stopped"]
    if not (_is_count(n_unsafe) and _is_count(n_safe) and _is_count(stopped, n_safe)):
        raise ValueError("evaluation prevention exceeds its number of flights")
    rows = zip(
        prevention["reactions_s"], prevention["prevented"], prevention["caused"], strict=True
    )
    for reaction_s, prevented, caused in rows:
        if not (_is_number(reaction_s) and reaction_s > 0):
            raise ValueError(f"evaluation prevention has a reaction of {reaction_s!r} s")
        if not (_is_count(prevented, n_unsafe) and _is_count(caused, stopped)):
            raise ValueError("evaluation prevention exceeds its number of flights")


def _check_counts(
    epsilons: Sequence[Any], counts: Mapping[str, Sequence[Any]], evaluation: Mapping[str, Any]
) -> None:
    """Refuse counts at miss rates that do not match the number of flights."""
    if not all(_is_number(epsilon) and 0 < epsilon < 1 for epsilon in epsilons):
        raise ValueError("evaluation epsilon is not a miss rate")
    n_unsafe, n_safe = evaluation["n_unsafe"], evaluation["n_safe"]
    none = [0] * len(epsilons)
    withdrawn = (counts.get(key, none) for key in ("withdrawn", "safe_withdrawn"))
    for row in zip(*(counts[key] for key in AT_EPSILON), *withdrawn, strict=True):
        if not all(_is_count(count) for count in row):
            raise ValueError("evaluation misses, false_alerts or withdrawn is not a count")
        misses, false_alerts, unsafe_withdrawn, safe_withdrawn = row
        if misses + unsafe_withdrawn > n_unsafe or false_alerts + safe_withdrawn > n_safe:
            raise ValueError("evaluation exceeds its number of flights")


def _early(alphas: Array) -> int:
    return int(np.isposinf(alphas).sum())


def _is_count(value: object, most: float = 2**53) -> bool:
    return type(value) is int and 0 <= value <= most


def _is_number(value: object) -> bool:
    return type(value) in (int, float)
