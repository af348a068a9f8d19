"""A live source through a monitor: the batch's bits, manoeuvres detected, each with its trim."""

import numpy as np
import numpy.typing as npt
import pytest

from app.assessment.grid import IntegratedAngles, Sample
from app.assessment.scorer import CausalScorer, LiveAssessed
from app.assessment.trim import BEYOND
from core.channels import KEYS, LATERAL
from core.monitor import State
from core.monitor.assessment import Cause
from core.simulation.attitude import DisplayAttitude
from core.types import Array
from tests.support import attas
from tests.support.flying import EPSILON, T, exact_monitor, failing_flight
from tests.support.oscillator import DT

NY = KEYS.index("Ny")
CONTROLS = LATERAL.of_role("control")
TRIM = np.array([0.01, -0.02, 0.005, 0.03, 0.02, -0.04])


def assessed(scorer: CausalScorer, t: npt.NDArray, y: Array) -> list[LiveAssessed]:
    said = []
    for when, row in zip(t.tolist(), y, strict=True):
        said += scorer.push(when, Sample(when, row))
    return said


def test_a_source_on_the_monitors_times_without_trim_has_the_bits_of_the_batch() -> None:
    monitor, y = exact_monitor(), failing_flight()
    said = assessed(CausalScorer(monitor, EPSILON, trim="none"), T, y)
    batch = monitor.assess(T, y, EPSILON)
    assert [one.assessment.p_value for one in said] == [batch[k].p_value for k in range(len(T))]
    assert [one.assessment.state for one in said] == [batch[k].state for k in range(len(T))]


def test_the_delay_is_subtracted_from_the_lead_and_must_leave_some() -> None:
    scorer = CausalScorer(exact_monitor(), EPSILON, trim="none")
    assert scorer.lead == pytest.approx(exact_monitor().lead - 1.5 * DT)
    with pytest.raises(ValueError, match="subtracted from the lead"):
        CausalScorer(exact_monitor(), EPSILON, delay=exact_monitor().lead)


def test_missing_channels_are_named() -> None:
    y = failing_flight().copy()
    y[20:, [0, 3]] = np.nan
    said = assessed(CausalScorer(exact_monitor(), EPSILON, trim="none"), T, y)
    assert said[30].assessment.p_value is None
    assert said[30].assessment.reason.startswith("beta")
    assert said[30].assessment.reason.endswith("missing")


def test_missing_channels_are_named_at_rest_as_well() -> None:
    t, flown = flights(1)
    y = flown[0][:50].copy()
    y[45:, 1] = np.nan
    said = assessed(CausalScorer(attas.trained(), 0.1), t[:50], y)
    assert said[44].assessment.state is State.WARMING_UP
    assert (said[45].assessment.state, said[45].assessment.reason) == ("invalid", "p is missing")


def flights(n: int = 40) -> tuple[Array, Array]:
    """Test flights of the real recipe with a trim, and their times."""
    rollouts = attas.fly(n, seed=5)
    return np.arange(rollouts.y.shape[1]) * attas.TEST.dt, rollouts.y + TRIM


def test_a_manoeuvre_is_detected_soon_after_its_first_departure_and_never_at_rest() -> None:
    monitor = attas.trained()
    t, flown = flights()
    late = []
    for y in flown:
        said = assessed(CausalScorer(monitor, 0.1), t, y)
        begins = next(k for k, one in enumerate(said) if one.manoeuvre)
        moved = np.abs(y[:, CONTROLS] - TRIM[[*CONTROLS]]).max(axis=1)
        onset = int((moved > 0.2 * moved.max()).argmax())
        late.append((begins - onset) * attas.TEST.dt)
        assert {one.assessment.state for one in said[:begins]} == {State.WARMING_UP}
        causes = dict.fromkeys(one.assessment.cause for one in said[: begins + 1])
        assert [*causes] == [Cause.REST, Cause.READY, None]
        assert said[begins].assessment.state is State.OK
    assert max(late) <= 0.1
    assert min(late) >= -0.5


