"""The lead-time study: same counts as monitors trained and tested one by one."""

from dataclasses import replace

import numpy as np
import pytest

from core.evaluation import lead_sweep
from core.evaluation.baselines import BASELINES, evaluate_baseline
from core.evaluation.lead_sweep import (
    CEILING,
    METHODS,
    TESTS,
    PlannedTestSweep,
    SweepRecipe,
    sweep,
)
from core.evaluation.prevention import prevention
from core.evaluation.rates import evaluate, first_alerts
from core.monitor import MonitorRecipe, train
from core.planned_test.collection import (
    card_of,
    collect,
    combination_failures,
    evaluation_flights,
    stopping_flights,
)
from core.planned_test.near import near_failures, near_rollouts
from core.seeds import Branch, monitor_seeds, stream
from core.simulation.maneuver import FrequencySweep

SMALL = SweepRecipe(
    tests=("F-16",),
    leads_s=(0.25, 1.3),
    methods=("linear + nearest neighbor", "test card: rest"),
    epsilon=0.1,
    n_unsafe=30,
    n_monitors=2,
    n_test=80,
)


@pytest.fixture(scope="module")
def small() -> PlannedTestSweep:
    return sweep(SMALL)["F-16"]


def test_a_cell_counts_what_each_monitor_alone_does(small: PlannedTestSweep) -> None:
    for name in SMALL.methods:
        predictor, score = METHODS[name]
        recipe = MonitorRecipe(t_early=0.25, epsilon=0.1, predictor=predictor, score=score)
        cell = small.cells[name, 0.25]
        for number, (seed, _) in enumerate(monitor_seeds(SMALL.seed, SMALL.n_monitors)):
            test = replace(TESTS["F-16"], seed=seed, n_unsafe=SMALL.n_unsafe)
            failures, _ = combination_failures(test, SMALL.n_unsafe, branch=Branch.ENSEMBLE)
            monitor = train(collect(test), recipe, card=card_of(test), failures=failures)
            flights = evaluation_flights(test, SMALL.n_test)
            alone = evaluate(monitor, flights.y, flights.fail_index, np.array([0.1]))
            assert cell.misses[number] == alone.misses[0]
            assert cell.false_alerts[number] == alone.false_alerts[0]
            assert (cell.n_unsafe[number], cell.n_safe[number]) == (alone.n_unsafe, alone.n_safe)
        assert cell.prevented.shape == (2, len(SMALL.reactions_s))
        assert (np.diff(cell.prevented_share) <= 0).all()


def test_rules_of_others_are_counted_at_each_lead() -> None:
    recipe = replace(SMALL, methods=tuple(BASELINES), leads_s=(0.25, 0.5))
    cells = sweep(recipe)["F-16"].cells
    assert cells.keys() == {(name, lead) for name in BASELINES for lead in recipe.leads_s}
    for (name, lead), cell in cells.items():
        settings = MonitorRecipe(t_early=lead)
        for number, (seed, _) in enumerate(monitor_seeds(SMALL.seed, SMALL.n_monitors)):
            test = replace(TESTS["F-16"], seed=seed, n_unsafe=SMALL.n_unsafe)
            flights, at = evaluation_flights(test, SMALL.n_test), np.array([0.1])
            alone = evaluate_baseline(BASELINES[name], collect(test), flights, settings, at)
            assert cell.misses[number] == alone.misses[0]
            assert cell.false_alerts[number] == alone.false_alerts[0]


def test_sharing_work_between_methods_changes_no_count() -> None:
    names = tuple(name for name, (predictor, _) in METHODS.items() if predictor.forecast)
    recipe = replace(SMALL, methods=names, leads_s=(0.25, 0.6), n_monitors=1)
    test = replace(TESTS["F-16"].as_flown(), seed=monitor_seeds(0, 1)[0][0], n_unsafe=30)
    dataset, flights = collect(test), evaluation_flights(test, recipe.n_test)
    failures, _ = combination_failures(test, 30, branch=Branch.ENSEMBLE)
    near, rollouts = near_failures(test, 30), near_rollouts(test)
    y, fails, n_samples = flights.y, flights.fail_index, flights.y.shape[1]
    cells = sweep(recipe, {"flown": test})["flown"].cells
    assert list(cells) == [(name, lead) for lead in recipe.leads_s for name in names]
    for (name, lead), cell in cells.items():
        predictor, score = METHODS[name]
        own = MonitorRecipe(t_early=lead, epsilon=0.1, predictor=predictor, score=score)
        monitor = train(
            dataset,
            own,
            card=card_of(test),
            rollouts=rollouts if own.is_near else None,
            failures=failures,
            near=near if own.is_near else (),
        )
        alone = evaluate(monitor, y, fails, np.array([0.1]))
        assert (cell.misses[0], cell.false_alerts[0]) == (alone.misses[0], alone.false_alerts[0])
        first = first_alerts(monitor, y, fails)
        again = stopping_flights(test, recipe.n_test)
        rng = stream(test.seed, Branch.REACTION)
        first[~flights.is_unsafe] = n_samples
        reacted = prevention(first, fails, n_samples, 0.05, again, rng)
        assert cell.prevented[0].tolist() == reacted.prevented.tolist()
        level = lead_sweep._level_of_false_alarms(
            monitor.lowest_scores(y, np.full(len(y), n_samples - 1))[~flights.is_unsafe]
        )
        first = lead_sweep._first_alerts(monitor, flights, level)
        alike = prevention(first, fails, n_samples, 0.05, again, stream(test.seed, Branch.REACTION))
        assert cell.prevented_alike[0].tolist() == alike.prevented.tolist()
    rest = [cell.prevented_alike.tolist() for (name, _), cell in cells.items() if "rest" in name]
    assert rest[:2] == rest[2:], "what is alerted of alike does not depend on the lead"


