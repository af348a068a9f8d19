"""Choose a trained monitor's epsilon with fresh flights of its planned test."""

from app.jobs.training import Progress, simulated_test
from core.evaluation.epsilon_choice import Choice, ChoiceRecipe, choose
from core.evaluation.rates import clopper_pearson
from core.monitor import Monitor
from core.planned_test.collection import evaluation_flights
from core.planned_test.planned_test import DatasetRecipe


def test_to_fly(monitor: Monitor) -> DatasetRecipe:
    """The monitor's planned test, to fly again. ValueError if it is not known."""
    recipe = simulated_test(monitor.dataset_recipe)
    if recipe is None:
        raise ValueError(
            "the monitor has no recipe of its planned test, so no fresh flights can be flown: "
            "train it again"
        )
    return recipe


def fly_and_choose(monitor: Monitor, recipe: ChoiceRecipe, progress: Progress) -> Choice:
    """Fly fresh flights through the monitor and choose. ChoiceError, ValueError."""
    test = test_to_fly(monitor)
    progress(f"flying {recipe.n_test:,} fresh flights", 0, 2)
    flights = evaluation_flights(test, recipe.n_test)
    progress("choosing on one half, certifying on the other", 1, 2)
    choice = choose(monitor, flights, recipe)
    progress("done", 2, 2)
    return choice


def in_words(choice: Choice) -> str:
    """The epsilon, and both shares with their 95 % intervals."""
    lines = [
        f"epsilon {choice.epsilon:.4g}: alerts above a risk of {choice.alert_above:.4g}",
        "on fresh flights not used to choose it:",
        _line("missed", choice.misses, choice.n_unsafe, "failing flights"),
        _line("false alarms", choice.false_alerts, choice.n_safe, "safe flights"),
        f"  called invalid: {choice.withdrawn} failing flights before an alert and "
        f"{choice.safe_withdrawn} safe flights without an alert; these count neither as missed "
        "nor as false alarms",
        f"with 95 % confidence at most {choice.most_missed:.2%} missed and at most "
        f"{choice.most_false:.2%} false alarms",
    ]
    if choice.cost is not None:
        lines.append(f"cost: that of {choice.cost:.3g} false alarms a flight")
    return "\n".join(lines)


def _line(label: str, count: int, total: int, flights: str) -> str:
    low, high = clopper_pearson(count, total)
    return f"  {label:13} {count / total:6.2%} [{low:.2%}, {high:.2%}] of {total} {flights}"
