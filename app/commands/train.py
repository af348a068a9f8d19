"""`forewarn train`: simulate, train and test a monitor; print a summary and write its file."""

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import closing, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from app.assessment.wording import PROMISED
from app.commands.options.option import add_output, add_place, add_scheduler, option, place_of
from app.commands.options.own_simulator import own_test
from app.commands.options.recipe import (
    add_recipe_options,
    monitor_options,
    plain_recipe,
    print_recipe,
)
from app.commands.output.results import check_file, print_result, progress_bar, stage_bar
from app.commands.output.scores import read_mapping
from app.jobs.cluster import executor_at
from app.jobs.requests import N_TEST
from app.jobs.training import (
    FlownTest,
    Training,
    simulate,
    train_and_test,
    train_on_flights,
)
from app.recipes import labels
from app.recipes.recipes import (
    RecipeError,
    dataset_for,
    from_plain,
    monitor_as_ordered,
    simulated_test,
)
from app.recordings.flown_flights import RolloutSources, no_rollouts, recorded_files
from app.telemetry.rollouts import read_dictionary, read_rollouts
from app.telemetry.targets import beyond_plausible
from core.bounds import Bounds, check_bounds
from core.channels import LATERAL
from core.counted import counted
from core.dataset import Dataset
from core.evaluation.certificate import calibrated_on, warnings_of
from core.evaluation.method_choice import kept_in_words
from core.evaluation.rates import clopper_pearson
from core.monitor import Monitor, MonitorRecipe
from core.monitor.calibration import check_epsilon
from core.monitor.training import check_lead
from core.planned_test.collection import DatasetRecipe, SimulatedTest, card_of
from core.planned_test.own import OwnTest
from core.planned_test.planned_test import ManeuverTest
from core.rollouts import doubts_of

SIMULATED = "simulated"
"""Source of the rollouts that the recipe simulates."""


@dataclass(frozen=True)
class TrainingRecipe:
    """Simulate a dataset, train a monitor, and fly fresh rollouts through it."""

    dataset: ManeuverTest = DatasetRecipe()  # noqa: RUF009
    monitor: MonitorRecipe = MonitorRecipe()  # noqa: RUF009
    n_test: Annotated[int, Bounds(least=0, words="it must be 0 or more")] = N_TEST
    """fresh test flights; 2000 if absent"""

    def __post_init__(self) -> None:
        check_bounds(self)


def add(parser: argparse.ArgumentParser) -> None:
    add_recipe_options(parser, "n_test", of=TrainingRecipe, method=True)
    own = parser.add_argument_group("own simulator or rollouts, instead of simulated ones")
    option(
        own,
        "--simulator SPEC",
        "your simulator in Python, package.module:name, or a model.fmu, whose code runs with your "
        "rights; or jsbsim:AIRCRAFT",
    )
    option(
        own,
        "--point FILE.json",
        "test point that a model flies: inputs, parameters, channels",
        type=Path,
    )
    option(
        own,
        "--rollouts SOURCE",
        "flights of your simulator: a folder with a file for each, a table with a column flight, "
        "or arrays y, dt, channels, units in npz, MATLAB or HDF5; "
        f"{SIMULATED}: those of the recipe, beside --recordings",
        type=Path,
    )
    option(
        own,
        "--recordings FILE",
        "recordings of flown flights, in any known format, whose manoeuvres are rollouts: alone, "
        "or beside --rollouts or --simulator",
        type=Path,
        nargs="+",
    )
    option(
        own,
        "--label FILE=safe|TIME[,TIME]",
        "outcome of a recording: safe, or its times of failure [s]; by the limits if absent",
        action="append",
    )
    option(own, "--mapping FILE.json", "of all recordings; proposed for each if absent", type=Path)
    option(own, "--dictionary FILE", "channels as JSON or CSV: key, unit, role ...", type=Path)
    option(
        own,
        "--channel FORMULA",
        "computed channel, such as 'load [kN] = 0.7*Nz*mass', to limit by --limit load=..12; a "
        "limit on what lasts needs none: --limit 'Nz=..4.9 for 0.2 s', nor does a requirement: "
        "--limit 'always (Nz < 4.9 or alpha < 0.2)'",
        action="append",
    )
    add_output(parser, "FILE", "file to write", Path("monitor.fwm"))
    add_scheduler(parser)
    add_place(parser, "directory of a server's data, to store dataset and monitor there, too")


