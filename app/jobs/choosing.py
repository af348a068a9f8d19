"""Choosing a trained monitor's epsilon, by fresh flights of its planned test."""

from app.jobs.training import Progress, simulated_test
from core.collection import evaluation_flights
from core.evaluation.epsilon_choice import Choice, ChoiceRecipe, choose
from core.evaluation.rates import clopper_pearson
from core.monitor import Monitor
from core.planned_test import DatasetRecipe


def flown_for(monitor: Monitor) -> DatasetRecipe:
    """The planned test that fresh flights are flown of; ValueError where it is not known."""
    recipe = simulated_test(monitor.dataset_recipe)
    if recipe is None:
        raise ValueError(
            "the monitor does not say which planned test it was trained for, so no fresh flights "
            "can be flown: train it again"
        )
    return recipe


def fly_and_choose(monitor: Monitor, recipe: ChoiceRecipe, progress: Progress) -> Choice:
    """Fly fresh flights through the monitor and choose; ChoiceError, and ValueError as above."""
    test = flown_for(monitor)
    progress(f"flying {recipe.n_test:,} fresh flights", 0, 2)
    flights = evaluation_flights(test, recipe.n_test)
    progress("choosing on one half, certifying on the other", 1, 2)
    found = choose(monitor, flights, recipe)
    progress("done", 2, 2)
    return found


def in_words(found: Choice) -> str:
    """The epsilon, and both shares with their intervals."""
    lines = [
        f"epsilon {found.epsilon:.4g}: alerts above a risk of {found.alert_above:.4g}",
        "on fresh flights that had no part in choosing it:",
        _line("missed", found.misses, found.n_unsafe, "failing flights"),
        _line("false alarms", found.false_alerts, found.n_safe, "safe flights"),
        f"  called invalid: {found.withdrawn} failing flights before an alert and "
        f"{found.safe_withdrawn} safe ones without one, neither missed nor false alarms",
        f"with 95 % confidence at most {found.most_missed:.2%} missed and at most "
        f"{found.most_false:.2%} false alarms",
    ]
    if found.cost is not None:
        lines.append(f"it costs as much as {found.cost:.3g} false alarms a flight")
    return "\n".join(lines)


def _line(what: str, count: int, total: int, of: str) -> str:
    low, high = clopper_pearson(count, total)
    return f"  {what:13} {count / total:6.2%} [{low:.2%}, {high:.2%}] of {total} {of}"
