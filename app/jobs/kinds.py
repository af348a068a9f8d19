"""The kinds of long work, one function for each kind of request."""

from dataclasses import asdict
from typing import Any

from app.jobs.choosing import fly_and_choose, in_words
from app.jobs.combining import combine_and_test
from app.jobs.jobs import Task, Work
from app.jobs.requests import (
    CombinationRequest,
    DatasetRequest,
    MonitorRequest,
    SweepRequest,
    dataset_name,
)
from app.jobs.training import simulate, train_and_test
from app.store.store import Store
from core.evaluation.epsilon_choice import ChoiceRecipe
from core.evaluation.lead_sweep import sweep
from core.evaluation.study import StudyRecipe, study
from core.monitor import Monitor


def dataset_work(request: DatasetRequest, store: Store) -> Work:
    """Simulate and store a dataset; the result has its id."""

    def work(task: Task) -> dict[str, Any]:
        dataset = simulate(request.recipe, task.progress)
        task.progress("storing", task.done, task.total)
        return {"dataset": store.datasets.add(dataset, request.name).id}

    return work


def monitor_work(request: MonitorRequest, store: Store) -> Work:
    """Simulate if needed, train, test and store; the result has the ids of monitor and dataset."""

    def work(task: Task) -> dict[str, Any]:
        dataset_id, dataset = request.dataset.id, request.dataset.load(store)
        if dataset is None:
            assert request.dataset.recipe
            dataset = simulate(request.dataset.recipe, task.progress)
            dataset_id = store.datasets.add(dataset, dataset_name(request.dataset.recipe)).id
        training = train_and_test(dataset, request.recipe, request.n_test, task.progress)
        task.progress("storing", task.done, task.total)
        info = store.monitors.add(training.monitor, request.name, dataset_id)
        return {"monitor": info.id, "dataset": dataset_id}

    return work


def combination_work(request: CombinationRequest, store: Store) -> Work:
    """Calibrate stored monitors as one, test and store; the result has the monitor's id."""

    def work(task: Task) -> dict[str, Any]:
        members = [store.monitors.get(monitor_id) for monitor_id in request.monitors]
        combination, _ = combine_and_test(members, request.recipe, task.progress)
        task.progress("storing", task.done, task.total)
        digest = combination.dataset_digest
        datasets = [store.monitors.info(monitor_id).dataset_id for monitor_id in request.monitors]
        same = (id_ for id_ in datasets if id_ and store.datasets.info(id_).digest == digest)
        info = store.monitors.add(combination, request.name, next(same, None))
        return {"monitor": info.id, "dataset": info.dataset_id}

    return work


def epsilon_work(monitor: Monitor, recipe: ChoiceRecipe) -> Work:
    """Choose an epsilon with fresh flights; the result has it with both measured shares."""

    def work(task: Task) -> dict[str, Any]:
        choice = fly_and_choose(monitor, recipe, task.progress)
        return asdict(choice) | {"words": in_words(choice)}

    return work


def sweep_work(request: SweepRequest) -> Work:
    """Train every method at every lead; the result has each cell, a table and a figure as SVG."""

    def work(task: Task) -> dict[str, Any]:
        from app.report.studies import study_figures as figures
        from app.report.studies.sweep import in_words as table
        from app.report.studies.sweep import summary
        from app.report.studies.sweep_figure import power_against_lead

        def trained(done: int, total: int) -> None:
            task.progress(f"{done} of {total} monitors", done, total)

        tests = sweep(request.recipe, request.tests, progress=trained)
        task.progress("drawing", task.done, task.total)
        drawn = figures.render(power_against_lead(tests, request.recipe), "power_by_lead", ["svg"])
        svg = {name: text.decode() for name, text in drawn.items()}
        text = table(tests, request.recipe)
        return summary(tests, request.recipe) | {"table": text, "figures": svg}

    return work


def study_work(recipe: StudyRecipe) -> Work:
    """Compare the five methods; the result has the curves, a table and figures as SVG."""

    def work(task: Task) -> dict[str, Any]:
        from app.report.studies import study_figures as figures
        from app.report.studies.study import summary, table

        def trained(done: int, total: int) -> None:
            task.progress(f"{done} of {total} monitors of each method", done, total)

        trained(0, recipe.n_monitors)
        result = study(recipe, progress=trained)
        task.progress("drawing", task.done, task.total)
        limits = recipe.dataset.specification.magnitudes
        drawn = figures.render(figures.study_curves(result), "miss_and_power", ["svg"])
        drawn |= figures.render(figures.study_rollouts(result, limits), "rollouts", ["svg"])
        svg = {name: text.decode() for name, text in drawn.items()}
        return summary(result) | {"table": table(result), "figures": svg}

    return work


def without_figures(result: dict[str, Any] | None, job_id: str) -> dict[str, Any] | None:
    """The result with links in place of its figures."""
    if not result or "figures" not in result:
        return result
    links = {name: f"/api/v1/jobs/{job_id}/figures/{name}" for name in result["figures"]}
    return result | {"figures": links}