def run(options: argparse.Namespace) -> int:
    for name in ("label", "mapping"):
        if options.recordings is None and getattr(options, name) is not None:
            raise RecipeError(f"--{name} was given without --recordings: give both")
    if options.point is not None and options.simulator is None:
        raise RecipeError("--point was given without --simulator: give both")
    if options.simulator is not None and options.recordings is None:
        return run_on_simulator(options)
    if options.rollouts is not None or options.recordings is not None:
        return run_on_rollouts(options)
    for name in ("dictionary", "channel"):
        if getattr(options, name) is not None:
            raise RecipeError(f"--{name} was given without --rollouts or --recordings: give both")
    recipe = recipe_of(options)
    if options.print_recipe:
        return print_recipe(recipe)
    check_epsilon(recipe.monitor.epsilon, recipe.dataset.n_unsafe, recipe.monitor.guarantee)
    if recipe.monitor.predictor.forecast == "card":
        card_of(recipe.dataset, 2)  # refuses a manoeuvre without planned steps
    check_file(options.out)
    choose = not monitor_options(options).keys() & {"predictor", "score"}
    with executor_at(options.scheduler) as executor:
        dataset = simulated(recipe.dataset, executor)
        with stage_bar("training") as show:
            training = train_and_test(
                dataset, recipe.monitor, recipe.n_test, show, executor, choose=choose
            )
    return _finish(options, training, dataset)


def run_on_simulator(options: argparse.Namespace) -> int:
    plain = monitor_options(options)
    recipe = from_plain(MonitorRecipe(), monitor_as_ordered(plain)).as_planned()
    with redirect_stdout(sys.stderr):  # the results alone are on the output
        test = own_test(options, recipe.t_early)
    check_file(options.out)
    check_epsilon(recipe.epsilon, test.n_unsafe, recipe.guarantee)
    if recipe.predictor.forecast == "card":
        card_of(test)
    n_test = vars(options).get(".n_test")
    n_test = TrainingRecipe(n_test=N_TEST if n_test is None else n_test).n_test
    choose = not monitor_options(options).keys() & {"predictor", "score"}
    with redirect_stdout(sys.stderr), executor_at(options.scheduler) as executor:
        dataset = simulated(test, executor)
        flights = dataset.flights()
        test.flown_by.check_unlike(flights.y)
        with stage_bar("training", test.flown_by.counts) as show:
            training = train_and_test(
                dataset, recipe, n_test, show, executor, test=test, choose=choose
            )
    findings = (*doubts_of(flights), *beyond_plausible(dataset.dictionary, flights.y))
    if redrawn := getattr(test.flown_by.own, "redrawn", ""):
        findings = (*findings, redrawn)
    return _finish(options, training, dataset, findings)


def recipe_of(options: argparse.Namespace) -> TrainingRecipe:
    recipe = from_plain(TrainingRecipe(), plain_recipe(options))
    recipe = replace(recipe, dataset=dataset_for(recipe.monitor, recipe.dataset))
    check_lead(recipe.monitor.t_early, recipe.dataset.maneuver.duration_s)
    return recipe


def simulated(test: SimulatedTest, executor: Executor | None = None) -> Dataset:
    counts = test.flown_by.counts if isinstance(test, OwnTest) else None
    with progress_bar("unsafe rollouts", counts) as progress:
        return simulate(test, lambda _, done, total: progress(done, total), executor)


def rollouts_of(options: argparse.Namespace, recipe: MonitorRecipe) -> RolloutSources:
    """Own rollouts, from files, recordings or both. TelemetryError, RecipeError."""
    flown = None
    if options.recordings is not None:
        mapping = None if options.mapping is None else read_mapping(options.mapping)
        flown = recorded_files(options.recordings, mapping, options.label or ())
        if options.simulator is not None:
            return RolloutSources.beside(simulated(own_test(options, recipe.t_early)), flown)
    if flown is not None and f"{options.rollouts}" == SIMULATED:
        for name in ("dictionary", "channel"):
            if getattr(options, name) is not None:
                raise RecipeError(f"--{name} was given beside simulated rollouts: leave it out")
        return RolloutSources.beside(simulated(recipe_of(options).dataset), flown)
    given = None if options.dictionary is None else read_dictionary(options.dictionary)
    dt, channels, limits = getattr(options, "dataset.dt"), options.channel, options.limit
    if options.rollouts is not None:
        read = read_rollouts(options.rollouts, given, dt=dt)
    else:
        read = no_rollouts(LATERAL if given is None else given.dictionary, dt)
    return RolloutSources(read, flown, None, channels or (), limits or ())


