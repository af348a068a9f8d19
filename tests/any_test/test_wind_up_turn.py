"""A wind-up turn, which no simulator of the program knows: its promise, and whom it holds for."""

from functools import cache

import numpy as np
from starlette.testclient import TestClient

from core.dataset import Dataset
from core.evaluation.rates import evaluate
from core.monitor import Monitor, train
from core.rollouts import LabelledFlights
from core.types import Array, Flags
from tests.support import wind_up_turn
from tests.support.api import store_of
from tests.support.recorded import RECORDINGS, csv_of
from tests.support.wind_up_turn import DICTIONARY, DT, LIMITS, N_SAMPLES, OTHER, TRAINED, Aircraft

RNG = np.random.default_rng
HEAD = "t_s,alpha_rad,q (rad/s),phi_rad,Nz_g,V (m/s),delta_e_rad"


@cache
def monitor() -> Monitor:
    theta, y = wind_up_turn.fly(RNG(1), 2400)
    turns = LabelledFlights.of(y, dt=DT, channels=DICTIONARY, limits=LIMITS, theta=theta)
    learn, fresh = turns.split((0.5, 0.5))
    more = fresh.y, fresh.fail_index
    return train(Dataset.from_flights(learn), fresh=[more], rollouts=more)


def safe(seed: int, n: int, aircraft: Aircraft = TRAINED) -> Array:
    _, y = wind_up_turn.fly(RNG(seed), n, aircraft)
    return y[~LIMITS.envelope.exceeds(y).any(axis=1)]


def withdrawn(y: Array) -> Flags:
    """Whether the monitor calls each flight of (n, n_samples, n_channels) outside training."""
    return monitor().first_withdrawn(y, np.full(len(y), N_SAMPLES)) < N_SAMPLES


def test_its_promise_holds() -> None:
    _, y = wind_up_turn.fly(RNG(2), 1200)
    beyond = LIMITS.envelope.exceeds(y)
    fail_index = np.where(beyond.any(axis=1), beyond.argmax(axis=1), N_SAMPLES)
    counts = evaluate(monitor(), y, fail_index, np.array([0.1]))
    error = np.sqrt(0.1 * 0.9 * (1 / counts.n_unsafe + 1 / len(monitor().alphas)))
    assert counts.n_unsafe > 400
    assert counts.miss_rate[0] <= 0.1 + 3 * error
    assert counts.power[0] > 0.5


def test_another_aircraft_is_outside_training_and_the_own_one_is_not() -> None:
    level = 0.05
    own, other = withdrawn(safe(2, 600)), withdrawn(safe(3, 200, OTHER))
    assert own.mean() <= level + 3 * np.sqrt(level * (1 - level) / len(own))
    assert other.mean() >= 0.95


def test_a_recording_says_whether_it_applies(client: TestClient) -> None:
    monitor_id = store_of(client).monitors.add(monitor(), "wind-up turn").id
    order = {"monitor": monitor_id, "manoeuvres": "entire", "trim": None}
    validities = []
    for aircraft in (TRAINED, OTHER):
        content = csv_of(safe(4, 8, aircraft)[0], DT, head=HEAD)
        sent = {"name": "turn.csv", "monitor": monitor_id}
        recording = client.post(RECORDINGS, content=content, params=sent).json()
        scoring = client.post(f"{RECORDINGS}/{recording['id']}/scorings", json=order).json()
        (turn,) = scoring["manoeuvres"]
        validities.append(turn["validity"]["valid"])
    assert validities == [True, False]
