"""A clearance and the monitor of its point as one rule: its promise, and where there is none."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.clearance import with_monitor as module
from core.clearance.clearance import (
    Clearance,
    ClearanceError,
    ClearanceRecipe,
    calibrate,
)
from core.clearance.with_monitor import N_UNSAFE, WithMonitor, with_monitor
from core.evaluation.lead_sweep import TESTS
from core.monitor.calibration import alert_above
from core.simulation.maneuver import FrequencySweep
from tests.support.build_up import build_up

RECIPE = ClearanceRecipe(epsilon=0.1, n_exceeding=50, n_aircraft=150, n_draws=32, seed=3)


@pytest.fixture(scope="module")
def clearance() -> Clearance:
    """For the full doublet of an ATTAS after a step of 60 %."""
    return calibrate(build_up(TESTS["ATTAS"], (0.6,)), RECIPE)


@given(
    counts=st.lists(st.integers(0, N_UNSAFE + 1), min_size=59, max_size=200),
    epsilon=st.sampled_from([0.05, 0.1, 0.2, 0.5]),
    guarantee=st.sampled_from(["average", "95%"]),
)
def test_the_epsilon_is_the_largest_that_keeps_the_promise(counts, epsilon, guarantee) -> None:
    """A new point takes part in the rank; one more step of the p-values would break it."""
    risks = np.array(counts) / (N_UNSAFE + 1)
    recipe = ClearanceRecipe(epsilon=epsilon, guarantee=guarantee)
    most = alert_above(epsilon, len(risks), guarantee)

    def unwarned(above: float) -> float:
        return (1 + np.count_nonzero(risks <= above)) / (len(risks) + 1)

    try:
        kept = WithMonitor(recipe, risks).epsilon
    except ClearanceError:
        assert unwarned(1.5 / (N_UNSAFE + 1)) > most + 1e-9
        return
    assert unwarned(kept) <= most + 1e-9 < unwarned(kept + 1 / (N_UNSAFE + 1))


def test_points_are_cleared_and_watched_as_in_a_campaign(
    clearance: Clearance, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Refused points count as no miss; the others have a p-value of their own monitor."""
    monkeypatch.setattr(module, "N_POINTS", 24)
    steps = []
    together = with_monitor(clearance, lambda done, total: steps.append((done, total)))
    refused = np.count_nonzero(together.risks == 1.0)
    assert 4 <= refused <= 20
    watched = together.risks[together.risks < 1.0] * (N_UNSAFE + 1)
    np.testing.assert_allclose(watched, np.round(watched), atol=1e-9)
    assert np.median(watched) > 0.2 * N_UNSAFE
    assert steps[-1] == (len(steps), len(steps))
    assert len(watched) <= len(steps)


def test_no_rule_without_p_values_steps_or_limits(clearance: Clearance) -> None:
    rare = replace(clearance, exceeding=0.1 * clearance.exceeding)
    with pytest.raises(ClearanceError, match="too few"):
        with_monitor(rare)
    following = replace(clearance.points.following, maneuver=FrequencySweep())
    other = replace(clearance, points=replace(clearance.points, following=following))
    with pytest.raises(ClearanceError, match="steps"):
        with_monitor(other)