def test_no_method_has_power_if_failures_come_before_the_lead(small: PlannedTestSweep) -> None:
    assert 0.8 < small.earliest_s < 1.3
    cells = [cell for (_, lead), cell in small.cells.items() if lead == 1.3]
    assert len(cells) == 2
    assert max(cell.power for cell in cells) < 0.2 < small.cells[SMALL.methods[1], 0.25].power


def test_power_at_a_share_of_misses_by_hand() -> None:
    lowest = np.array([0.1, 0.3, 0.2, 0.9, 0.25, 0.05, 0.5])
    is_unsafe = np.array([True, True, True, True, False, False, False])
    assert lead_sweep._power_at(0.25, lowest, is_unsafe) == pytest.approx(1 / 3)
    assert lead_sweep._power_at(0.5, lowest, is_unsafe) == pytest.approx(2 / 3)
    assert lead_sweep._power_at(0.01, lowest, is_unsafe) == 0.0
    assert np.isnan(lead_sweep._power_at(0.1, lowest[:4], is_unsafe[:4]))


def test_at_most_a_tenth_of_safe_flights_alerts_by_hand() -> None:
    safe = np.arange(20.0)[::-1]
    level = lead_sweep._level_of_false_alarms(safe)
    assert np.count_nonzero(safe <= level) == 2
    assert np.count_nonzero(np.zeros(20) <= lead_sweep._level_of_false_alarms(np.zeros(20))) == 0


def test_a_manoeuvre_without_a_card_omits_methods_that_need_one() -> None:
    test = replace(TESTS["F-16"], maneuver=FrequencySweep(amplitude_deg=9.5))
    results = sweep(replace(SMALL, n_monitors=1, leads_s=(0.25,)), {"own": test})
    assert list(results["own"].cells) == [("linear + nearest neighbor", 0.25)]


def test_it_repeats_for_a_seed_and_reports_progress(small: PlannedTestSweep) -> None:
    calls: list[tuple[int, int]] = []
    again = sweep(SMALL, progress=lambda *done: calls.append(done))["F-16"]
    assert calls == [(4, 8), (8, 8)]
    for key, cell in small.cells.items():
        assert (cell.misses == again.cells[key].misses).all()
        assert (cell.prevented == again.cells[key].prevented).all()


def test_an_exception_in_progress_cancels() -> None:
    def cancel(*_: int) -> None:
        raise InterruptedError

    with pytest.raises(InterruptedError):
        sweep(replace(SMALL, leads_s=(0.25,)), progress=cancel)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"methods": ("fortune",)}, "method 'fortune' was given: choose linear"),
        ({"tests": ("F-15",)}, "planned test 'F-15' was given: choose F-16"),
        ({"leads_s": ()}, "leads_s"),
        ({"leads_s": (0.0,)}, "give at least one time above 0 s"),
        ({"reactions_s": (float("nan"),)}, "reactions_s"),
        ({"epsilon": 0.01}, "needs at least 99 unsafe rollouts"),
        ({"n_monitors": 0}, "n_monitors"),
    ],
)
def test_impossible_sweeps_are_refused(wrong: dict, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(SMALL, **wrong)


def test_a_lead_as_long_as_the_manoeuvre_is_refused_before_any_flight() -> None:
    with pytest.raises(ValueError, match="the manoeuvre of F-16 lasts 6 s, choose shorter warning"):
        sweep(replace(SMALL, leads_s=(0.25, 6.0)))


def test_the_information_limit_misses_exactly_epsilon_at_each_lead(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(lead_sweep, "CEILING_FLIGHTS", 30)
    monkeypatch.setattr(lead_sweep, "CEILING_POOL", 100)
    recipe = replace(SMALL, tests=("ATTAS",), n_monitors=1, ceiling=True, methods=SMALL.methods[:1])
    calls: list[tuple[int, int]] = []
    cells = sweep(recipe, progress=lambda *done: calls.append(done))["ATTAS"].cells
    names = SMALL.methods[0], CEILING
    assert list(cells) == [(name, lead) for lead in recipe.leads_s for name in names]
    assert sorted(calls)[-1] == (4, 4)
    near, far = (cells[CEILING, lead] for lead in recipe.leads_s)
    assert near.n_unsafe[0] == near.n_safe[0] == 15
    assert near.misses[0] == far.misses[0] == 1
    assert near.power == near.power_at_epsilon[0] >= far.power
    assert near.power > 0.8
    assert (np.diff(far.prevented_share) <= 0).all()
    assert far.prevented_share[0] > 0.8


def test_an_information_limit_with_imperfections_is_refused() -> None:
    with pytest.raises(ValueError, match="limit needs imperfections none"):
        replace(SMALL, ceiling=True, imperfections="usual")