def run_on_rollouts(options: argparse.Namespace) -> int:
    plain = monitor_options(options)
    recipe = from_plain(MonitorRecipe(), monitor_as_ordered(plain))
    check_file(options.out)
    dataset, findings = rollouts_of(options, recipe).to_dataset()
    choose = not plain.keys() & {"predictor", "score"}
    with stage_bar("training") as show:
        training = train_on_flights(dataset, recipe, choose, show)
    return _finish(options, training, dataset, findings)


def _finish(
    options: argparse.Namespace,
    training: Training,
    whole: Dataset,
    findings: Sequence[str] | None = None,
) -> int:
    """Write the monitor, store it if an option asks for it, and print a summary.

    whole: the dataset that was given, of which flights may have been held out.
    findings: of own flights; None for simulated ones.
    """
    monitor = training.monitor
    monitor.save(options.out)
    facts = summary(training) | {"file": str(options.out)}
    notes = [f"note: {text}" for text in findings or ()]
    lines = [*notes, *method_lines(monitor), report(training), f"written: {options.out}"]
    methods = (monitor.evaluation or {}).get("methods", [])
    if findings is not None:
        facts |= {"findings": list(findings)}
    if methods or findings is not None:
        facts |= {"methods": methods}
    if options.data_dir is not None or options.database_url is not None:
        from app.store.store import open_store  # slow to import, and seldom needed

        with closing(open_store(place_of(options).url, recover=False)) as store:
            name = options.out.stem
            dataset = store.datasets.add(whole, name, findings).id
            try:
                stored = store.monitors.add(monitor, name, dataset).id
            except BaseException:
                store.datasets.delete(dataset)
                raise
        facts |= {"dataset_id": dataset, "id": stored}
        lines.append(f"stored: dataset {dataset} and monitor {stored}")
    print_result(options, "\n".join(lines), facts)
    return 0


def method_lines(monitor: Monitor) -> list[str]:
    """The methods tried, and which one the monitor uses."""
    methods = (monitor.evaluation or {}).get("methods", [])
    if not methods:
        return []
    rows = [
        f"  {_of(tried['missed'], tried['n_unsafe'])} failing flights missed, "
        f"{tried['quiet']} of {tried['n_safe']} safe ones without an alert: "
        f"{labels.TRIED.get(tried['name'], tried['name'])}{' (chosen)' * tried['chosen']}"
        for tried in methods
    ]
    return [
        "methods, on flights that chose nothing else, with 95 % intervals of the missed share:",
        *rows,
        f"  {kept_in_words(monitor.recipe.epsilon, methods[0]['n_unsafe'])}",
    ]


def _of(k: int, n: int) -> str:
    """`3 of 15 (4.3 to 48.1 %)`."""
    low, high = 100 * clopper_pearson(k, n)
    return f"{k} of {n} ({low:.1f} to {high:.1f} %)"


def summary(training: Training) -> dict[str, Any]:
    """The facts of `report` as plain data; times [s]."""
    monitor, dataset = training.monitor, training.dataset
    return {
        "dataset": {
            "n_unsafe": len(dataset.unsafe),
            "n_safe_met": dataset.n_safe_met,
            "unsafe_rate": dataset.unsafe_rate,
            "recipe": dataset.recipe,
        },
        "smallest_epsilon": monitor.smallest_epsilon,
        "validity": "calibrated" if monitor.support else training.not_calibrated,
    } | promise(monitor)


def promise(monitor: Monitor) -> dict[str, Any]:
    """The promise of a monitor and its test as plain data; times [s]."""
    return {
        "n_early": monitor.n_early,
        "lead": monitor.lead,
        "epsilon": monitor.recipe.epsilon,
        "guarantee": monitor.recipe.guarantee,
        "alert_above": monitor.alert_above(),
        "evaluation": monitor.evaluation,
        "warnings": list(warnings_of(monitor.evaluation, monitor.recipe.epsilon)),
    }


