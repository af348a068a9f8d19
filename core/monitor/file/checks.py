"""Checks of a monitor's file, field by field, because kernels trust its content.

Every check raises ValueError in the words of the file.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt

from core.bounds import quoted
from core.kernels.p_value import Transduction
from core.monitor.file.values import check_alphas, check_array, check_count, is_count, is_number
from core.monitor.observation import lead_steps
from core.monitor.predictor import Affine
from core.monitor.recipe import MonitorRecipe
from core.recipe import RecipeError
from core.types import Array


def check_header(header: Mapping[str, Any], recipe: MonitorRecipe) -> None:
    dt, h = header["dt"], header["h"]
    if not (is_number(dt) and 0 < dt < math.inf):
        raise ValueError(f"dt is {dt!r} instead of a positive number of seconds")
    check_count("h", h, least=1)
    if h != lead_steps(recipe.t_early, dt):
        raise ValueError(f"h is {h}, which does not match t_early={recipe.t_early} s at dt={dt} s")
    seed, names = header["seed"], header["theta_names"]
    if not (seed is None or is_count(seed, math.inf)):
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
        if isinstance(default_value, float) and is_number(value):
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
    n_channels: int,
) -> None:
    """Refuse arrays that do not fit together or hold impossible values."""
    d, n_parameters = len(affine.offset), len(header["theta_names"])
    if recipe.predictor.maps_to_outputs and d != n_channels:
        raise ValueError(f"its points have {d} entries instead of {n_channels}")
    check_array("matrix", affine.matrix, (n_channels * (recipe.n_delay + 1), d))
    check_array("offset", affine.offset, (d,))
    check_array("scale", arrays["scale"], (n_channels,), above=0)
    reach = arrays["training_max_abs"]
    check_array("training_max_abs", reach, (n_channels,), least=0, finite=False)
    for side in ("unsafe", "safe"):
        points, theta = arrays[f"{side}_points"], arrays[f"theta_{side}"]
        where, n = arrays[f"{side}_where"], len(points)
        check_array(f"{side} points", points, (n, d))
        check_array(f"theta {side}", theta, (len(theta), n_parameters))
        check_array(f"{side} where", where, (n, 2), np.int64, least=0, most=2**31 - 1)
        check_array(f"{side} where", where[:, 0], (n,), np.int64, most=len(theta) - 1)
    alphas, n_early = arrays["alphas"], header["n_early"]
    check_alphas("alphas", alphas, (len(alphas),))
    early = int(np.isposinf(alphas).sum())
    if not (is_count(n_early) and n_early == early):
        raise ValueError(
            f"n_early is {n_early!r}, but {early} of {len(alphas)} failures came too early for a "
            "warning"
        )
    n_points, n_timely = len(arrays["unsafe_points"]), len(alphas) - early
    most = n_timely if recipe.score.looks_up_neighbors else len(alphas)
    fits = recipe.score.of_members or n_timely <= n_points <= most
    if recipe.score.channel < 0 and not (len(arrays["safe_points"]) and fits):
        raise ValueError("the numbers of points and failures do not match")
    _check_exact(recipe, exact, alphas, d)


def _check_exact(recipe: MonitorRecipe, exact: Transduction, alphas: Array, d: int) -> None:
    n_failures, n_samples = len(exact.alphas), len(exact.points)
    check_array("exact points", exact.points, (n_samples, d if n_samples else 1))
    check_array("exact unsafe", exact.unsafe, (n_samples,), least=0, finite=False)
    check_array("exact safe", exact.safe, (n_samples,), least=0)
    check_array("exact alphas", exact.alphas, (n_failures,), finite=False)
    if recipe.is_exact != bool(len(exact.start)):
        if len(exact.points):
            raise ValueError("exact points belong to no failure")
        raise ValueError(f"p_value is {recipe.p_value}, which contradicts the section transduction")
    if not recipe.is_exact:
        return
    start, shape = exact.start, (n_failures + 1,)
    check_array("exact start", start, (len(start),), np.int64, least=0, most=n_samples)
    if (
        start.shape != shape
        or (start[0], start[-1]) != (0, n_samples)
        or (np.diff(start) < 0).any()
    ):
        raise ValueError("exact start does not delimit the failures' histories")
    if type(exact.running) is not bool or not is_count(exact.always):
        raise ValueError(f"transduction has always={exact.always!r}, running={exact.running!r}")
    if exact.running != (recipe.calibration == "trajectory"):
        raise ValueError(f"exact running contradicts the calibration {recipe.calibration!r}")
    expected = np.sort(np.append(exact.alphas, np.full(min(exact.always, len(alphas)), math.inf)))
    if not np.array_equal(expected, alphas):
        raise ValueError("exact alphas differ from alphas")


def check_specification(plain: object) -> None:
    """Refuse a specification that is neither limits by channel, nor a label, nor null."""
    if isinstance(plain, dict):
        for key, limit in plain.items():
            numbers = limit.values() if isinstance(limit, dict) else [limit]
            if not all(number is None or is_number(number) for number in numbers):
                raise ValueError(f"the limit of {key!r} is {limit!r}")
    elif not (plain is None or isinstance(plain, str)):
        raise ValueError(f"its specification is {plain!r}")


def check_evaluation(evaluation: Mapping[str, Any]) -> None:
    """Refuse an evaluation that cannot give a certificate."""
    for part, fits in _evaluation_parts(evaluation):
        if not fits:
            raise ValueError(f"evaluation {part} is impossible, or does not match its flights")


def _evaluation_parts(evaluation: Mapping[str, Any]) -> Iterator[tuple[str, bool]]:
    """Each part and whether it is possible; later ones rely on earlier ones."""
    n_unsafe, n_safe = evaluation["n_unsafe"], evaluation["n_safe"]
    yield "n_unsafe or n_safe", is_count(n_unsafe) and is_count(n_safe)
    at, curves = evaluation["at_epsilon"], evaluation["curves"]
    yield "at_epsilon", isinstance(at, dict) and _counts_fit(_row(at, evaluation), evaluation)
    yield "curves", isinstance(curves, dict) and all(type(v) is list for v in curves.values())
    yield "curves", len(set(map(len, curves.values()))) == 1 and _counts_fit(curves, evaluation)
    if "leads" in evaluation:
        leads = evaluation["leads"]
        times = [leads[name] for name in ("p05", "median", "p95")]
        yield "leads", all(is_count(leads[name], n_unsafe) for name in ("n_timely", "n_without"))
        yield "leads", times == [None] * 3 or all(map(is_number, times))
    if "prevention" in evaluation:
        yield "prevention", _prevention_fits(evaluation["prevention"])
    for robustness in evaluation.get("robustness", {}).values():
        yield "robustness", type(robustness["words"]) is str and is_count(robustness["n_unsafe"])
        yield "robustness", _counts_fit(_row(robustness, robustness), robustness)
        yield "robustness", _shares_fit(robustness)
    for method in evaluation.get("methods", []):
        pairs = ("missed", "n_unsafe"), ("quiet", "n_safe")
        yield "methods", type(method["name"]) is str and type(method["chosen"]) is bool
        yield "methods", all(is_count(method[n]) for _, n in pairs)
        yield "methods", all(is_count(method[part], method[n]) for part, n in pairs)
    for group in evaluation.get("groups", []):
        n, counts = group["n_unsafe"], (group["misses"], group["withdrawn"])
        low, high = group["miss_interval"]
        yield "groups", type(group["rule"]) is type(group["name"]) is str
        yield "groups", is_count(n, n_unsafe) and n > 0
        yield "groups", all(map(is_count, counts)) and sum(counts) <= n
        yield "groups", is_number(low) and is_number(high) and 0 <= low <= high <= 1


def _shares_fit(robustness: Mapping[str, Any]) -> bool:
    """Whether the shares of one difference are possible; each may be absent."""
    rate, worst = robustness.get("miss_rate"), robustness.get("worst")
    low, high = robustness.get("miss_interval", (0, 1))
    return (
        (rate is None or (is_number(rate) and 0 <= rate <= 1))
        and (is_number(low) and is_number(high) and 0 <= low <= high <= 1)
        and is_count(robustness.get("n_aircraft", 0))
        and (worst is None or (is_count(worst[0], worst[1]) and worst[1] > 0))
    )


def _prevention_fits(prevention: Mapping[str, Any]) -> bool:
    n_unsafe, n_safe, stopped = prevention["n_unsafe"], prevention["n_safe"], prevention["stopped"]
    rows = zip(
        prevention["reactions_s"], prevention["prevented"], prevention["caused"], strict=True
    )
    return (is_count(n_unsafe) and is_count(n_safe) and is_count(stopped, n_safe)) and all(
        is_number(reaction_s)
        and reaction_s > 0
        and is_count(prevented, n_unsafe)
        and is_count(caused, stopped)
        for reaction_s, prevented, caused in rows
    )


def _row(counts: Mapping[str, Any], evaluation: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Counts at one miss rate, as curves of one point."""
    return {key: [count] for key, count in counts.items()} | {"epsilon": [evaluation["epsilon"]]}


def _counts_fit(counts: Mapping[str, Sequence[Any]], evaluation: Mapping[str, Any]) -> bool:
    """Whether counts at miss rates are possible for the number of flights."""
    epsilons, n_unsafe, n_safe = counts["epsilon"], evaluation["n_unsafe"], evaluation["n_safe"]
    none = [0] * len(epsilons)
    withdrawn = (counts.get(key, none) for key in ("withdrawn", "safe_withdrawn"))
    rows = zip(epsilons, counts["misses"], counts["false_alerts"], *withdrawn, strict=True)
    return all(
        is_number(epsilon)
        and 0 < epsilon < 1
        and all(map(is_count, row))
        and row[0] + row[2] <= n_unsafe
        and row[1] + row[3] <= n_safe
        for epsilon, *row in rows
    )
