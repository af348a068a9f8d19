"""A recording as the flight of a monitor: by which limits it is judged."""

import numpy as np
import pytest

from app.assessment import Interval, MissingChannels, ScoringRecipe, score
from app.assessment.limits_history import LimitsHistory
from app.assessment.rulings import LimitsInForce
from app.telemetry.recording import Trace, Traces
from app.telemetry.timing.repair import repair
from core.channels import Dictionary, channel
from core.dataset import Dataset
from core.limits.limit_sets import LimitCase, LimitSet
from core.limits.limits import IntervalLimits, Limits
from core.monitor import train
from tests.support import short_period
from tests.support.short_period import DT, LIMITS

NOISE = channel("a", "a", "rad", "noise"), channel("b", "b", "rad", "noise")
LATERAL_SET = LimitSet((LimitCase("any", {}, Limits(Ny=0.1)),))
IN_FORCE = LimitsInForce(1, "1", "lateral", 1, {}, 0, 0.0, "", "", LATERAL_SET, ("",))


@pytest.mark.parametrize("more", [(), NOISE], ids=["4 channels", "6, as many as lateral ones"])
def test_a_limit_set_does_not_judge_channels_that_it_does_not_know(more: tuple) -> None:
    rng = np.random.default_rng(3)
    dictionary = Dictionary("own", (*more, *short_period.DICTIONARY.channels))
    y = short_period.with_channels(short_period.fly(rng, 200)[1], len(dictionary), rng)
    limits = IntervalLimits(dictionary, LIMITS.intervals)
    monitor = train(Dataset.from_rollouts(y, dt=DT, channels=dictionary, limits=limits))
    t = DT * np.arange(y.shape[1])
    columns = zip(dictionary.keys, np.ascontiguousarray(y[0].T), strict=True)
    traces = repair(Traces({key: Trace(t, column) for key, column in columns}))
    recipe = ScoringRecipe(manoeuvres=(Interval(0.0, float(t[-1])),))
    alone = score(monitor, traces, recipe)
    scored = score(monitor, traces, recipe, LimitsHistory((IN_FORCE,), {}))
    assert scored.limits_in_force is None
    assert [m.exceedance for m in scored.manoeuvres] == [m.exceedance for m in alone.manoeuvres]
    (note,) = set(scored.notes) - set(alone.notes)
    assert "Limit sets know only beta, p, r" in note


def test_a_mapped_channel_without_a_value_is_told_from_one_that_is_not_mapped() -> None:
    why = "no sample's status is normal operation"
    empty = Trace(np.zeros(2), np.full(2, np.nan), source="word", why_missing=why)
    assert f"word has no value, since {why}" in str(MissingChannels(["Ny"], (), [empty]))
    assert "no value" not in str(MissingChannels(["Ny"]))
