"""A pilot in the loop: the crossover law, a twin in plain numpy, and who gives up."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest
from scipy.linalg import expm

from core.card import CardError
from core.clearance.clearance import ClearanceError
from core.evaluation.ceiling import Ceiling
from core.kernels.pilot import DELAY, GAIN, NOBODY
from core.limits.flight_limits import LoadLimits
from core.planned_test.collection import card_of
from core.planned_test.maneuver_simulator import Drawn, ManeuverSimulator
from core.planned_test.nonlinear_test import SIGHTS, NonlinearTest
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator, SensorNoise
from core.recipe import from_plain, to_plain
from core.simulation.aircraft import AIRCRAFT
from core.simulation.control_law import PHI_STATE, Actuator, closed_loops, measured_rows
from core.simulation.maneuver import MANEUVERS, Axis
from core.simulation.nonlinear import TrimCondition
from core.simulation.nonlinear_aircraft import NONLINEAR_AIRCRAFT
from core.simulation.pilot import PILOTS, TRIMS_RAD_S, Crossover, Intervention, Pilot
from tests.support.build_up import build_up

RECIPE = DatasetRecipe()
SURE = Crossover(
    gain_spread=0.0, delay_spread=0.0, lag_spread=0.0, remnant_deg=0.0, remnant_spread=0.0
)
"""All pilots alike, without noise."""
LIMITED = replace(
    RECIPE.control_law, actuator=Actuator(rate_limit_deg_s=60.0, position_limit_deg=20.0)
)
ANY_FLIGHT = LoadLimits(Nz_high=8.0)


def nominal_flight(simulator: ManeuverSimulator, n: int = 1) -> Drawn:
    """The planned commands on the nominal aircraft."""
    theta = np.repeat(simulator.parameters.nominal[np.newaxis], n, axis=0)
    commands = simulator.test.maneuver.pilot(simulator.dt, n, np.random.default_rng(0))
    crew = simulator.crew
    assert crew is not None
    pilots = crew.draw(n, commands.shape[1], simulator.dt, object(), np.random.default_rng(0))
    return Drawn(theta, commands, np.zeros(n, np.int64), (), pilots)


def lateral(aircraft: str = "f16_sl_h0_v502", maneuver: str = "bank_capture", **pilot: object):
    known = AIRCRAFT[aircraft]
    return LateralSimulator(
        replace(
            DatasetRecipe.usual(replace(known, n_states=4)),  # type: ignore[call-arg]
            maneuver=MANEUVERS[maneuver],
            pilot=replace(SURE, **pilot),  # type: ignore[arg-type]
        )
    )


PUBLISHED = [name for name in AIRCRAFT if name != "matrices"]


@pytest.mark.parametrize("axis", ["bank", "sideslip"])
@pytest.mark.parametrize("aircraft", PUBLISHED)
def test_pilot_and_aircraft_respond_like_the_crossover_law(aircraft: str, axis: Axis):
    """Y_p Y_c = K e^(-tau s) / s, in magnitude at K and, without its delay, in phase."""
    simulator = lateral(aircraft, f"{axis}_capture", axis=axis, crossover_rad_s=1.5)
    pilot = replace(SURE, crossover_rad_s=1.5)
    gain, lead, lag = pilot.tuned(lambda s: simulator._respond(axis, s))
    s = 1.5j
    law = (
        gain * (1 + TRIMS_RAD_S / s) * (1 + lead * s) / (1 + lag * s) * simulator._respond(axis, s)
    )
    assert abs(law) == pytest.approx(1.0)
    if max(lead, lag) < 1.15:  # within what a pilot can equalise
        assert np.degrees(np.angle(law)) == pytest.approx(-90.0, abs=0.1)


@pytest.mark.parametrize("frequency", [0.5, 1.0, 2.0, 4.0])
def test_the_discrete_pilot_has_the_frequency_response_of_its_transfer_function(frequency: float):
    """A Bode check: a target sine at a wing that does not move, by correlation."""
    dt, n = 0.05, 4001
    crew = lateral().crew
    assert crew is not None
    drawn = crew.draw(1, n, dt, object(), np.random.default_rng(0))
    lead, lag = crew.leads_s[0], crew.lags_s[0]
    arm, delay = drawn.own[0, :GAIN] * dt
    z = np.exp(1j * frequency * dt)
    derivative = (1 - 1 / z) / dt
    expected = (1 + lead * derivative) / (1 + lag * derivative) / (1 + arm * derivative)
    expected *= drawn.own[0, GAIN] * z ** (-delay / dt)
    expected *= 1 + TRIMS_RAD_S / derivative
    angle, still = frequency * dt * np.arange(n), np.zeros((n, 1))
    parts = (wave(angle)[:, np.newaxis] for wave in (np.cos, np.sin))
    real, imaginary = (twin(drawn, 0, part, still, dt)[:, 0] for part in parts)
    sine, commands = np.exp(1j * angle), real + 1j * imaginary
    # whole periods, less what was trimmed away at the begin
    period = round(2 * np.pi / frequency / dt)
    found = np.mean((commands - commands.mean())[-40 * period :] / sine[-40 * period :])
    assert found == pytest.approx(expected, rel=2e-2)
    s = 1j * frequency
    ideal = (1 + lead * s) / (1 + lag * s) / (1 + arm * s) * np.exp(-delay * s)
    ideal *= drawn.own[0, GAIN] * (1 + TRIMS_RAD_S / s)
    assert abs(expected / ideal - 1) < 0.08 * max(frequency, 1.0)


def twin(pilots, i: int, planned: np.ndarray, seen: np.ndarray, dt: float) -> np.ndarray:
    """The commands of pilot i in plain numpy, for outputs (n, n_axes) that are given."""
    n = len(planned)
    commands = planned.copy()
    arm, delay, *gains = pilots.own[i]
    for a, (surface, _, step, captures, lead, lag, trim) in enumerate(pilots.axes):
        angle = seen[:, a]
        if step:
            angle = np.concatenate([[0.0], np.cumsum(0.5 * step * (angle[1:] + angle[:-1]))])
        column = planned[:, int(surface)]
        error = (column if captures else 0.0) - angle - pilots.noise[i, a, :n]
        times = np.arange(n) - delay
        late = np.interp(times, np.arange(n), error)
        first = (times < 0.0) & (times > -1.0)
        late[times <= -1.0] = 0.0
        late[first] = (times[first] + 1.0) * error[0]  # from nothing, before the first sample
        led = moved = before = held = 0.0
        for k in range(n):
            led = (late[k] + lead * (late[k] - before) + lag * led) / (1.0 + lag)
            before = late[k]
            moved = (led + arm * moved) / (1.0 + arm)
            held += trim * moved
            base = 0.0 if captures else column[k]
            commands[k, int(surface)] = base + gains[a] * (moved + held)
    return commands


REPLAYED: dict[str, tuple[DatasetRecipe | NonlinearTest, tuple[int, ...]]] = {
    "linear, captures sideslip": (
        replace(RECIPE, maneuver=MANEUVERS["sideslip_capture"], pilot=Crossover()),
        (0, 1),
    ),
    "linear, holds bank, substeps, as flown": (
        replace(RECIPE.as_trained(), substeps=2, pilot=Crossover()),
        (1,),
    ),
    "linear with limits": (replace(RECIPE, control_law=LIMITED, pilot=Crossover()), (1,)),
    "nonlinear, captures pitch": (
        NonlinearTest(
            maneuver=MANEUVERS["pitch_capture"], pilot=Crossover(), specification=ANY_FLIGHT
        ),
        (2, 7),
    ),
    "nonlinear, holds alpha, as flown": (
        replace(
            NonlinearTest(maneuver=MANEUVERS["rudder_doublet"], specification=ANY_FLIGHT),
            pilot=Crossover(axis="alpha"),
            substeps=2,
        ).as_trained(),
        (0,),
    ),
}
"""Tests, and the outputs that each tracked axis is seen by."""


@pytest.mark.parametrize("name", REPLAYED)
def test_a_flight_repeats_with_the_commands_that_a_plain_pilot_gives_for_its_outputs(name: str):
    test, outputs = REPLAYED[name]
    simulator = test.simulator()
    drawn = simulator._drawn(20, np.random.default_rng(2))
    y = simulator.outputs(drawn)
    seen = (y - y[:, :1])[:, :: test.substeps, list(outputs)]
    width = 3 if isinstance(test, NonlinearTest) else 2
    planned = np.zeros((20, drawn.commands.shape[1], width))
    planned[..., : drawn.commands.shape[2]] = drawn.commands
    steered = [twin(drawn.in_loop, i, planned[i], seen[i], test.dt) for i in range(20)]
    again = simulator.outputs(drawn._replace(commands=np.array(steered), in_loop=NOBODY))
    assert np.abs(np.array(steered) - planned).max() > 1e-3  # the pilot does something
    np.testing.assert_allclose(again, y, atol=1e-9 * max(1.0, np.abs(y).max()))


def test_a_captured_bank_follows_the_closed_form():
    """Plant, law, actuators and pedals as one matrix exponential between the pilot's commands."""
    simulator = lateral()
    recipe, drawn = simulator.recipe, nominal_flight(simulator)
    nominal = simulator.plant.nominal_plant()
    (loop,), drive = closed_loops(nominal, simulator.controller, recipe.control_law.actuator)
    n, lag = len(loop), recipe.maneuver.pedal_lag_s
    whole = np.zeros((n + 4, n + 4))
    whole[:n, :n], whole[:n, n : n + 2] = loop, drive
    whole[n : n + 2, n:] = np.hstack([-np.eye(2), np.eye(2)]) / lag
    step = expm(recipe.dt * whole)
    z, bank = np.zeros(n + 4), []
    for k in range(recipe.maneuver.n_samples(recipe.dt)):
        bank.append(z[PHI_STATE])
        plan, seen = drawn.commands[0, : k + 1], np.array(bank)[:, np.newaxis]
        z[n + 2 :] = twin(drawn.in_loop, 0, plan, seen, recipe.dt)[-1]
        y = measured_rows(nominal)[0] @ z[: len(nominal.a[0]) + 2]
        np.testing.assert_allclose(simulator.outputs(drawn)[0, k], y[:6], atol=1e-10)
        z = step @ z
    assert np.degrees(max(bank)) == pytest.approx(30.0, rel=0.3)


