"""Flights over REST and WebSocket, in process and against a real server."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Barrier
from typing import Any

import msgspec
import pytest
from starlette.testclient import TestClient, WebSocketTestSession
from starlette.websockets import WebSocketDisconnect

from app.flights import watcher
from app.flights.flights import Flights
from app.flights.watcher import CREDIT, NEWEST, TICK_S, FrameTicks
from app.messages import Hello
from core.evaluation.certificate import UNCALIBRATED, UNTESTED
from core.monitor import MonitorRecipe, train
from core.planned_test.collection import collect
from tests.app.flights.test_flights import RECIPE, monitor
from tests.support.api import api, problem, store_of
from tests.support.flying import ScriptedClock
from tests.support.patience import PATIENCE
from tests.support.stored import EVALUATION

URL = "/api/v1/flights"
HEADERS = {"host": "127.0.0.1:8000", "origin": "http://127.0.0.1:8000"}


class Server:
    """The application in process, its flights on a scripted clock."""

    def __init__(self, client: TestClient) -> None:
        self.client = client
        self.clock = ScriptedClock()
        store = store_of(client)
        self.monitor_id = store.monitors.add(monitor(), "F-16 doublet").id
        self.flights: Flights = client.app.state.flights  # pyright: ignore
        self.flights._clock = self.clock
        client.app.state.frame_ticks = FrameTicks(self.clock)  # pyright: ignore
        self.flights._scenes = None

    def start(self, **choices: Any) -> dict[str, Any]:
        source = {"kind": "simulated", "outcome": "unsafe", "seed": 1}
        body = {"source": source, "monitor": self.monitor_id} | choices
        response = self.client.post(URL, json=body)
        assert response.status_code == 201, response.text
        assert response.headers["location"] == f"{URL}/{response.json()['id']}"
        return response.json()

    def steer(self, flight: str, action: str, value: Any = None) -> Any:
        body = {"action": action, "value": value}
        return self.client.post(f"{URL}/{flight}/transport", json=body)

    def advance(self, seconds: float) -> None:
        """Let the flights' clock pass, on the server's own loop."""
        portal = self.client.portal
        assert portal is not None
        for _ in range(round(seconds / 0.05)):
            portal.call(self.clock.advance, 0.05)

    def watch(self, flight: str) -> Any:
        return self.client.websocket_connect(f"{URL}/{flight}/stream", headers=HEADERS)


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    with api(tmp_path) as client:
        yield Server(client)


def until(socket: WebSocketTestSession, found: Callable[[dict], bool]) -> list[dict[str, Any]]:
    """Receive up to the first message of this kind, giving credit for frames."""
    messages = []
    while True:
        messages.append(msgspec.json.decode(socket.receive_text()))
        if messages[-1]["type"] == "frames":
            socket.send_text('{"type":"credit","n":1}')
        if found(messages[-1]):
            return messages


def alarms_of(messages: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [message["alarm"] for message in messages if message["type"] == "alarm"]


def frames_of(messages: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [frame for message in messages for frame in message.get("frames", [])]


def test_a_flight_is_started_listed_read_and_ended(server: Server) -> None:
    flight = server.start(name="first")
    assert (flight["name"], flight["progress"], flight["monitor"]) == (
        "first",
        "running",
        server.monitor_id,
    )
    assert flight["source"] == {"kind": "simulated", "outcome": "unsafe", "seed": 1}
    assert flight["epsilon"] == 0.3
    assert flight["transport"]["playing"]
    assert flight["fail_t"] > 0
    assert flight["theta"].keys() == set(monitor().theta_names)
    assert [one["id"] for one in server.client.get(URL).json()] == [flight["id"]]
    server.advance(1.0)
    assert server.client.get(f"{URL}/{flight['id']}").json()["head"] == 20
    assert "in progress" in problem(server.client.delete(f"{URL}/{flight['id']}"), 409)
    assert server.client.get(f"{URL}/{flight['id']}").json()["progress"] == "running"
    ended, again = (server.client.post(f"{URL}/{flight['id']}/end").json() for _ in range(2))
    assert (ended["progress"], ended["head"], ended["transport"]) == ("ended", 20, None)
    assert ended == again
    assert ended == server.client.get(f"{URL}/{flight['id']}").json()
    for _ in range(2):
        assert server.client.delete(f"{URL}/{flight['id']}").status_code == 204
        problem(server.client.get(f"{URL}/{flight['id']}"), 404)
    problem(server.client.delete(f"{URL}/0123456789ab"), 404)


def test_a_flight_started_for_a_viewer_waits_but_a_live_flight_does_not(server: Server) -> None:
    flight = server.start(wait_for_viewer=True)
    assert (flight["transport"]["waiting"], flight["reason"]) == (True, "waiting for a viewer")
    server.advance(5.0)
    with server.watch(flight["id"]) as socket:
        messages = until(socket, lambda m: m["type"] == "frames")
        assert [frame["t"] for frame in frames_of(messages)] == [0.0]
    assert "wait_for_viewer" not in flight["source"]
    live = server.start(source={"kind": "live"}, wait_for_viewer=True)
    assert (live["transport"]["waiting"], live["transport"]["playing"]) == (False, True)


def test_hello_then_every_frame_with_the_scores_of_the_batch(server: Server) -> None:
    flight = server.start()
    server.steer(flight["id"], "pause")
    server.steer(flight["id"], "seek", 0)
    with server.watch(flight["id"]) as socket:
        hello = Hello.model_validate_json(socket.receive_text())
        assert (hello.flight, hello.head, hello.credit) == (flight["id"], 1, CREDIT)
        assert hello.monitor == {"id": server.monitor_id, "name": "F-16 doublet"}
        server.steer(flight["id"], "play")
        messages = []
        for head in range(11, 122, 10):
            server.advance(0.5)
            messages += until(socket, lambda m, head=head: m.get("seq") == head)
        # one that a slow store keeps waiting is told twice
        while len(raised := {a["number"]: a["kind"] for a in alarms_of(messages)}) < 2:
            messages += until(socket, lambda m: m["type"] == "alarm")
    source = server.client.get(f"{URL}/{flight['id']}/source").json()["frames"]
    shown = frames_of(messages)
    assert len(source) == 121
    assert [f["seq"] for f in shown] == list(range(2, 122))
    attitudes = [(frame.pop("attitude"), frame.pop("integrated")) for frame in shown]
    assert all(integrated and len(angles) == 3 for angles, integrated in attitudes)
    for frame, expected in zip(shown, source[1:], strict=True):
        assert {**frame, "seq": 0, "sent": None} == {**expected, "seq": 0}
    track = server.flights.flying(flight["id"])._script._track  # pyright: ignore
    assert [f["p_value"] for f in source] == monitor().p_values(track.y).tolist()
    recorded = server.client.get(f"{URL}/{flight['id']}/assessments?first=2").json()
    assert recorded["frames"] == [{**frame, "sent": None} for frame in shown]
    assert (recorded["first"], recorded["next"]) == (2, None)
    assert list(raised.values()) == ["risk", "limit"]


def test_a_recipe_with_a_seed_of_many_bits_can_be_watched(server: Server) -> None:
    source = {"kind": "simulated", "recipe": {"seed": 2**100}}
    flight = server.start(source=source)
    with server.watch(flight["id"]) as socket:
        assert msgspec.json.decode(socket.receive_text())["type"] == "hello"


def test_the_record_is_read_in_parts(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.routes.dependencies.MOST_FRAMES", 30)
    flight = server.start()
    server.advance(6.5)
    seqs, first = [], 0
    while first is not None:
        part = server.client.get(f"{URL}/{flight['id']}/assessments?first={first}").json()
        seqs += [frame["seq"] for frame in part["frames"]]
        first = part["next"]
    assert seqs == list(range(121))
    part = server.client.get(f"{URL}/{flight['id']}/assessments?first=7&last=9").json()
    assert ([f["seq"] for f in part["frames"]], part["next"]) == ([7, 8, 9], None)


def test_frames_waiting_for_one_send_are_one_message(server: Server) -> None:
    flight = server.start()
    portal = server.client.portal
    assert portal is not None
    sending = ScriptedClock()
    server.client.app.state.frame_ticks = FrameTicks(sending)  # pyright: ignore
    with server.watch(flight["id"]) as socket:
        hello = msgspec.json.decode(socket.receive_text())
        server.advance(0.2)
        portal.call(sending.advance, TICK_S)
        message = until(socket, lambda message: message["type"] == "frames")[-1]
    assert hello["planned_s"] == RECIPE.maneuver.duration_s
    assert [frame["seq"] - hello["head"] for frame in message["frames"]] == [1, 2, 3, 4]


def test_a_watcher_without_credit_gets_a_count_of_missed_frames(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watcher, "LARGEST", NEWEST)
    flight = server.start()
    with server.watch(flight["id"]) as socket:
        hello = msgspec.json.decode(socket.receive_text())
        server.advance(4.0)
        socket.send_text('{"type":"credit","n":1}')
        seen: list[dict[str, Any]] = []
        while not any(message.get("conflated") and "frames" in message for message in seen):
            seen.append(msgspec.json.decode(socket.receive_text()))
    messages = [m for m in seen if m["type"] == "frames"]
    assert len(messages) == CREDIT + 1
    shown = [f["seq"] for f in frames_of(messages)]
    conflated = sum(m["conflated"] for m in messages)
    assert len(shown) + conflated == shown[-1] - hello["head"]
    assert shown[-1] == 80


def test_a_watcher_that_reconnects_resumes_without_a_gap_or_repeat(server: Server) -> None:
    flight = server.start()
    with server.watch(flight["id"]) as socket:
        server.advance(1.0)
        before = frames_of(until(socket, lambda m: m["type"] == "frames" and m["seq"] == 20))
    server.advance(2.0)
    with server.watch(flight["id"]) as socket:
        socket.receive_text()
        socket.send_text('{"type":"resume","seq":20}')
        backfill = until(socket, lambda m: m["type"] == "frames")
        server.advance(1.0)
        after = until(socket, lambda m: m["type"] == "frames" and m["seq"] == 80)
    seqs = [frame["seq"] for frame in [*before, *frames_of(backfill + after)]]
    assert seqs == list(range(seqs[0], 81))
    assert not [m for m in backfill + after if m["type"] == "reset"]


def test_all_watchers_see_the_same_of_two_simultaneous_acknowledgements(server: Server) -> None:
    flight = server.start()
    alarms = f"{URL}/{flight['id']}/alarms"
    with server.watch(flight["id"]) as one, server.watch(flight["id"]) as other:
        server.advance(6.5)
        raised = until(one, lambda m: m["type"] == "alarm")[-1]["alarm"]
        both = Barrier(2)

        def acknowledge(by: str) -> Any:
            both.wait(PATIENCE)
            path = f"{alarms}/{raised['id']}/acknowledge"
            return server.client.post(path, json={"by": by}).json()

        with ThreadPoolExecutor() as threads:
            told = [*threads.map(acknowledge, ("Ann", "Ben"))]
        shown = [
            until(socket, lambda m: m["type"] == "alarm" and m["alarm"]["by"] is not None)[-1]
            for socket in (one, other)
        ]
    assert told[0] == told[1]
    assert told[0]["by"] in ("Ann", "Ben")
    assert [message["alarm"] for message in shown] == told


def test_all_watchers_see_an_acknowledgement_over_rest(server: Server) -> None:
    flight = server.start()
    alarms = f"{URL}/{flight['id']}/alarms"
    with server.watch(flight["id"]) as socket:
        server.advance(6.5)
        raised = until(socket, lambda m: m["type"] == "alarm")[-1]["alarm"]
        told = server.client.post(f"{alarms}/{raised['id']}/acknowledge", json={"by": "FTE"})
        assert told.json()["by"] == "FTE"
        shown = until(socket, lambda m: m["type"] == "alarm" and m["alarm"]["by"] is not None)
        assert shown[-1]["alarm"] == told.json()
    again = server.client.post(f"{alarms}/{raised['id']}/acknowledge")
    assert again.json() == told.json()
    assert server.client.get(alarms).json()[0] == told.json()
    path = f"{URL}/{flight['id']}"
    under_way = server.client.get(path).json()
    server.client.post(f"{path}/end")
    for said in (under_way, server.client.get(path).json()):
        assert (said["open_alarms"], said["open_cautions"]) == (1, 0)
    problem(server.client.post(f"{alarms}/99/acknowledge"), 404)


def test_the_verdict_after_a_seek_to_the_exceedance(server: Server) -> None:
    flight = server.start()
    server.steer(flight["id"], "pause")
    server.steer(flight["id"], "seek", flight["fail_t"])
    server.client.post(f"{URL}/{flight['id']}/end")
    said = server.client.get(f"{URL}/{flight['id']}").json()
    assert said["verdict"]["text"] == "LIMIT EXCEEDED, samples before it not flown"
    assert said["verdict"]["exceeded_t"] == said["exceeded_t"]


def test_a_seek_past_an_exceedance_raises_its_alarm_and_is_in_the_verdict(
    server: Server,
) -> None:
    flight = server.start()
    path = f"{URL}/{flight['id']}"
    server.steer(flight["id"], "pause")
    server.steer(flight["id"], "seek", flight["fail_t"] + 1.0)
    limit = [alarm for alarm in server.client.get(f"{path}/alarms").json() if alarm["exceedance"]]
    assert [alarm["t"] for alarm in limit] == [pytest.approx(flight["fail_t"], abs=0.1)]
    server.client.post(f"{path}/end")
    said = server.client.get(path).json()
    assert said["verdict"]["text"] == "LIMIT EXCEEDED, samples before it not flown"
    assert said["exceeded_t"] == said["verdict"]["exceeded_t"] == limit[0]["t"]


def test_list_flight_and_stream_have_the_headline_and_the_final_verdict(
    server: Server,
) -> None:
    flight = server.start()["id"]
    with server.watch(flight) as socket:
        server.advance(6.5)
        *_, told = until(socket, lambda m: m["type"] == "status" and m["status"] == "exceeding")
        assert told["verdict"]["warning"] == "Warned 0.40 s before the limit"
        (under_way,) = server.client.get(URL).json()
        assert (under_way["status"], under_way["verdict"]) == ("alarm", told["verdict"])
        for alarm in server.client.get(f"{URL}/{flight}/alarms").json():
            server.client.post(f"{URL}/{flight}/alarms/{alarm['id']}/acknowledge")
        until(socket, lambda m: m["type"] == "status" and m["status"] == "not_calibrated")
    server.client.post(f"{URL}/{flight}/end")
    (ended,) = server.client.get(URL).json()
    assert (ended["progress"], ended["status"]) == ("ended", "exceeded")
    assert ended["verdict"] == told["verdict"]
    assert ended["verdict"]["text"] == "LIMIT EXCEEDED, warned 0.40 s before the limit"
    assert server.client.get(f"{URL}/{flight}").json() == ended
    stored = server.client.get(f"{URL}/{flight}/alarms").json()
    assert [(alarm["kind"], alarm["level"]) for alarm in stored] == [
        ("risk", "warning"),
        ("limit", "warning"),
    ]
    assert stored[1]["exceedance"]["channel"] == "Ny"


def test_all_watchers_see_transport_changes(server: Server) -> None:
    flight = server.start()
    with server.watch(flight["id"]) as socket:
        socket.receive_text()
        answer = server.steer(flight["id"], "seek", 2.0)
        assert answer.json()["position"] == 2.0
        messages = until(socket, lambda m: m["type"] == "frames" and m["frames"][-1]["t"] == 2.0)
        kinds = [message["type"] for message in messages]
        assert kinds.index("reset") < len(kinds) - 1
        assert messages[kinds.index("transport")]["transport"] == answer.json()


def test_one_screen_leads_and_programs_steer_all_the_same(server: Server) -> None:
    flight = server.start()["id"]
    path, headers = f"{URL}/{flight}/stream?screen=", HEADERS

    def steer(action: str, screen: str) -> Any:
        body = {"action": action, "screen": screen}
        return server.client.post(f"{URL}/{flight}/transport", json=body)

    def leader(socket: WebSocketTestSession) -> Any:
        return until(socket, lambda message: message["type"] == "screens")[-1]["leader"]

    connect = server.client.websocket_connect
    with connect(path + "a", headers=headers) as a:
        assert leader(a) is None
        with connect(path + "b", headers=headers):
            assert leader(a) is None
            assert steer("pause", "b").status_code == 200
            led = {"id": "b", "number": 2, "by": "local"}
            assert leader(a) == led
            assert "screen 2 leads" in problem(steer("play", "a"), 409)
            assert server.steer(flight, "play").json()["playing"]
        assert leader(a) == led  # it has left
        assert steer("lead", "a").status_code == 200
        assert leader(a)["id"] == "a"
    problem(steer("lead", "a"), 409)
    assert "a screen that shows a replay" in problem(server.steer(flight, "lead"), 422)
    live = server.start(source={"kind": "live"})["id"]
    body = {"action": "lead", "screen": "a"}
    problem(server.client.post(f"{URL}/{live}/transport", json=body), 422)


@pytest.mark.parametrize(
    ("action", "value", "status"),
    [
        ("warp", None, 422),
        ("speed", 11, 422),
        ("speed", "fast", 422),
        ("seek", None, 422),
        ("step", 1e300, 422),
        ("loop", 1, 422),
    ],
)
def test_an_invalid_action_is_a_problem(
    action: str, value: Any, status: int, server: Server
) -> None:
    problem(server.steer(server.start()["id"], action, value), status)


def test_an_action_that_is_impossible_now_is_a_conflict(server: Server) -> None:
    flight = server.start()["id"]
    server.steer(flight, "seek", 5.9)
    assert "no alert after" in problem(server.steer(flight, "next_alert"), 409)
    server.client.post(f"{URL}/{flight}/end")
    assert "is in progress" in problem(server.steer(flight, "play"), 404)


@pytest.mark.parametrize(
    ("change", "status", "text"),
    [
        ({"monitor": "none"}, 404, "none"),
        ({"epsilon": 0.01}, 422, "needs at least 99"),
        ({"epsilon": 2}, 422, "less than 1"),
        ({"source": {"kind": "seance"}}, 422, "seance"),
        ({"source": {"kind": "simulated", "theta": {"C_n": 1}}}, 422, "parameters C_n"),
        ({"source": {"kind": "simulated", "recipe": {"dt": 0.1}}}, 422, "every 0.1 s"),
        ({"source": {"kind": "simulated", "recipe": {"x": 1}}}, 422, "no 'x'"),
        ({"source": {"kind": "replay", "dataset": "none", "outcome": "safe", "rollout": 0}}, 404,
         "none"),
        ({"speed": 2}, 422, "speed"),
    ],
)  # fmt: skip
def test_an_impossible_flight_is_a_problem_with_the_reason(
    change: dict, status: int, text: str, server: Server
) -> None:
    body = {"source": {"kind": "simulated"}, "monitor": server.monitor_id} | change
    assert text in problem(server.client.post(URL, json=body), status)
    assert server.client.get(URL).json() == []


def test_a_useless_monitor_needs_acceptance_to_fly(server: Server) -> None:
    counts = EVALUATION["at_epsilon"] | {"false_alerts": 195}
    useless = replace(monitor(), evaluation=EVALUATION | {"epsilon": 0.3, "at_epsilon": counts})
    monitor_id = store_of(server.client).monitors.add(useless, "cries wolf").id
    body = {"source": {"kind": "simulated"}, "monitor": monitor_id}
    refused = server.client.post(URL, json=body)
    assert "of no use: only 0.5%" in problem(
        refused, 422
    )  # 195 of 200 have an alert, 4 are invalid
    assert refused.json()["type"] == "urn:forewarn:useless-monitor"
    assert server.client.get(URL).json() == []
    flown = server.start(monitor=monitor_id, accept_useless=True)
    assert flown["accept_useless"] is True
    with server.watch(flown["id"]) as socket:
        hello = Hello.model_validate_json(socket.receive_text())
    server.client.post(f"{URL}/{flown['id']}/end")
    over = server.client.get(f"{URL}/{flown['id']}").json()
    assert over["accept_useless"] is True
    warnings = server.client.get(f"/api/v1/monitors/{monitor_id}").json()["warnings"]
    assert warnings[1:] == [UNCALIBRATED]
    assert [flown["warnings"], hello.warnings, over["warnings"]] == [warnings] * 3
    untested = server.start()
    assert untested["accept_useless"] is False, "one that was not tested may be flown"
    assert untested["warnings"] == [UNTESTED, UNCALIBRATED]


def test_one_flight_too_many_is_refused(tmp_path: Path) -> None:
    with api(tmp_path, max_flights=1) as client:
        server = Server(client)
        server.start()
        source = {"kind": "simulated"}
        body = {"source": source, "monitor": server.monitor_id}
        assert "1 flights are in progress" in problem(client.post(URL, json=body), 429)


def test_a_replay_flies_a_stored_rollout(server: Server) -> None:
    from core.planned_test.collection import collect

    store = store_of(server.client)
    dataset = collect(RECIPE)
    dataset_id = store.datasets.add(dataset, "test").id
    source = {"kind": "replay", "dataset": dataset_id, "outcome": "unsafe", "rollout": 3}
    flight = server.start(source=source)
    assert flight["name"] == "unsafe rollout 3"
    frames = server.client.get(f"{URL}/{flight['id']}/source?first=10&last=12").json()["frames"]
    assert [frame["y"] for frame in frames] == dataset.unsafe[3, 10:13].tolist()


@pytest.mark.parametrize(
    "text", ["", "{}", "[1]", '{"type":"credit","n":0}', '{"type":"resume","seq":-2}', "\x00"]
)
def test_a_client_that_sends_nonsense_is_disconnected(text: str, server: Server) -> None:
    flight = server.start()
    with server.watch(flight["id"]) as socket:
        socket.receive_text()
        socket.send_text(text)
        assert until(socket, lambda m: m["type"] == "end")
        with pytest.raises(WebSocketDisconnect) as closed:
            socket.receive_text()
        assert closed.value.code == 1008
        assert '{"type": "credit", "n": 1}' in closed.value.reason
    server.client.get(f"{URL}/{flight['id']}")
    assert server.flights.flying(flight["id"]).n_watchers == 0


def test_a_client_that_sends_bytes_is_disconnected(server: Server) -> None:
    with server.watch(server.start()["id"]) as socket:
        socket.receive_text()
        socket.send_bytes(b"\x00")
        assert until(socket, lambda m: m["type"] == "end")
        with pytest.raises(WebSocketDisconnect):
            socket.receive_text()


def test_a_stream_of_an_unknown_flight_gives_the_reason_and_closes(server: Server) -> None:
    with server.watch("none") as socket:
        end = msgspec.json.decode(socket.receive_text())
        assert end["type"] == "end"
        assert "no flight none" in end["reason"]
        with pytest.raises(WebSocketDisconnect) as closed:
            socket.receive_text()
        assert closed.value.code == 4404


def test_the_end_of_a_flight_ends_its_streams(server: Server) -> None:
    flight = server.start()
    with server.watch(flight["id"]) as socket:
        server.advance(0.5)
        server.client.post(f"{URL}/{flight['id']}/end")
        messages = until(socket, lambda m: m["type"] == "end")
        assert frames_of(messages)[-1]["seq"] == 10
        with pytest.raises(WebSocketDisconnect) as closed:
            socket.receive_text()
        assert closed.value.code == 1000


def test_a_heartbeat_is_sent_each_second(server: Server) -> None:
    flight = server.start()
    server.steer(flight["id"], "pause")
    with server.watch(flight["id"]) as socket:
        socket.receive_text()
        for _ in range(3):
            server.advance(1.0)
            (beat,) = until(socket, lambda m: m["type"] == "heartbeat")
            assert (beat["lost"], beat["conflated"]) == (0, 0)


def test_the_monitors_of_a_flight_are_compared_by_its_frames(server: Server) -> None:
    other = train(collect(RECIPE), MonitorRecipe(t_early=0.5, epsilon=0.2))
    further = store_of(server.client).monitors.add(other, "further").id
    flight = server.start(monitors=[further])["id"]
    server.advance(1.0)
    server.steer(flight, "seek", 0.0)  # the longest pass counts
    server.advance(8.0)
    answer = server.client.get(f"{URL}/{flight}/comparison").json()
    server.client.post(f"{URL}/{flight}/end")
    assert server.client.get(f"{URL}/{flight}/comparison").json() == answer
    frames = server.client.get(f"{URL}/{flight}/assessments").json()["frames"]
    start = max(k for k, frame in enumerate(frames) if frame["t"] == 0.0)
    frames = frames[start:]
    assert (answer["start"], answer["end"], answer["n_samples"]) == (
        0.0,
        frames[-1]["t"],
        len(frames),
    )
    pairs = [(frame, frame["display"][0]) for frame in frames]
    for side, compared in enumerate(answer["monitors"]):
        assessed = [pair[side] for pair in pairs if pair[side]["state"] == "ok"]
        assert compared["n_assessed"] == len(assessed)
        n_alerting = sum(each["alert"] for each in assessed)
        spans = [(each["start"], each["end"]) for each in compared["alerts"]]
        inside = [f["t"] for f in frames if any(a <= f["t"] <= b for a, b in spans)]
        assert len(inside) == n_alerting
        first = min(a for a, _ in spans)
        assert compared["reached"] == pytest.approx(answer["exceeded_t"] - first)
    assert [each["name"] for each in answer["monitors"]] == ["F-16 doublet", "further"]
    assert answer["monitors"][0]["differences"] is None
    apart = {
        frame["t"]: abs(frame["p_value"] - beside["p_value"])
        for frame, beside in pairs
        if frame["state"] == beside["state"] == "ok"
    }
    found = answer["monitors"][1]["differences"]
    assert found["n_both"] == len(apart)
    largest = found["largest"]
    assert abs(largest["second"] - largest["first"]) == apart[largest["t"]] == max(apart.values())


def test_a_flight_without_samples_compares_none(server: Server) -> None:
    flight = server.start(source={"kind": "live"})["id"]
    answer = server.client.get(f"{URL}/{flight}/comparison").json()
    assert (answer["start"], answer["n_samples"], answer["exceeded_t"]) == (None, 0, None)
    problem(server.client.get(f"{URL}/0123456789ab/comparison"), 404)
