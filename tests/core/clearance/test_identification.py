"""One aircraft from recorded segments: interval coverage, real records, refused input."""

from dataclasses import replace

import numpy as np
import pytest

from core.channels import KEYS
from core.clearance.equation_error import EquationError, Smoothing
from core.clearance.identification import FlownSegment, Identification, identify, swing_s
from core.evaluation.lead_sweep import TESTS
from core.monitor import MonitorRecipe, train
from core.planned_test.collection import DatasetRecipe, collect, evaluation_flights
from core.planned_test.planned_test import LateralSimulator
from core.recipe import from_plain, to_plain
from core.simulation.aircraft import AIRCRAFT, Aircraft, IdentifiedAircraft, PublishedAircraft
from core.simulation.control_law import CONTROL_LAWS
from core.simulation.imperfections import channel_array
from core.simulation.uncertain_plant import Uncertainty
from core.types import Array
from tests.support.places import RECORDS
from tests.support.prediction import predict

ATTAS = PublishedAircraft("attas_id_16kft", n_states=4)
COLUMNS = ("beta_rad", "p_radps", "r_radps", "ay_g", "da_rad", "dr_rad")
real_records = pytest.mark.skipif(not RECORDS.is_dir(), reason="no flight records beside the tests")


def record(name: str) -> FlownSegment:
    """A real ATTAS manoeuvre, 30 s at 25 Hz."""
    table = np.genfromtxt(RECORDS / f"{name}.csv", delimiter=",", names=True)
    return FlownSegment(np.column_stack([table[column] for column in COLUMNS]), 0.04, name)


def flown(name: str, n: int = 1, seed: int = 4) -> tuple[Array, list[FlownSegment]]:
    """Theta (n, n_params), and one flight each of a planned test."""
    simulator, rng = LateralSimulator(TESTS[name]), np.random.default_rng(seed)
    rollouts = simulator.rollouts(n, rng)
    return rollouts.theta, [FlownSegment(y, TESTS[name].dt, "step") for y in rollouts.y]


def identified(name: str, segments: list[FlownSegment], *, noise_is_known: bool) -> Identification:
    """Identify the aircraft of a planned test."""
    test = TESTS[name]
    noise = channel_array(test.noise) if noise_is_known else None
    return identify(test.aircraft, test.control_law, segments, noise)


def test_a_flight_without_any_noise_identifies_its_aircraft() -> None:
    test = DatasetRecipe.usual(AIRCRAFT["attas_id_16kft"])
    test = replace(test, maneuver=test.maneuver.with_peak(2.56))
    flights = evaluation_flights(test, 1)
    found = identify(test.aircraft, test.control_law, [FlownSegment(flights.y[0], test.dt)])
    yaw = found.names.index("N_dr")
    assert found.mean[yaw] == pytest.approx(flights.theta[0, yaw], rel=0.05)
    assert found.r2.min() > 0.95


@pytest.mark.parametrize("noise_is_known", [True, False])
def test_intervals_cover_each_parameter(noise_is_known: bool) -> None:
    """For 12 aircraft, with known and with estimated noise."""
    theta, segments = flown("ATTAS", 12)
    inside = [
        np.abs(found.mean - true) <= 1.96 * found.sigma
        for true, found in (
            (true, identified("ATTAS", [segment], noise_is_known=noise_is_known))
            for true, segment in zip(theta, segments, strict=True)
        )
    ]
    assert np.mean(inside) >= 0.9


def test_white_noise_is_estimated_as_simulated() -> None:
    """For four aircraft: the right size, and no coloured part."""
    for name in ("F-16", "ATTAS"):
        _, segments = flown(name, 4)
        said = channel_array(TESTS[name].noise)[:4]
        for segment in segments:
            found = identified(name, [segment], noise_is_known=False)
            np.testing.assert_allclose(found.noise[:4], said, rtol=0.35)
            known = identified(name, [segment], noise_is_known=True)
            np.testing.assert_allclose(found.sigma, known.sigma, rtol=0.35)
            assert known.r2.shape == (1, 4)


def test_model_errors_make_intervals_wider() -> None:
    """A slow drift of the sideslip vane, which the model lacks, lasts a swing."""
    _, (segment,) = flown("ATTAS")
    drifting = segment.y.copy()
    drifting[:, 0] += 0.01 * np.sin(2 * np.pi * 0.25 * segment.dt * np.arange(len(drifting)))
    straight, bent = (
        identified("ATTAS", [FlownSegment(y, segment.dt)], noise_is_known=False)
        for y in (segment.y, drifting)
    )
    inflation = [each.noise[:4] / each.residual_rms for each in (straight, bent)]
    assert (inflation[0] < 1.5).all()
    assert (inflation[1] > 3.0).all()
    assert bent.sigma.sum() > 1.3 * straight.sigma.sum()


