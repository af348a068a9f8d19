"""A scored recording is flown over REST as any flight: what is shown is what was scored."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from core.monitor import Monitor, MonitorRecipe, train
from core.planned_test.collection import collect
from core.simulation.aircraft import PublishedAircraft
from tests.support.api import api, problem, store_of
from tests.support.attas import TEST, fly
from tests.support.flying import ScriptedClock
from tests.support.recorded import HEAD, RECORDINGS, csv_of, uploaded

URL = "/api/v1/flights"
START = 3358.4
"""[s] A recording whose clock does not begin at zero."""
PHI, THETA = 0.21, 0.06
DISPLAYED = ("p_value", "alert", "state", "reason", "cause")
OUTCOMES = ["quiet", "timely_alert", "invalid"]


class Theatre:
    """Scenes that note what they are told."""

    def __init__(self) -> None:
        self.shown: list[tuple[Any, ...]] = []

    def open(self, *what: Any) -> "Theatre":
        return self

    def show(self, what: tuple[Any, ...]) -> None:
        self.shown.append(what)

    def close(self, *what: Any) -> None: ...
    def restate(self, facts: object) -> None: ...
    def wait(self, *what: Any) -> None: ...


class Airfield:
    """The application in process with a scored recording, its flights on a scripted clock."""

    def __init__(self, client: TestClient, monitor: Monitor) -> None:
        self.client, self.clock, self.theatre = client, ScriptedClock(), Theatre()
        self.monitor = store_of(client).monitors.add(monitor, "transport doublet").id
        flights: Any = client.app.state.flights  # pyright: ignore
        flights._clock, flights._scenes = self.clock, self.theatre
        head = f"{HEAD},phi_rad,theta_rad,V_mps"
        self.recording = uploaded(client, csv_of(flown(), TEST.dt, head, START))["id"]
        answer = client.post(f"{self.path}/scorings", json={"monitor": self.monitor})
        assert answer.status_code == 201, answer.text
        self.scoring = answer.json()
        assert [one["outcome"] for one in self.scoring["manoeuvres"]] == OUTCOMES

    @property
    def path(self) -> str:
        return f"{RECORDINGS}/{self.recording}"

    @property
    def frames(self) -> list[dict[str, Any]]:
        """What is stored of the scoring."""
        path = f"{self.path}/scorings/{self.scoring['id']}/assessments"
        return self.client.get(path).json()["frames"]

    def order(self, **more: Any) -> Any:
        source = {
            "kind": "recording",
            "recording": self.recording,
            "scoring": self.scoring["id"],
        } | more.pop("source", {})
        body = {"source": source, "monitor": self.monitor} | more
        return self.client.post(URL, json=body)

    def steer(self, flight: str, action: str, value: Any = None) -> dict[str, Any]:
        body = {"action": action, "value": value}
        answer = self.client.post(f"{URL}/{flight}/transport", json=body)
        assert answer.status_code == 200, answer.text
        return self.client.get(f"{URL}/{flight}").json()["transport"]

    def advance(self, seconds: float) -> None:
        assert self.client.portal is not None
        for _ in range(round(seconds / 0.05)):
            self.client.portal.call(self.clock.advance, 0.05)


def flown() -> np.ndarray:
    """(n, 9) A quiet doublet, a failing one, and one with all signs reversed; with attitude."""
    flights = fly(30, 5)
    safe, unsafe = flights.y[~flights.is_unsafe], flights.y[flights.is_unsafe]
    y = np.concatenate([safe[0], unsafe[0], -safe[1]])
    assert isinstance(TEST.aircraft, PublishedAircraft)
    slowly = 0.02 * np.sin(0.2 * TEST.dt * np.arange(len(y)))
    more = [PHI + slowly, THETA + slowly, np.full(len(y), TEST.aircraft.model.speed)]
    return np.column_stack([y, *more])


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory, attas: Monitor) -> Iterator[Airfield]:
    with api(tmp_path_factory.mktemp("data")) as client:
        yield Airfield(client, attas)


@pytest.fixture
def flight(field: Airfield) -> Iterator[str]:
    """A flight of the recording, under way."""
    answer = field.order()
    assert answer.status_code == 201, answer.text
    yield answer.json()["id"]
    field.client.post(f"{URL}/{answer.json()['id']}/end")


def same(frame: dict[str, Any], kept: dict[str, Any]) -> bool:
    """Whether a frame of the flight says what is kept of a sample; it knows no manoeuvre."""
    keys = ("t", "y", "p_value", "alert", "state", "reason", "y_hat")
    return [frame[key] for key in keys] == [kept[key] for key in keys]


def test_it_begins_at_its_own_first_time(field: Airfield, flight: str):
    status = field.client.get(f"{URL}/{flight}").json()
    assert status["name"] == "flight.csv"
    assert status["source"]["scoring"] == field.scoring["id"]
    assert status["epsilon"] == field.scoring["epsilon"]
    transport = status["transport"]
    assert transport["start"] == field.scoring["start"] == pytest.approx(START)
    assert transport["position"] == pytest.approx(START)
    assert transport["duration"] == pytest.approx(field.scoring["end"] - field.scoring["start"])
    assert transport["n_samples"] == field.scoring["n_samples"]
    assert status["fail_t"] == field.scoring["manoeuvres"][1]["exceedance"]["t"]


def test_a_monitor_for_display_shows_what_it_scored(field: Airfield):
    further = train(collect(replace(TEST, n_unsafe=30)), MonitorRecipe(t_early=0.5))
    monitor = store_of(field.client).monitors.add(further, "further ahead").id
    refused = field.order(monitors=[monitor])
    assert "score it by that monitor first" in problem(refused, 422)
    scoring = field.client.post(f"{field.path}/scorings", json={"monitor": monitor}).json()
    path = f"{field.path}/scorings/{scoring['id']}/assessments"
    kept = field.client.get(path).json()["frames"]
    flight = field.order(monitors=[monitor]).json()["id"]
    shown = field.client.get(f"{URL}/{flight}/source").json()["frames"]
    said = [{key: frame[key] for key in DISPLAYED} for frame in kept]
    assert [frame["display"][0] for frame in shown] == said
    assert sum(one["p_value"] is not None for one in said) > 100
    field.client.post(f"{URL}/{flight}/end")


def test_its_verdict_is_that_of_the_recording_s_page(field: Airfield):
    said = field.scoring["manoeuvres"][1]["exceedance_verdict"]
    assert said.startswith("LIMIT EXCEEDED, warned ")
    flight = field.order().json()["id"]
    field.steer(flight, "pause")
    for t in (field.scoring["manoeuvres"][2]["end"], START):
        field.steer(flight, "seek", t)
    shown = field.client.get(f"{URL}/{flight}").json()
    assert shown["exceeded_t"] == shown["fail_t"]
    ended = field.client.post(f"{URL}/{flight}/end").json()
    assert (ended["exceeded_t"], ended["verdict"]["text"]) == (shown["fail_t"], said)


def test_what_is_flown_is_what_was_scored(field: Airfield, flight: str):
    kept = field.frames
    source = field.client.get(f"{URL}/{flight}/source").json()["frames"]
    assert len(source) == len(kept)
    assert all(same(*pair) for pair in zip(source, kept, strict=True))
    field.advance(1.0)
    field.steer(flight, "seek", START + 20.0)
    field.advance(1.0)
    field.steer(flight, "pause")
    frames = field.client.get(f"{URL}/{flight}/assessments").json()["frames"]
    at = {frame["t"]: frame for frame in kept}
    assert len(frames) == 42
    assert all(same(frame, at[frame["t"]]) for frame in frames)
    assert frames[21]["t"] == pytest.approx(START + 20.0)


def test_the_next_alert_is_that_of_the_scoring(field: Airfield, flight: str):
    begins = [begin for s in field.scoring["manoeuvres"] for begin, _ in s["alerts"]]
    assert begins
    for begin in begins:
        assert field.steer(flight, "next_alert")["position"] == pytest.approx(begin)
    (alarm, *_) = field.client.get(f"{URL}/{flight}/alarms").json()
    assert alarm["t"] == pytest.approx(begins[0])
    end = {"action": "next_alert", "value": None}
    answer = field.client.post(f"{URL}/{flight}/transport", json=end)
    assert "no alert after" in problem(answer, 409)


def test_seeking_outside_stays_within(field: Airfield, flight: str):
    field.steer(flight, "pause")
    assert field.steer(flight, "seek", 0.0)["position"] == pytest.approx(START)
    assert field.steer(flight, "seek", 1e9)["position"] == pytest.approx(field.scoring["end"])
    assert field.steer(flight, "step", -1)["position"] == pytest.approx(
        field.scoring["end"] - field.scoring["dt"]
    )


def test_an_invalid_manoeuvre_says_why_it_says_nothing(field: Airfield, flight: str):
    invalid = field.scoring["manoeuvres"][2]
    field.steer(flight, "pause")
    field.steer(flight, "seek", invalid["start"] + 1.0)
    frame = field.client.get(f"{URL}/{flight}/assessments").json()["frames"][-1]
    assert (frame["state"], frame["p_value"], frame["alert"]) == ("invalid", None, None)
    assert frame["reason"] == invalid["withdrawn_reason"] != ""


def test_the_attitude_of_the_file_is_what_the_scene_shows(field: Airfield, flight: str):
    field.theatre.shown.clear()
    field.steer(flight, "pause")
    field.steer(flight, "seek", START + 9.0)
    t, attitude, *_ = field.theatre.shown[-1]
    slowly = 0.02 * np.sin(0.2 * (t - START))
    assert t == pytest.approx(START + 9.0, abs=TEST.dt)
    assert attitude[:2] == pytest.approx((PHI + slowly, THETA + slowly), abs=1e-6)
    assert np.isfinite(attitude[2])


def test_another_monitor_or_epsilon_is_refused_by_a_sentence(field: Airfield, attas: Monitor):
    other = store_of(field.client).monitors.add(attas, "another").id
    flown_before = field.client.get(URL).json()
    for wrong in ({"monitor": other}, {"epsilon": 0.5}):
        said = problem(field.order(**wrong), 422)
        assert said == (
            f"this recording was scored by monitor transport doublet ({field.monitor}) at epsilon "
            "0.1: use these, or score it again"
        )
    assert "nothing" in problem(field.order(source={"scoring": "nothing"}), 404)
    assert "no scoring" in problem(field.order(source={"recording": "nothing"}), 404)
    assert problem(field.order(source={"rollout": 1}), 422)
    assert field.client.get(URL).json() == flown_before


def test_what_is_flown_cannot_be_deleted_and_can_be_afterwards(field: Airfield):
    flight = field.order().json()["id"]
    for path in (field.path, f"{field.path}/scorings/{field.scoring['id']}"):
        assert f"({flight})" in problem(field.client.delete(path), 409)
    assert field.client.post(f"{URL}/{flight}/end").json()["progress"] == "ended"
    order = {"monitor": field.monitor, "epsilon": 0.4}
    made = field.client.post(f"{field.path}/scorings", json=order).json()
    assert field.client.delete(f"{field.path}/scorings/{made['id']}").status_code == 204
    assert "scoring" in problem(field.order(source={"scoring": made["id"]}), 404)
