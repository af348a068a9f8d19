"""One truth: whichever way a flight comes to a monitor, each sample is told the same."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from starlette.testclient import TestClient

from app.assessment import ScoringRecipe
from app.flights.sources.playback import AssessedTrack
from app.flights.sources.simulated import Track
from app.recordings.scored_file import ScoreRequest, score_file
from core.monitor import Assessment, Monitor, State
from core.monitor.assessment import STATES
from tests.app.flights.test_withdrawal import checked, quiet_flight, strange
from tests.support.api import store_of
from tests.support.attas import recorded, score
from tests.support.flying import EPSILON, T, exact_monitor, failing_flight, grouped_monitor
from tests.support.oscillator import DT, Array
from tests.support.recorded import csv_of


class Told(NamedTuple):
    """What is told of one sample."""

    state: str
    p_value: float | None
    alert: bool | None


def of(assessment: Assessment) -> Told:
    return Told(assessment.state.value, assessment.p_value, assessment.alert)


def by_stream(monitor: Monitor, t: Array, y: Array, _: TestClient) -> list[Told]:
    stream = monitor.stream(EPSILON)
    return [of(stream.update(*sample)) for sample in zip(t, y, strict=True)]


def by_batch(monitor: Monitor, t: Array, y: Array, _: TestClient) -> list[Told]:
    assessments = monitor.assess(t, y, EPSILON)
    return [of(assessments[k]) for k in range(len(t))]


def by_flight(monitor: Monitor, t: Array, y: Array, _: TestClient) -> list[Told]:
    script = AssessedTrack(Track(t, y, DT), monitor, EPSILON)
    return [of(script.assessment(k)) for k in range(len(t))]


def by_rest(monitor: Monitor, t: Array, y: Array, client: TestClient, **query: bool) -> list[Told]:
    monitor_id = store_of(client).monitors.add(monitor, "oscillator").id
    keys = ("beta", "p", "r", "Ny", "delta_a", "delta_r")
    columns = [[None if np.isnan(v) else v for v in column.tolist()] for column in y.T]
    body = {"t": t.tolist()} | dict(zip(keys, columns, strict=True))
    path = f"/api/v1/monitors/{monitor_id}/score"
    answer = client.post(path, json=body, params={"epsilon": EPSILON} | query).json()
    return [Told(a["state"], a["p_value"], a["alert"]) for a in answer["assessments"]]


def by_rest_with_reasons(monitor: Monitor, t: Array, y: Array, client: TestClient) -> list[Told]:
    return by_rest(monitor, t, y, client, why=True)


DOORS = {
    "stream": by_stream,
    "flight": by_flight,
    "REST": by_rest,
    "REST with exemplars": by_rest_with_reasons,
}


def with_missing(y: Array) -> Array:
    y = y.copy()
    y[[10, 22], 0] = np.nan
    return y


def yaw_reversed(y: Array) -> Array:
    return y * np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0])


def with_a_gap(t: Array) -> Array:
    t = t.copy()
    t[40:] += 1.0
    return t


FLIGHTS: dict[str, Callable[[], tuple[Array, Array]]] = {
    "valid": lambda: (T, quiet_flight()),
    "failing": lambda: (T, failing_flight()),
    "invalid": lambda: (T, strange(quiet_flight(), 25)),
    "invalid, its yaw rate reversed": lambda: (T, yaw_reversed(failing_flight())),
    "gappy": lambda: (with_a_gap(T), quiet_flight()),
    "gappy and invalid": lambda: (with_a_gap(T), strange(quiet_flight(), 50)),
    "with missing values": lambda: (T, with_missing(quiet_flight())),
    "missing and invalid": lambda: (T, with_missing(strange(quiet_flight(), 30))),
}


@pytest.mark.parametrize("flight", FLIGHTS)
@pytest.mark.parametrize("monitor", [checked, exact_monitor, grouped_monitor])
@pytest.mark.parametrize("door", DOORS)
def test_every_door_tells_the_same_of_each_sample(
    door: str, monitor: Callable[[], Monitor], flight: str, client: TestClient
) -> None:
    """States and p-values to the bit; nothing after withdrawal, and never one uncalibrated."""
    t, y = FLIGHTS[flight]()
    expected = by_batch(monitor(), t, y, client)
    assert DOORS[door](monitor(), t, y, client) == expected
    withdraws = "invalid" in flight and monitor() is checked()
    assert (expected[-1].state == State.INVALID) == withdraws


def lines_of(samples: np.ndarray) -> list[Told]:
    known = np.isfinite(samples["p_value"]).tolist()
    rows = zip(samples["state"].tolist(), samples["p_value"].tolist(), strict=True)
    alerts = samples["alert"].tolist()
    return [
        Told(STATES[state].value, p if is_known else None, alert if is_known else None)
        for (state, p), is_known, alert in zip(rows, known, alerts, strict=True)
    ]


@pytest.mark.parametrize("flight", ["valid", "failing", "invalid, its yaw rate reversed"])
@pytest.mark.parametrize("monitor", [checked, exact_monitor])
def test_a_scored_recording_tells_the_same(
    flight: str, monitor: Callable[[], Monitor], tmp_path: Path, client: TestClient
) -> None:
    """From channels, and from a file as the command line reads it. Its clock is even: a recording
    with gaps is brought onto a grid first, so its samples are not those that a stream was given."""
    t, y = FLIGHTS[flight]()
    trained = replace(monitor(), dataset_recipe={})
    recipe = ScoringRecipe(EPSILON, trim=None, manoeuvres="entire")
    expected = by_batch(trained, t, y, client)
    assert lines_of(score(trained, recorded(y, DT), recipe).samples) == expected
    trained.save(tmp_path / "monitor.fwm")
    (tmp_path / "flight.csv").write_bytes(csv_of(y))
    request = ScoreRequest(
        (tmp_path / "monitor.fwm",), tmp_path / "flight.csv", recipe=recipe, epsilons=(EPSILON,)
    )
    (scored,) = score_file(request).scored
    assert lines_of(scored.recording.samples) == expected


def test_after_the_study_method_nothing_withdraws() -> None:
    """A monitor without fresh flights of its own: the paper's, as the study trains them."""
    assert exact_monitor().support is None
    y = strange(quiet_flight(), 0)
    assert np.isfinite(exact_monitor().p_values(y)).all()
