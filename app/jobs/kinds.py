"""The kinds of long work, one function for each kind of request."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from app.jobs.jobs import Result, Task
from app.jobs.requests import (
    CombinationRecipe,
    MonitorRequest,
    dataset_name,
    planned_test,
)
from app.jobs.training import (
    FlownTest,
    Progress,
    simulate,
    test_to_fly,
    too_few,
    train_and_test,
    with_test,
)
from app.recipes.recipes import USUAL_MONITOR
from app.recordings.flown_flights import sent_rollouts
from app.recordings.recordings import Recordings
from app.recordings.rollouts import SentRollouts
from app.store.store import Store
from core.evaluation.epsilon_choice import Choice, ChoiceRecipe, choose
from core.evaluation.lead_sweep import SweepRecipe, sweep
from core.evaluation.rates import clopper_pearson
from core.evaluation.study import StudyRecipe, study
from core.monitor import Monitor, combine
from core.monitor.group import GROUPINGS
from core.planned_test.collection import (
    combination_failures,
    evaluation_flights,
)
from core.planned_test.planned_test import ManeuverTest

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def simulate_dataset(task: Task, name: str, recipe: ManeuverTest, store: Store) -> Result:
    """Simulate and store a dataset; the result has its id."""
    dataset = simulate(recipe, task.progress, task.executor)
    task.progress("storing", task.done, task.total)
    return {"dataset": store.datasets.add(dataset, name).id}


def add_rollouts(task: Task, sent: SentRollouts, recordings: Recordings, most: int) -> Result:
    """Read, check and store rollouts; the result has the dataset's id and the findings.

    most: size of their array [bytes].
    """
    task.progress("reading the rollouts", 0, 3)
    rollouts = sent_rollouts(sent, recordings, most)
    task.progress("checking the flights", 1, 3)
    dataset, findings = rollouts.to_dataset()
    del rollouts  # as large as the flights
    findings += too_few(len(dataset.unsafe), USUAL_MONITOR)
    task.progress("storing", 2, 3)
    info = recordings.store.datasets.add(dataset, sent.name, findings)
    counts = {"n_unsafe": info.n_unsafe, "n_safe": info.n_safe}
    return {"dataset": info.id, "findings": findings} | counts


def train_monitor(task: Task, request: MonitorRequest, store: Store) -> Result:
    """Simulate if needed, train, test and store; the result has the ids of monitor and dataset."""
    requested = request.dataset
    if isinstance(requested, str):
        dataset_id, dataset = requested, store.datasets.get(requested)
    else:
        dataset = simulate(requested, task.progress, task.executor)
        dataset_id = store.datasets.add(dataset, dataset_name(requested)).id
    recipe, n_test = request.recipe, request.n_test
    training = train_and_test(
        dataset, recipe, n_test, task.progress, task.executor, choose=request.choose
    )
    task.progress("storing", task.done, task.total)
    info = store.monitors.add(training.monitor, request.name, dataset_id)
    methods = (training.monitor.evaluation or {}).get("methods")
    tried = {"methods": methods} if methods else {}
    return {"monitor": info.id, "dataset": dataset_id} | tried


def combine_monitors(
    task: Task, name: str, ids: list[str], recipe: CombinationRecipe, store: Store
) -> Result:
    """Calibrate stored monitors as one, test and store; the result has the monitor's id."""
    members = [store.monitors.get(monitor_id) for monitor_id in ids]
    combination, _ = combine_and_test(members, recipe, task.progress)
    task.progress("storing", task.done, task.total)
    digest = combination.dataset_digest
    datasets = [store.monitors.info(monitor_id).dataset_id for monitor_id in ids]
    same = (id_ for id_ in datasets if id_ and store.datasets.info(id_).digest == digest)
    info = store.monitors.add(combination, name, next(same, None))
    return {"monitor": info.id, "dataset": info.dataset_id}


def choose_epsilon(task: Task, monitor: Monitor, recipe: ChoiceRecipe) -> Result:
    """Choose an epsilon with fresh flights; the result has it with both measured shares."""
    choice = fly_and_choose(monitor, recipe, task.progress)
    return asdict(choice) | {"words": in_words(choice)}


def sweep_leads(task: Task, recipe: SweepRecipe, tests: Mapping[str, ManeuverTest]) -> Result:
    """Train every method at every lead; the result has each cell, a table and a figure as SVG."""
    from app.report.studies.study_figures import power_against_lead
    from app.report.studies.sweep import in_words as table
    from app.report.studies.sweep import summary

    def trained(done: int, total: int) -> None:
        task.progress(f"{done} of {total} monitors", done, total)

    swept = sweep(recipe, tests, executor=task.executor, progress=trained)
    drawn = _drawn(task, "power_by_lead", power_against_lead(swept, recipe))
    return summary(swept, recipe) | {"table": table(swept, recipe), "figures": drawn}


def compare_methods(task: Task, recipe: StudyRecipe) -> Result:
    """Compare the methods; the result has the curves, a table and figures as SVG."""
    from app.report.studies.study import summary, table
    from app.report.studies.study_figures import example_flights, study_curves

    def trained(done: int, total: int) -> None:
        task.progress(f"{done} of {total} monitors of each method", done, total)

    trained(0, recipe.n_monitors)
    result = study(recipe, executor=task.executor, progress=trained)
    drawn = _drawn(task, "miss_and_power", study_curves(result))
    drawn |= {name: svg.decode() for name, svg in example_flights(result).items()}
    return summary(result) | {"table": table(result), "figures": drawn}


def _drawn(task: Task, name: str, figure: "Figure") -> dict[str, str]:
    from app.report.studies.study_figures import render

    task.progress("drawing", task.done, task.total)
    return {name: svg.decode() for name, svg in render(figure, name, ["svg"]).items()}


def without_figures(result: dict[str, Any] | None, job_id: str) -> dict[str, Any] | None:
    """The result with links in place of its figures."""
    if not result or "figures" not in result:
        return result
    links = {name: f"/api/v1/jobs/{job_id}/figures/{name}" for name in result["figures"]}
    return result | {"figures": links}


def combine_and_test(
    members: Sequence[Monitor], recipe: CombinationRecipe, progress: Progress
) -> tuple[Monitor, FlownTest | None]:
    """Calibrate the members' common rule on fresh failures of their planned test, then test it.

    The test is None if n_test is 0.   ValueError if the members do not fit together.
    """
    dataset = planned_test(members, recipe.lead)

    def report(n_unsafe: int, n_made: int) -> None:
        message = f"calibrating: {n_unsafe} unsafe of {n_made} fresh flights"
        progress(message, n_unsafe, recipe.n_unsafe)

    pooled = replace(dataset, groups=GROUPINGS["pooled"])
    flights, n_made = combination_failures(pooled, recipe.n_unsafe, report)
    combination = combine(
        members,
        flights,
        lead=recipe.lead,
        epsilon=recipe.epsilon,
        guarantee=recipe.guarantee,
    )
    if recipe.n_test == 0:
        return combination, None
    progress(f"flying {recipe.n_test} fresh flights", 1, 2)
    return with_test(combination, dataset, recipe.n_test, recipe.n_unsafe / n_made)


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