@pytest.mark.parametrize("aircraft", NONLINEAR_AIRCRAFT)
@pytest.mark.parametrize(
    "maneuver", [name for name, maneuver in MANEUVERS.items() if maneuver.captured]
)
def test_a_nonlinear_aircraft_captures_its_target_and_keeps_its_bank(aircraft: str, maneuver: str):
    planned = replace(MANEUVERS[maneuver], hold_s=10.0, duration_s=8.0)  # type: ignore[call-arg]
    test = NonlinearTest(
        NONLINEAR_AIRCRAFT[aircraft], maneuver=planned, pilot=SURE, specification=ANY_FLIGHT
    )
    simulator = test.simulator()
    y = simulator.outputs(nominal_flight(simulator))[0]
    axis = planned.captured
    assert axis is not None
    target = radians(planned.peak_deg)
    seen = y[:, SIGHTS[axis].output] - y[0, SIGHTS[axis].output]
    if SIGHTS[axis].is_rate:
        seen = np.cumsum(seen) * test.dt
    np.testing.assert_allclose(seen[-40:].mean(), target, rtol=0.25)
    if axis != "bank":
        assert np.abs(np.degrees(y[:, SIGHTS["bank"].output])).max() < 15.0


def test_a_pilot_holds_the_bank_of_a_long_turn():
    def spread_of_bank(pilot: Pilot) -> float:
        turn = replace(MANEUVERS["wind_up_turn"], amplitude_deg=-2.0)
        test = NonlinearTest(
            condition=TrimCondition(load_factor=2.0), maneuver=turn, specification=ANY_FLIGHT
        ).as_flown()
        y = replace(test, pilot=pilot).simulator().rollouts(50, np.random.default_rng(1)).y
        return float(np.degrees(np.ptp(y[:, :, 7], axis=1)).mean())

    held, free = spread_of_bank(Crossover()), spread_of_bank(PILOTS["open_loop"])
    assert held < 0.6 * free


