"""Cautions about samples that are no picture of the aircraft, pushed through a real server."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import numpy.typing as npt
import pytest

from app.assessment.input_checks import DOUBT_KINDS
from core.channels import KEYS
from core.planned_test.planned_test import LateralSimulator
from core.types import Array
from tests.app.flights.test_flights import RECIPE
from tests.support.live_server import LiveServer, alarms_of, live_server

DT = RECIPE.dt
RUDDER, NY = KEYS.index("delta_r"), KEYS.index("Ny")


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    with live_server(tmp_path_factory.mktemp("data")) as server:
        yield server


class Pushed:
    """A live flight on the server, and what it shows."""

    def __init__(self, server: LiveServer, trim: str = "detected") -> None:
        self.api = f"{server.url}/api/v1/flights"
        body = {"source": {"kind": "live", "trim": trim}, "monitor": server.monitor_id}
        self.id = self._post(self.api, body)["id"]
        self.flight = f"{self.api}/{self.id}"

    def _post(self, url: str, body: Any = None) -> Any:
        answer = httpx2.post(url, json=body).raise_for_status()
        return answer.json() if answer.content else None

    def push(self, t: npt.NDArray, y: Array) -> None:
        columns = [[None if np.isnan(value) else value for value in column] for column in y.T]
        channels = dict(zip(KEYS, columns, strict=True))
        self._post(f"{self.flight}/samples", {"t": t.tolist(), **channels})

    @property
    def state(self) -> dict[str, Any]:
        return httpx2.get(self.flight).raise_for_status().json()

    @property
    def live(self) -> dict[str, Any]:
        return httpx2.get(f"{self.flight}/samples").raise_for_status().json()

    def cautions(self, flight: str | None = None) -> list[dict[str, Any]]:
        """Alarms about samples in doubt, as soon as there is one."""
        return alarms_of(flight or self.flight, *DOUBT_KINDS)

    def trims(self, flight: str | None = None) -> Any:
        """Where the trim of its limited channels changed."""
        url = f"{flight or self.flight}/assessments"
        return httpx2.get(url).raise_for_status().json()["trims"]

    @property
    def is_calm(self) -> bool:
        return self.state["status"] in ("ok", "warming_up", "not_calibrated")

    def acknowledge(self, alarm: dict[str, Any]) -> None:
        self._post(f"{self.flight}/alarms/{alarm['id']}/acknowledge", {"by": "FTE"})

    def replayed(self) -> list[tuple[str, float, str]]:
        """Kind, time and reason of the alarms of the replay of this flight."""
        self._post(f"{self.flight}/end")
        body = {"source": {"kind": "journal", "flight_id": self.id}}
        body |= {"monitor": self.state["monitor"], "epsilon": self.state["epsilon"]}
        replay = f"{self.api}/{self._post(self.api, body)['id']}"
        self._post(f"{replay}/transport", {"action": "speed", "value": 10.0})
        alarms = self.cautions(replay)
        self.trims_of_replay = self.trims(replay)
        self._post(f"{replay}/end")
        return [(alarm["kind"], alarm["t"], alarm["reason"]) for alarm in alarms]


def doublet() -> tuple[npt.NDArray, Array]:
    """A failing rudder doublet after three seconds of rest, up to its limit."""
    longer = replace(RECIPE.maneuver, lead_in_s=3.0, duration_s=9.0)
    rollouts = LateralSimulator(replace(RECIPE, maneuver=longer)).rollouts(
        60, np.random.default_rng(1)
    )
    k = int(rollouts.is_unsafe.argmax())
    y = rollouts.y[k][: rollouts.fail_index[k]]
    return np.arange(len(y)) * DT, y


def dead(*channels: str) -> Callable[[Array], Array]:
    def of(y: Array) -> Array:
        y = y.copy()
        for key in channels:
            y[:, KEYS.index(key)] = 0.0
        return y

    return of


@pytest.mark.parametrize("trim", ["detected", "none"])
@pytest.mark.parametrize("channels", [("delta_r",), ("delta_a", "delta_r")])
def test_a_doublet_with_dead_surfaces_is_a_caution_within_half_a_second(
    server: LiveServer, channels: tuple[str, ...], trim: str
) -> None:
    t, y = doublet()
    begins = t[(np.abs(y[:, RUDDER]) > 0.2 * np.abs(y[:, RUDDER]).max()).argmax()]
    flight = Pushed(server, trim)
    now = t <= begins + 0.5
    flight.push(t[now], dead(*channels)(y)[now])
    (alarm,) = flight.cautions()
    assert (alarm["kind"], alarm["level"]) == ("surfaces", "caution")
    assert alarm["t"] <= begins + 0.5
    assert ("press G" in alarm["reason"]) == (trim == "detected")
    assert not flight.is_calm
    flight.acknowledge(alarm)
    assert not flight.is_calm
    assert flight.live["doubts"] == [alarm["reason"]]
    if trim == "detected":
        flight._post(f"{flight.flight}/manoeuvre")
        flight.push(t[~now], dead(*channels)(y)[~now])
        assert flight.live["doubts"] == []


def test_the_same_doublet_with_its_surfaces_is_no_caution(server: LiveServer) -> None:
    flight = Pushed(server)
    flight.push(*doublet())
    alarms = httpx2.get(f"{flight.flight}/alarms").raise_for_status().json()
    assert "surfaces" not in [alarm["kind"] for alarm in alarms]


def noise(n: int) -> Array:
    return np.random.default_rng(3).normal(0.0, 2e-3, (n, len(KEYS)))


def test_a_frozen_source_is_a_caution_in_flight_and_in_its_replay(server: LiveServer) -> None:
    y = noise(100)
    y[60:] = y[60]
    t = np.arange(100) * DT
    flight = Pushed(server)
    flight.push(t, y)
    (alarm,) = flight.cautions()
    assert (alarm["kind"], alarm["level"]) == ("frozen", "caution")
    assert alarm["t"] == pytest.approx(t[60])
    assert not flight.is_calm
    flight.push(t + 5.0, noise(100))
    assert flight.live["doubts"] == []
    assert flight.replayed() == [(alarm["kind"], alarm["t"], alarm["reason"])]


def test_one_frozen_channel_is_a_caution_in_flight_and_in_its_replay(server: LiveServer) -> None:
    y = noise(120)
    y[80:, NY] = y[80, NY]
    t = np.arange(120) * DT
    flight = Pushed(server)
    flight.push(t, y)
    (alarm,) = flight.cautions()
    assert (alarm["kind"], alarm["level"]) == ("frozen", "caution")
    assert alarm["t"] == pytest.approx(t[80])
    assert "N_y" in alarm["reason"]
    assert alarm["channels"] == ["Ny"]
    assert not flight.is_calm
    flight.acknowledge(alarm)
    assert flight.replayed() == [(alarm["kind"], alarm["t"], alarm["reason"])]
    assert "frozen" in flight.state["verdict"]["text"]
    assert flight.state["level"] == "caution"


def test_a_frozen_source_without_noise_is_an_advisory(server: LiveServer) -> None:
    flight = Pushed(server)
    flight.push(np.arange(100) * DT, np.zeros((100, len(KEYS))))
    (doubt,) = flight.live["doubts"]
    assert "frozen" in doubt
    alarms = httpx2.get(f"{flight.flight}/alarms").raise_for_status().json()
    assert "frozen" not in [alarm["kind"] for alarm in alarms]


def test_a_trim_near_the_limit_is_a_caution_until_it_is_gone(server: LiveServer) -> None:
    t, y = np.arange(400) * DT, noise(400)
    y[100:260, NY] += 0.45
    flight = Pushed(server)
    flight.push(t[:200], y[:200])
    (alarm,) = alarms_of(flight.flight, "trim")
    assert alarm["level"] == "caution"
    assert "N_y counts from its trim of 0.4" in alarm["reason"]
    assert not flight.is_calm
    flight.push(t[200:300], y[200:300])
    flight.acknowledge(alarm)
    assert alarm["reason"] in flight.live["doubts"]
    flight.push(t[300:], y[300:])
    assert flight.live["doubts"] == []
    trims = flight.trims()
    assert [(one["channel"], round(one["value"], 1)) for one in trims] == [
        ("Ny", 0.0),
        ("Ny", 0.4),
        ("Ny", 0.0),
    ]
    assert trims[1]["t"] == alarm["t"]
    assert [one["is_far"] for one in trims] == [False, True, False]
    frames = httpx2.get(f"{flight.flight}/assessments").json()["frames"]
    far = [frame for frame in frames if "sensor" in frame]
    assert [far[0]["t"], far[-1]["t"] + DT] == pytest.approx([trims[1]["t"], trims[2]["t"]])
    sent = [y[round(frame["t"] / DT), NY] for frame in far]
    assert [frame["sensor"]["Ny"] for frame in far] == pytest.approx(sent, abs=0.05)
    assert ("trim", alarm["t"], alarm["reason"]) in flight.replayed()
    assert flight.trims() == flight.trims_of_replay == trims


@pytest.mark.parametrize("trim", ["detected", "none"])
@pytest.mark.parametrize(("lost", "n"), [("link", 8), ("Ny", 8), ("Ny", 1)])
def test_data_missing_in_a_manoeuvre_are_a_caution_until_it_ends(
    server: LiveServer, lost: str, n: int, trim: str
) -> None:
    """Also once the caution of the stale or invalid samples is acknowledged."""
    t, y = np.arange(400) * DT, np.zeros((400, len(KEYS)))
    input_t = t - 3.0
    y[:, RUDDER] = 0.1 * ((input_t >= 0) * 1.0 - 2.0 * (input_t >= 0.5) + (input_t >= 1.0))
    y[:, NY] = 0.05 * np.sin(3.0 * input_t) * ((input_t >= 0.0) & (input_t < 2.5))
    y += 1e-4 * noise(400)
    first = int(4.2 / DT)
    y[first : first + n, NY] = np.nan
    is_sent = np.ones(400, bool)
    if lost == "link":
        is_sent[first : first + n] = False
    flight = Pushed(server, trim)
    now = first + n + int(0.5 / DT)
    for part in (slice(now), slice(now, now + 5)):
        flight.push(t[part][is_sent[part]], y[part][is_sent[part]])
        for alarm in httpx2.get(f"{flight.flight}/alarms").json():
            flight.acknowledge(alarm)
        state, doubts = flight.state, flight.live["doubts"]
        if n == 1:
            assert (flight.is_calm, doubts) == (True, [])
            return
        assert (state["status"], state["level"]) == ("caution", "caution")
        gap = f"from {t[first - 1]:.2f} to {t[first + n]:.2f} s"
        assert doubts == [f"DATA MISSING: no sample {gap}; a limit may have been exceeded there"]
    flight.push(t[now + 5 :], y[now + 5 :])
    assert flight.is_calm == (trim == "detected")
    flight._post(f"{flight.flight}/end")
    assert f"DATA MISSING: no sample of Ny {gap}" in flight.state["verdict"]["text"]


def test_two_sources_that_contradict_are_a_caution_with_both_values(server: LiveServer) -> None:
    t, flown = np.arange(60) * DT, noise(60)
    flight = Pushed(server)
    for k in range(60):
        flight.push(t[k : k + 1], flown[k : k + 1])
        if k >= 40:
            other = flown[k : k + 1].copy()
            other[:, NY] = 0.4
            flight.push(t[k : k + 1], other)
    (alarm,) = flight.cautions()
    assert (alarm["kind"], alarm["t"]) == ("contradiction", t[40])
    assert f"{flown[40, NY]:.3g} g from REST 127.0.0.1:" in alarm["reason"]
    assert "0.4 g from REST 127.0.0.1:" in alarm["reason"]
    assert not flight.is_calm
    assert flight.replayed() == [(alarm["kind"], alarm["t"], alarm["reason"])]


def test_journals_name_the_sender_of_each_batch(server: LiveServer) -> None:
    flight = Pushed(server)
    flight.push(np.arange(3) * DT, noise(3))
    journal: Path = server.root / "live" / f"{flight.id}.jsonl"
    assert '"v":"REST 127.0.0.1:' in journal.read_text()


def test_why_a_simulated_flight_ended_is_in_its_record(server: LiveServer) -> None:
    flights = f"{server.url}/api/v1/flights"
    body = {"source": {"kind": "simulated"}, "monitor": server.monitor_id}
    flight = f"{flights}/{httpx2.post(flights, json=body).raise_for_status().json()['id']}"
    httpx2.post(f"{flight}/end", json={"by": "Ann"}).raise_for_status()
    assert httpx2.get(flight).json()["end_reason"] == "the flight was ended by Ann"
