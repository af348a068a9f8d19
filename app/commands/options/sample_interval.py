"""What of a recipe depends on its sample interval, where `--dt` is given and that is not."""

from math import ceil, inf
from typing import Any

from app.recipes import set_path
from core.monitor import MonitorRecipe
from core.planned_test import DatasetRecipe
from core.simulation.maneuver import MANEUVERS

MOST_DELAY = 10
"""Past outputs in an observation, however short the interval."""


def adjust_to_interval(plain: dict[str, Any], dt: float) -> list[str]:
    """Fill in what the recipe does not say and its defaults say for another interval.

    Whole steps in the duration, limits checked no more seldom, as many observations as there are
    samples, past outputs over the same time. Returns what was adjusted, in words.
    """
    usual, past = DatasetRecipe(), MonitorRecipe().n_delay
    dataset, monitor = plain.setdefault("dataset", {}), plain.setdefault("monitor", {})
    maneuver = dataset.get("maneuver", {}) if isinstance(dataset, dict) else {}
    if not (isinstance(maneuver, dict) and isinstance(monitor, dict) and 0.0 < dt < inf):
        return []  # what is wrong with it is told where it is read
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
    words = []
    for path, before, value, text in adjusted:
        if value != before and not _is_said(plain, path):
            set_path(plain, path, value)
            words.append(text)
    return words


def _is_said(plain: dict[str, Any], path: str) -> bool:
    *parents, last = path.split(".")
    for parent in parents:
        plain = plain.get(parent, {})
    return last in plain