def test_open_loop_is_nobody_and_leaves_recipes_as_they_were():
    for test in (DatasetRecipe(), NonlinearTest()):
        plain = to_plain(test)
        assert "pilot" not in plain
        assert from_plain(test, plain) == test
        flown = replace(test, pilot=Crossover(delay_s=0.3))
        assert to_plain(flown)["pilot"]["kind"] == "crossover"
        assert from_plain(test, to_plain(flown)) == flown


@pytest.mark.parametrize("limited", [False, True])
def test_a_flight_depends_on_its_own_pilot_alone_and_repeats(limited: bool):
    law = LIMITED if limited else RECIPE.control_law
    simulator = replace(RECIPE.as_trained(), control_law=law, pilot=Crossover()).simulator()
    drawn = simulator._drawn(50, np.random.default_rng(1))
    y = simulator.outputs(drawn)
    np.testing.assert_array_equal(simulator.outputs(drawn), y)
    some = np.array([40, 3, 17])
    np.testing.assert_array_equal(simulator.outputs(drawn.some(some)), y[some])


@pytest.mark.parametrize("kind", PILOTS)
def test_every_pilot_flies_a_doublet(kind: str):
    for test in (RECIPE.as_trained(), NonlinearTest().as_trained()):
        flights = (
            replace(test, pilot=PILOTS[kind]).simulator().rollouts(20, np.random.default_rng(3))
        )
        assert np.isfinite(flights.y).all()


