"""Recipe parameters that depend on the sample interval, adjusted to `--dt` unless given."""

from math import ceil, inf
from typing import Any

from app.recipes.recipes import set_path
from core.monitor import MonitorRecipe
from core.planned_test.planned_test import DatasetRecipe
from core.simulation.maneuver import MANEUVERS

MOST_DELAY = 10
"""Most past outputs in an observation, however short the interval."""


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