def test_trim_is_that_of_the_rest_before_and_risk_is_that_of_the_offline_trim() -> None:
    monitor = attas.trained()
    t, flown = flights(10)
    for y in flown:
        said = assessed(CausalScorer(monitor, 0.1), t, y)
        first = next(k for k, one in enumerate(said) if one.manoeuvre)
        assert np.abs((y[first] - said[first].y) - TRIM).max() < 0.01
        known = [one for one in said if one.assessment.p_value is not None]
        offline = monitor.assess(t, y - (y[first] - said[first].y), 0.1, withdraw=False)
        online = {one.assessment.t: one.assessment.p_value for one in known}
        twins = [(online[at], offline[k].p_value) for k, at in enumerate(t) if at in online]
        assert len(twins) > 50
        assert all(a == b for a, b in twins)


def test_somebody_can_say_that_a_manoeuvre_begins() -> None:
    monitor = attas.trained()
    t, flown = flights(1)
    scorer = CausalScorer(monitor, 0.1)
    at_rest = assessed(scorer, t[:50], flown[0][:50])
    assert at_rest[-1].manoeuvre == 0
    assert scorer.begin()
    assert not scorer.begin()
    said = assessed(scorer, t[50:60], flown[0][50:60])
    assert said[0].manoeuvre == 1
    assert said[0].assessment.p_value is not None


def test_the_next_manoeuvre_has_its_own_trim_and_number() -> None:
    monitor = attas.trained()
    flown = flights(2)[1]
    second = flown[1] + 0.5 * TRIM
    between = np.linspace(flown[0, -1], second[0], 400)
    both = np.concatenate([flown[0], between, second])
    said = assessed(CausalScorer(monitor, 0.1), np.arange(len(both)) * attas.TEST.dt, both)
    assert {one.manoeuvre for one in said} == {0, 1, 2}
    begins = next(k for k, one in enumerate(said) if one.manoeuvre == 2)
    trim = both[begins] - said[begins].y
    assert np.abs(trim - 1.5 * TRIM)[KEYS.index("delta_r")] < 0.01


def test_an_attitude_without_bank_or_pitch_is_integrated_and_a_missing_heading_stays_unknown() -> (
    None
):
    said = assessed(CausalScorer(exact_monitor(), EPSILON, trim="none"), T, failing_flight())[0]
    display = DisplayAttitude(theta0=0.1)
    integrated = said.shown_attitude(display)
    assert isinstance(integrated, IntegratedAngles)
    assert integrated == (0.0, 0.1, 0.0)
    received = said._replace(attitude=(0.2, 0.3, np.nan)).shown_attitude(display)
    assert not isinstance(received, IntegratedAngles)
    np.testing.assert_array_equal(received, (0.2, 0.3, np.nan))


def test_no_exceedance_from_trim_is_claimed_while_the_trim_is_unknown() -> None:
    scorer, n = CausalScorer(attas.trained(), 0.1), 100
    y = np.zeros((n, 6))
    y[:, NY] = 0.6
    t = np.arange(n) * attas.TEST.dt
    said = assessed(scorer, t, y)
    assert np.isnan([one.judged[NY] for one in said]).all()
    assert [one.y[NY] for one in said] == [0.6] * n  # shown as recorded
    assert said[-1].assessment.reason == BEYOND
    received = scorer.pop_exceedances()
    assert len(received) == n
    assert all(np.isnan(one.y[NY]) for one in received)


def test_a_steady_exceedance_goes_on_until_it_ends() -> None:
    scorer, n = CausalScorer(attas.trained(), 0.1), 300
    y = np.zeros((n, 6))
    y[60:260, NY] = 0.6
    said = assessed(scorer, np.arange(n) * attas.TEST.dt, y)
    assert [one.judged[NY] for one in said[60:]] == [0.6] * 200 + [0.0] * 40
    assert [round(one.t / attas.TEST.dt) for one in scorer.pop_exceedances()] == [*range(60, 260)]
