"""Switches within and between manoeuvres: a fresh history, the same trim, no lost beginning."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from app.assessment import score
from app.assessment.grid import Sample
from app.assessment.limits_history import ConditionSeries, SetHistory
from app.assessment.monitors_in_use import MonitorsInUse
from app.assessment.scorer import CausalScorer, LiveAssessed, TrimRule
from app.telemetry.timing.repair import repair
from core.monitor import Monitor, State
from core.monitor.assessment import Cause
from core.monitor.monitor_set import MonitorCase, MonitorSet
from core.types import Array
from tests.core.monitor import test_peak_ridge, test_response_filter
from tests.support import attas

SLOW, FAST = 0.6, 0.9


def in_use(slow: Monitor, fast: Monitor) -> MonitorsInUse:
    cases = (
        MonitorCase("slow", {"mach": (None, 0.8)}, slow),
        MonitorCase("fast", {"mach": (0.8, None)}, fast),
    )
    return MonitorsInUse("s", "doublet", MonitorSet(cases), ("a", "b"), ("a", "b"), {})


def flown(
    monitors: Sequence[Monitor], y: Array, mach: Callable[[int], float], trim: TrimRule
) -> list[LiveAssessed]:
    """One monitor alone, or the first two of a set by the Mach number of each sample."""
    first, dt = monitors[0], monitors[0].dt
    used = in_use(*monitors) if len(monitors) > 1 else None
    scorer = CausalScorer(first, first.recipe.epsilon, trim=trim, monitors=used)
    said = []
    for k, row in enumerate(y):
        sample = Sample(k * dt, row, condition=(mach(k), None, None, None))
        said += scorer.push(k * dt, sample)
    return said


@cache
def two() -> tuple[Monitor, Monitor]:
    return attas.trained(), attas.trained(replace(attas.TEST, seed=9))


def test_a_switch_at_rest_changes_no_bit_of_the_manoeuvre_that_follows() -> None:
    slow, fast = two()
    y = attas.fly(3, seed=5).y[2] + 0.02
    alone = flown([fast], y, lambda _: FAST, "detected")
    begins = next(k for k, one in enumerate(alone) if one.manoeuvre)
    switch = begins - fast.recipe.n_delay - 2
    said = flown([slow, fast], y, lambda k: SLOW if k < switch else FAST, "detected")
    known = [one.assessment.p_value for one in alone]
    assert sum(value is not None for value in known) > 50
    assert [one.assessment.p_value for one in said] == known
    assert [one.y.tobytes() for one in said] == [one.y.tobytes() for one in alone]


@pytest.mark.parametrize("is_checked", [True, False])
def test_a_switch_within_a_manoeuvre_never_claims_what_was_not_seen(is_checked: bool) -> None:
    """A monitor that checks the input from its beginning is not applicable, others warm up."""
    slow, fast = two()
    fast = fast if is_checked else replace(fast, support=None)
    y = attas.fly(3, seed=5).y[2] + 0.02
    alone = flown([slow], y, lambda _: SLOW, "detected")
    begins = next(k for k, one in enumerate(alone) if one.manoeuvre)
    switch = begins + 10
    said = flown([slow, fast], y, lambda k: SLOW if k < switch else FAST, "detected")
    before = [one.assessment.p_value for one in said[:switch]]
    assert before == [one.assessment.p_value for one in alone[:switch]]
    filling = said[switch : switch + fast.recipe.n_delay]
    after = [one.assessment for one in said[switch:] if one.manoeuvre == 1]
    if is_checked:
        assert {(each.state, each.cause) for each in after} == {
            (State.INVALID, Cause.NOT_APPLICABLE)
        }
        assert "fast holds since" in after[0].reason
        return
    assert {one.assessment.state for one in filling} == {State.WARMING_UP}
    assert said[switch + fast.recipe.n_delay].assessment.state is State.OK


def test_a_forecast_of_the_rest_is_lost_where_the_beginning_was_not_seen() -> None:
    monitor, y = test_peak_ridge.trained(), test_response_filter.flights()[0]
    begins = test_peak_ridge.begin_of(monitor, y)
    for switch, state in ((begins + 10, State.INVALID), (2, State.OK)):
        said = flown([monitor, monitor], y, lambda k, at=switch: SLOW if k < at else FAST, "none")
        after = said[begins + 20].assessment
        assert after.state is state
        assert after.cause is (Cause.NOT_APPLICABLE if state is State.INVALID else None)
        assert np.isfinite(said[begins + 20].y).all()


@pytest.mark.parametrize("gap", [1, 10, 400])
def test_an_exceedance_without_a_monitor_in_use_lies_inside_its_manoeuvre(gap: int) -> None:
    """The stretch before it, cut short by the change, is neither quiet nor a false alert."""
    slow = attas.trained()
    cases = (MonitorCase("slow", {"mach": (None, 0.8)}, slow),)
    used = MonitorsInUse("s", "doublet", MonitorSet(cases), ("a",), ("a",), {})
    y = 0.5 * attas.fly(3, seed=5).y[2]
    (alone,) = attas.score(slow, attas.recorded(y)).manoeuvres
    assert alone.exceedance is None
    y[alone.first + 45, attas.KEYS.index("Ny")] = 0.3
    begin, t = alone.first + 45, slow.dt * np.arange(len(y), dtype=float)
    mach = np.full(len(y), SLOW)
    mach[begin : begin + gap] = 0.85
    history = SetHistory(used, {"mach": ConditionSeries(t, mach)})
    scored = score(slow, repair(attas.recorded(y)), history=history)
    before, without, *after = scored.manoeuvres
    assert (before.outcome, before.validity.valid) == ("cut", None)
    assert (without.outcome, without.monitor) == ("invalid", "")
    assert without.exceedance is not None
    assert without.start == without.exceedance.t == pytest.approx(t[begin])
    assert not np.isfinite(scored.samples[without.first : without.last + 1]["withdrawn"]).any()
    assert scored.outside_exceedances == ()
    assert all(part.exceedance is None for part in after)


def test_a_recording_without_any_monitor_in_use_is_still_checked_against_the_limits() -> None:
    slow, fast = two()
    y = 0.5 * attas.fly(3, seed=5).y[2]
    y[100, attas.KEYS.index("Ny")] = 0.3
    scored = score(slow, repair(attas.recorded(y)), history=SetHistory(in_use(slow, fast), {}))
    (manoeuvre,) = scored.manoeuvres
    assert manoeuvre.exceedance is not None
    assert manoeuvre.exceedance.t == pytest.approx(100 * slow.dt)
    assert (manoeuvre.outcome, manoeuvre.validity.valid) == ("invalid", False)
    assert any("mach" in note for note in scored.notes)
