"""Every method keeps its guarantee, on every plant, at every lead, with either guarantee.

A seed that no figure was chosen with. A monitor of N failures that alerts above j / (N + 1)
misses a share distributed as Beta(j, N + 1 - j) over calibration sets (Vovk, ACML 2012), and more
seldom where failures come before its lead.
"""

from functools import cache
from itertools import product
from typing import Literal

import numpy as np
import pytest
from scipy.stats import betabinom

from core.evaluation.lead_sweep import METHODS, TESTS, PlannedTestSweep, SweepRecipe, sweep
from core.monitor.calibration import Guarantee, confident_rank

pytestmark = pytest.mark.fuzz
Imperfections = Literal["none", "usual"]
EPSILON, N_UNSAFE, N_MONITORS, LEADS = 0.05, 200, 6, (0.25, 0.5, 0.75, 1.0)
RANKS: dict[Guarantee, int] = {
    "average": int(EPSILON * (N_UNSAFE + 1)),
    "95%": confident_rank(EPSILON, N_UNSAFE),
}
LEADS_OF: dict[Guarantee, tuple[float, ...]] = {"average": LEADS, "95%": (0.5,)}
"""The guarantee only moves the threshold on the same scores, which the last test shows: the
stricter one need not be repeated at every lead."""
CASES: list[tuple[Imperfections, Guarantee]] = [*product(("none", "usual"), RANKS)]


@cache
def swept(imperfections: Imperfections, guarantee: Guarantee) -> dict[str, PlannedTestSweep]:
    """Every method on every plant at each lead of the guarantee; reactions do not matter."""
    return sweep(
        SweepRecipe(
            imperfections=imperfections,
            leads_s=LEADS_OF[guarantee],
            epsilon=EPSILON,
            guarantee=guarantee,
            n_unsafe=N_UNSAFE,
            n_monitors=N_MONITORS,
            n_test=500,
            reactions_s=(0.5,),
            seed=20_261,
        )
    )


@pytest.mark.parametrize(("imperfections", "guarantee"), CASES)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("plant", TESTS)
def test_misses_do_not_exceed_epsilon(
    plant: str, method: str, imperfections: Imperfections, guarantee: Guarantee
) -> None:
    """On average over monitors, at each lead: within three standard errors."""
    j = RANKS[guarantee]
    promised = j / (N_UNSAFE + 1)
    for lead in LEADS_OF[guarantee]:
        cell = swept(imperfections, guarantee)[plant].cells[method, lead]
        law = betabinom(cell.n_unsafe, j, N_UNSAFE + 1 - j)
        error = np.sqrt(law.var().sum()) / cell.n_unsafe.sum()
        assert cell.miss_rate <= promised + 3 * error, (lead, cell.misses, cell.n_unsafe)


@pytest.mark.parametrize(("imperfections", "guarantee"), CASES)
@pytest.mark.parametrize("method", METHODS)
def test_few_monitors_miss_more_than_the_law_allows(
    method: str, imperfections: Imperfections, guarantee: Guarantee
) -> None:
    """One monitor in twenty lies beyond the law's 95 % quantile."""
    j, beyond = RANKS[guarantee], []
    for plant in swept(imperfections, guarantee).values():
        # Monitors of several leads come from the same failures: one lead of each is enough.
        cell = plant.cells[method, 0.5]
        law = betabinom(cell.n_unsafe, j, N_UNSAFE + 1 - j)
        beyond += (law.sf(cell.misses - 1) < 0.05).tolist()
    n = len(beyond)
    assert np.mean(beyond) <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / n)


@pytest.mark.parametrize("imperfections", ["none", "usual"])
@pytest.mark.parametrize("plant", TESTS)
def test_the_guarantee_for_each_monitor_costs_more_false_alarms(
    plant: str, imperfections: Imperfections
) -> None:
    """Monitor by monitor: the same failures, flights and scores, and a lower threshold."""
    for method in METHODS:
        for lead in LEADS_OF["95%"]:
            average, each = (swept(imperfections, of)[plant].cells[method, lead] for of in RANKS)
            assert (each.misses <= average.misses).all()
            assert (each.false_alerts >= average.false_alerts).all()
            assert (each.n_unsafe == average.n_unsafe).all()