def report(training: Training) -> str:
    monitor, test = training.monitor, training.test
    lines = [
        _dataset_line(training.dataset),
        f"calibrated on {counted(len(monitor.alphas), 'failure')}{_group_sizes(monitor)}; "
        f"{monitor.n_early} "
        f"failed earlier than the warning lead time of {monitor.lead:g} s; smallest epsilon "
        f"{monitor.smallest_epsilon:.3g}",
        *filter(None, [calibrated_on(monitor.evaluation)]),
        _validity_line(training),
        *promise_lines(monitor, test),
    ]
    return "\n".join(lines)


def promise_lines(monitor: Monitor, test: FlownTest | None) -> list[str]:
    """The promise of a monitor, its results on fresh flights, and its warnings for a person."""
    recipe = monitor.recipe
    return [
        f"alerts above a risk of {monitor.alert_above():.3g}, for a miss rate of at most "
        f"{recipe.epsilon:g} {PROMISED[recipe.guarantee]}",
        *(test_lines(test, monitor.lead) if test else []),
        *(f"WARNING: {text}" for text in warnings_of(monitor.evaluation, recipe.epsilon)),
    ]


def _dataset_line(dataset: Dataset) -> str:
    recipe = dataset.recipe
    if simulated_test(recipe) is None:
        n_unsafe, n_safe = len(dataset.unsafe), len(dataset.safe)
        return f"trained on {n_unsafe} failing and {n_safe} safe flights"
    parts = ("aircraft", "control_law", "maneuver", "pilot")
    chosen = (recipe[part] for part in parts if part in recipe)
    kinds = (f"{each['kind']} {each.get('model', '')}".rstrip() for each in chosen)
    plan = recipe.get("simulator") or ", ".join(kinds)
    return (
        f"simulated {len(dataset.unsafe)} unsafe and {dataset.n_safe_met} safe rollouts "
        f"(unsafe rate {100 * dataset.unsafe_rate:.2g} %) of {plan}"
    )


def _validity_line(training: Training) -> str:
    support = training.monitor.support
    if support is None:
        return training.not_calibrated
    return (
        f"validity calibrated on {len(support.safe)} safe and {len(support.unsafe)} failing fresh "
        f"flights: at most {100 * support.level:.2g} % of each are called invalid"
    )


def _group_sizes(monitor: Monitor) -> str:
    """Failures of each group; empty without groups."""
    groups = monitor.groups
    return "" if groups is None else f" ({groups.n_unsafe} in each of {len(groups.alphas)} groups)"


def test_lines(test: FlownTest, lead: float) -> list[str]:
    """The results on fresh flights for a person.   lead: the required warning lead time [s]."""
    counts = test.at_epsilon
    caught = int(counts.caught[0])
    return [
        f"fresh flights: {counts.n_unsafe} failed, {counts.n_safe} did not; at epsilon "
        f"{test.epsilon:g}:",
        _share("missed", counts.misses[0], counts.n_unsafe, "of failing flights"),
        *_invalid(
            int(counts.withdrawn[0]),
            counts.n_unsafe,
            "of failing flights, before an alert: counted neither as missed nor as caught",
        ),
        _share(
            "no false alarm", counts.quiet[0], counts.n_safe, "of safe flights, valid throughout"
        ),
        _share("false alarm", counts.false_alerts[0], counts.n_safe, "of safe flights"),
        *_invalid(
            int(counts.safe_withdrawn[0]), counts.n_safe, "of safe flights, without an alert"
        ),
        _share("P(fail | alert)", caught, caught + counts.false_alerts[0], "of alerts"),
        _lead_line(test.leads, lead),
        "  its certificate also has prevention, robustness and groups: forewarn certificate FILE",
    ]


def _invalid(withdrawn: int, total: int, where: str) -> list[str]:
    return [_share("invalid", withdrawn, total, where)] if withdrawn else []


def _share(label: str, count: int, total: int, whole: str) -> str:
    if total == 0:
        return f"  {label:18} none to count"
    low, high = clopper_pearson(count, total)
    return f"  {label:18} {count / total:6.1%} [{low:.1%}, {high:.1%}] {whole}"


def _lead_line(lead: np.ndarray, required: float) -> str:
    warned = lead[np.isfinite(lead)]
    if not len(warned):
        return "  warning lead time  no failing flight had an alert"
    low, middle, high = np.quantile(warned, [0.05, 0.5, 0.95])
    return (
        f"  warning lead time  median {middle:.2f} s, 5-95 % {low:.2f} to {high:.2f} s; "
        f"at least {required:g} s on {np.mean(lead >= required - 1e-9):.0%} of failing flights"
    )