def test_an_unused_flight_is_predicted_inside_its_interval() -> None:
    """For the same aircraft at another amplitude."""
    simulator, rng = LateralSimulator(TESTS["ATTAS"]), np.random.default_rng(5)
    theta = simulator.plant.sample(1, rng)
    small, large = (
        FlownSegment(simulator.fly(theta, rng, np.array([scale]))[0].y[0], 0.05)
        for scale in (0.5, 1.0)
    )
    found = identified("ATTAS", [small], noise_is_known=False)
    prediction = predict(found, TESTS["ATTAS"].control_law, large)
    assert (prediction.r2 > 0.98).all()
    assert (prediction.covered > 0.85).all()
    assert prediction.y.shape == prediction.sigma.shape == (len(large.y), 4)


def test_contradictory_segments_count_less() -> None:
    """Two aircraft treated as one: more of the prior remains than with either alone."""
    _, segments = flown("ATTAS", 8, seed=9)
    one, other = segments[0], segments[int(np.argmax([s.y[:, 3].max() for s in segments]))]
    same, both = (
        identified("ATTAS", [one, second], noise_is_known=False) for second in (one, other)
    )
    assert (both.noise[:4] > 1.5 * same.noise[:4]).all()
    assert both.sigma.sum() > same.sigma.sum()


def test_equation_error_agrees() -> None:
    """Yawing moment on a flight with little noise: within both intervals."""
    quiet = replace(
        TESTS["ATTAS"],
        noise=replace(TESTS["ATTAS"].noise, **dict.fromkeys(KEYS, 2e-5)),
        dt=0.02,
    )
    simulator, rng = LateralSimulator(quiet), np.random.default_rng(6)
    segment = FlownSegment(simulator.rollouts(1, rng).y[0], quiet.dt)
    found = identify(quiet.aircraft, quiet.control_law, [segment], channel_array(quiet.noise))
    smoothing = Smoothing(quiet.dt)
    beta, p, r, _, _, delta_r = segment.y.T
    signals = tuple(smoothing.value(signal) for signal in (beta, p, r, delta_r))
    equation = EquationError.fit(smoothing.slope(r).values, signals, quiet.dt, tau=0.0)
    assert equation is not None
    for k, name in enumerate(("N_beta", "N_p", "N_r", "N_dr")):
        estimate, n = equation.coefficient(k), found.names.index(name)
        reach = 1.96 * found.sigma[n]
        assert estimate.low <= found.mean[n] + reach, name
        assert estimate.high >= found.mean[n] - reach, name


@real_records
def test_either_real_record_predicts_the_other() -> None:
    """Two manoeuvres of one ATTAS, each from the other, with samples inside the interval."""
    law, (rudder, aileron) = CONTROL_LAWS["none"], (record("attas_rud1"), record("attas_ail1"))
    for used, unused, catalogs in (
        (rudder, aileron, (0.978, 0.997, 0.974, 0.953)),
        (aileron, rudder, (0.968, 0.984, 0.994, 0.990)),
    ):
        found = identify(ATTAS, law, [used])
        prediction = predict(found, law, unused)
        assert (prediction.r2 > np.array(catalogs) - 0.06).all()
        assert (prediction.covered > 0.9).all()
        assert found.distance < 1.0
    both = identify(ATTAS, law, [rudder, aileron])
    assert (both.r2 > 0.95).all()


@real_records
def test_a_real_rudder_record_does_not_change_aileron_derivatives() -> None:
    """Its derivatives stay within their prior."""
    found = identify(ATTAS, CONTROL_LAWS["none"], [record("attas_rud1")])
    of_aileron = [found.names.index(name) for name in ("Y_da", "L_da", "N_da")]
    moved = (found.mean - found.prior_mean) / found.prior_sigma
    assert np.abs(moved[of_aileron]).max() < 1.0
    assert {"Y_da", "N_da"} <= set(found.undetermined)


@real_records
def test_a_real_rudder_record_improves_channels_the_catalog_was_not_fitted_to() -> None:
    """The catalog's derivatives were fitted to these records, so its own R2 is no reference."""
    law, plant, rng = CONTROL_LAWS["none"], ATTAS.uncertain_plant(), np.random.default_rng(2)
    covariance = plant.root @ plant.root.T
    told = []
    for deviates in rng.standard_normal((12, plant.root.shape[1])):
        guess = IdentifiedAircraft.of(ATTAS, plant.nominal + plant.root @ deviates, covariance)
        found = identify(guess, law, [record("attas_rud1")])
        unflown = replace(found, mean=found.prior_mean)
        told.append([predict(one, law, record("attas_ail1")).r2 for one in (unflown, found)])
    before, after = np.moveaxis(np.array(told), 1, 0)
    slow = [0, 2, 3]  # a rudder says little of the roll rate, which is known well before
    assert (np.mean(after > before, axis=0)[slow] > 0.6).all()
    assert (np.mean(after - before, axis=0)[slow] > 0.1).all()