def test_pilots_scatter_by_their_spreads():
    crew = replace(RECIPE, pilot=Crossover()).simulator().crew
    assert crew is not None
    pilots = crew.draw(20_000, 10, 0.05, SensorNoise(), np.random.default_rng(0))
    scatter = np.log(pilots.own / np.median(pilots.own, axis=0)).std(axis=0)
    np.testing.assert_allclose(scatter, (0.15, 0.15, 0.2), rtol=0.05)
    assert np.median(pilots.own[:, DELAY]) * 0.05 == pytest.approx(0.2, rel=0.02)
    noise = np.degrees(pilots.noise)
    assert noise.std() == pytest.approx(0.2 * np.exp(0.3**2), rel=0.03)
    correlation = (noise[..., 1:] * noise[..., :-1]).mean() / (noise**2).mean()
    assert correlation == pytest.approx(np.exp(-0.05 / 0.3), abs=0.01)


def test_sensor_noise_of_the_tracked_channel_is_seen():
    crew = replace(RECIPE, maneuver=MANEUVERS["sideslip_capture"], pilot=SURE).simulator().crew
    assert crew is not None
    pilots = crew.draw(500, 20, 0.05, SensorNoise(beta=1e-3), np.random.default_rng(0))
    sideslip, bank = pilots.noise[:, 0], pilots.noise[:, 1]
    assert sideslip.std() == pytest.approx(1e-3, rel=0.05)
    assert not bank.any()


def gave_up_in_plain_python(
    error: np.ndarray, accepts: np.ndarray, target: np.ndarray | None = None
) -> int:
    bound, patience, swing, within = accepts
    beyond, side, since, swings = 0, 0, 0, 0
    last, pending = 0.0, 0.0
    for k, e in enumerate(error):
        if target is not None and abs(target[k] - last) > min(bound, swing):
            last, pending = target[k], np.sign(e)
        if abs(e) <= min(bound, swing) or e * pending < 0:
            pending = 0.0
        if pending:
            beyond = side = swings = 0
            continue
        beyond = beyond + 1 if abs(e) > bound else 0
        if abs(e) >= swing:
            if np.sign(e) != side:
                swings = swings + 1 if side and k - since <= within else 1
                side = np.sign(e)
            since = k
        if beyond >= patience or swings >= 4:
            return k
    return len(error)