def test_swing_is_the_dutch_roll() -> None:
    """Some seconds for a transport; at most twenty for an aircraft without oscillation."""
    assert 2.0 < swing_s(ATTAS.uncertain_plant()) < 6.0
    still = replace(ATTAS.uncertain_plant(), nominal=-np.ones(15), effects=())
    assert swing_s(still) <= 20.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda y: y[:10], "20 samples or more"),
        (lambda y: y[:, :5], "it needs"),
        (lambda y: np.where(np.arange(6) == 5, np.nan, y), "lacks delta_r"),
        (lambda y: np.where(np.arange(6) < 4, np.nan, y), "lacks beta, p, r, Ny"),
        (lambda y: np.where(np.arange(len(y))[:, None] == 7, np.nan, y), "lacks samples of beta"),
        (lambda y: y * (np.arange(6) < 4), "neither surface moves"),
    ],
)
def test_unusable_segments_are_refused(change, words: str) -> None:
    _, (segment,) = flown("ATTAS")
    with pytest.raises(ValueError, match=words):
        FlownSegment(change(segment.y.copy()), segment.dt)


def test_impossible_identifications_are_refused() -> None:
    """No segment, no interval, no uncertainty."""
    _, (segment,) = flown("ATTAS")
    with pytest.raises(ValueError, match="no segment was given"):
        identify(ATTAS, CONTROL_LAWS["none"], [])
    with pytest.raises(ValueError, match="samples are 0"):
        FlownSegment(segment.y, 0.0)
    certain = PublishedAircraft("attas_id_16kft", uncertainty=Uncertainty(0.0))
    with pytest.raises(ValueError, match="no derivative of the aircraft is uncertain"):
        identify(certain, CONTROL_LAWS["none"], [segment])


def test_an_output_that_was_not_recorded_is_left_out() -> None:
    """For example without a sideslip vane."""
    _, (segment,) = flown("ATTAS")
    blind = segment.y.copy()
    blind[:, 0] = np.nan
    found = identified("ATTAS", [FlownSegment(blind, segment.dt)], noise_is_known=True)
    assert np.isnan(found.r2[0, 0])
    assert (found.r2[0, 1:] > 0.9).all()


class TestIdentifiedAircraft:
    """An aircraft with a full covariance, as collection samples it."""

    def made(self) -> IdentifiedAircraft:
        """From one step."""
        _, segments = flown("ATTAS")
        return identified("ATTAS", segments, noise_is_known=True).identified

    def test_is_sampled_with_its_covariance(self) -> None:
        """Mean and covariance of 20,000 draws."""
        aircraft = self.made()
        plant = aircraft.uncertain_plant()
        theta = plant.sample(20_000, np.random.default_rng(0))
        sigma = np.sqrt(np.diag(aircraft.covariance))
        np.testing.assert_allclose(theta.mean(axis=0), aircraft.mean, atol=0.03 * sigma.max())
        scaled = np.cov(theta.T) / np.outer(sigma, sigma)
        wanted = np.array(aircraft.covariance) / np.outer(sigma, sigma)
        np.testing.assert_allclose(scaled, wanted, atol=0.04)
        assert np.abs(wanted - np.eye(15)).max() > 0.3, "its parameters do not vary alone"

    def test_trains_a_monitor_and_returns_from_its_recipe(self) -> None:
        """Like any aircraft, also from JSON."""
        aircraft = self.made()
        test = replace(TESTS["ATTAS"], aircraft=aircraft, n_unsafe=20)
        again = from_plain(TESTS["ATTAS"], to_plain(test)).aircraft
        assert isinstance(again, IdentifiedAircraft)
        assert again.sources == aircraft.sources == ("step",)
        np.testing.assert_array_equal(again.covariance, aircraft.covariance)
        assert "identified from step" in again.description
        dataset = collect(replace(test, aircraft=again))
        assert dataset.digest() == collect(test).digest()
        assert train(dataset, MonitorRecipe()).n_unsafe == 20

    def test_before_any_flight_it_is_the_aircraft(self) -> None:
        """With its spreads, uncorrelated."""
        aircraft: Aircraft = IdentifiedAircraft.undetermined(ATTAS)
        plant = aircraft.uncertain_plant()
        np.testing.assert_allclose(plant.spread, ATTAS.uncertain_plant().spread)
        assert aircraft.condition == ATTAS.condition
        assert aircraft.description.endswith("identified from no flight")

    @pytest.mark.parametrize(
        ("mean", "covariance", "words"),
        [
            ((1.0,), ((1.0,),), "15 parameters"),
            ((np.nan,) * 15, np.eye(15), "non-finite"),
            ((1.0,) * 15, -np.eye(15), "not symmetric and positive"),
            ((1.0,) * 15, np.triu(np.ones((15, 15))), "not symmetric and positive"),
        ],
    )
    def test_refuses_impossible_moments(self, mean, covariance, words: str) -> None:
        """Wrong size, not finite, not a covariance."""
        with pytest.raises(ValueError, match=words):
            IdentifiedAircraft(ATTAS, mean, tuple(map(tuple, covariance)))