@pytest.mark.parametrize(
    "intervention",
    [
        Intervention(error_deg=10.0, error_s=0.3),
        Intervention(swing_deg=2.0, least_hz=0.2),
        Intervention(error_deg=12.0, swing_deg=3.0, least_hz=0.1),
    ],
)
def test_a_pilot_who_gives_up_labels_the_flight(intervention: Intervention):
    pilot = Crossover(crossover_rad_s=2.0, intervention=intervention)
    test = replace(RECIPE, pilot=pilot)
    simulator = test.simulator()
    drawn = simulator._drawn(200, np.random.default_rng(1))
    y = simulator.outputs(drawn)
    bank = np.zeros(y.shape[:2])
    bank[:, 1:] = np.cumsum(0.5 * test.dt * (y[:, 1:, 1] + y[:, :-1, 1]), axis=1)
    expected = [gave_up_in_plain_python(-row[:-1], drawn.in_loop.accepts) for row in bank]
    expected = np.where(np.array(expected) == y.shape[1] - 1, y.shape[1], expected)
    np.testing.assert_array_equal(drawn.in_loop.gave_up, expected)
    flights = simulator.rollouts(200, np.random.default_rng(1))
    np.testing.assert_array_equal(flights.fail_index, expected)
    assert 0 < flights.is_unsafe.sum() < 200
    assert test.judged_by == str(intervention)


@pytest.mark.parametrize("name", ["error_deg", "swing_deg"])
def test_a_capture_is_judged_once_its_target_is_captured(name: str):
    """The way to a target of 30 deg is neither an error nor a swing; an oscillation about it is."""
    gives_up = Intervention(error_s=0.3, least_hz=0.2, **{name: 10.0})
    shares = []
    for crossover, delay in ((1.5, 0.2), (5.0, 0.4)):
        pilot = Crossover(crossover_rad_s=crossover, delay_s=delay, intervention=gives_up)
        maneuver = replace(MANEUVERS["bank_capture"], duration_s=14.0, hold_s=7.0)
        capture = replace(RECIPE, maneuver=maneuver, pilot=pilot)
        simulator = capture.simulator()
        drawn = simulator._drawn(100, np.random.default_rng(1))
        y = simulator.outputs(drawn)
        bank = np.zeros(y.shape[:2])
        bank[:, 1:] = np.cumsum(0.5 * RECIPE.dt * (y[:, 1:, 1] + y[:, :-1, 1]), axis=1)
        target = np.broadcast_to(drawn.commands[..., 0], bank.shape)
        expected = [
            gave_up_in_plain_python(each[:-1], drawn.in_loop.accepts, aim)
            for each, aim in zip(target - bank, target, strict=True)
        ]
        expected = np.where(np.array(expected) == y.shape[1] - 1, y.shape[1], expected)
        np.testing.assert_array_equal(drawn.in_loop.gave_up, expected)
        shares.append((expected < y.shape[1]).mean())
    assert shares[0] < 0.2
    assert shares[1] > 0.8


def test_impossible_pairs_of_pilot_and_manoeuvre_are_refused():
    bank = Crossover()
    with pytest.raises(ValueError, match="crossover"):
        replace(RECIPE, maneuver=MANEUVERS["bank_capture"])
    with pytest.raises(ValueError, match="aileron"):
        replace(RECIPE, maneuver=MANEUVERS["aileron_doublet"], pilot=bank)
    with pytest.raises(ValueError, match="bank or sideslip"):
        replace(RECIPE, pilot=Crossover(axis="pitch"))
    with pytest.raises(ValueError, match="delay_s"):
        Crossover(delay_s=-0.1)
    with pytest.raises(ValueError, match="error_deg"):
        Intervention(error_deg=0.0)


def test_a_stopped_capture_goes_back_to_trim_with_the_same_pilot():
    simulator = lateral()
    stopped = simulator.stopping(30, np.random.default_rng(4))
    never = simulator.recipe.maneuver.n_samples(simulator.dt)
    flights = simulator.rollouts(30, np.random.default_rng(4))
    which = np.arange(30)
    np.testing.assert_array_equal(stopped(which, np.full(30, never)), flights.fail_index)
    assert (stopped(which, np.zeros(30, int)) == never).all()


def test_what_knows_planned_inputs_alone_refuses_a_pilot_in_the_loop():
    test = replace(RECIPE, pilot=Crossover())
    with pytest.raises(CardError, match="pilot"):
        card_of(test)
    with pytest.raises(ValueError, match="no pilot in the loop"):
        Ceiling(test)
    with pytest.raises(ClearanceError, match="open_loop"):
        build_up(test, [0.5])
