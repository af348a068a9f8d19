"""Live flights: the batch's bits, stale by the clock, durable, the same again from the journal."""

import asyncio
import json
import socket
from collections.abc import Callable, Coroutine
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.assessment.batches import ChannelReader
from app.flights.sources.live import LiveFlight, LiveSetup, SequenceConflict
from app.flights.sources.udp import UdpAccess
from app.flights.transport import NotPossible
from app.telemetry.journal import Journals, lines_of
from app.telemetry.mapping.mapping import ChannelSource, Mapping, TimeSource
from app.telemetry.recording import TelemetryError
from core.channels import KEYS
from core.monitor import State
from core.monitor.status import Status
from tests.support.flying import (
    EPSILON,
    ScriptedClock,
    Seen,
    SilentRecorder,
    T,
    exact_monitor,
    failing_flight,
    plan,
)
from tests.support.live_server import assessed_again
from tests.support.oscillator import DT, N_SAMPLES, Array
from tests.support.patience import PATIENCE


def batch(k: int, y: Array, **more: Any) -> str:
    channels = dict(zip(KEYS, y.tolist(), strict=True))
    return json.dumps({"sequence": k, "t": T[k], **channels, **more})


class Live:
    """A live flight with its clock and watcher."""

    def __init__(self, root: Path, reader: ChannelReader | None = None, **more: Any) -> None:
        self.clock, self.journals = ScriptedClock(), Journals(root)
        self.over: list[tuple[str, str]] = []
        self.recorder = SilentRecorder(self.clock)
        about: dict[str, Any] = {"trim": "none"} | more
        reader = reader or ChannelReader()
        monitor = exact_monitor()
        self.setup = LiveSetup(monitor, EPSILON, reader, self.journals, 0.0, **about)
        self.flight = self.another(self.recorder)
        self.seen = Seen(self.flight.watch())
        self.flight.start()

    def another(self, recorder: SilentRecorder) -> LiveFlight:
        about = recorder, self.clock, lambda *how: self.over.append(how)
        return LiveFlight(plan(exact_monitor()), self.setup, *about)

    def push(self, k: int, y: Array, **more: Any) -> Any:
        """Sample k as it is due."""
        self.clock.advance(DT)
        received = self.flight.receive(batch(k, y, **more), "rest")
        self.seen.take()
        return received

    def advance(self, seconds: float) -> None:
        self.clock.advance(seconds)
        self.seen.take()

    async def close(self) -> None:
        await self.flight.stop("enough")
        self.seen.take()
        self.journals.close()


def flown(fly: Callable[[Live, Array], Coroutine[Any, Any, None]], root: Path, **more: Any) -> None:
    async def run() -> None:
        live = Live(root, **more)
        await fly(live, failing_flight())
        await live.close()

    asyncio.run(run())


def test_a_live_source_is_scored_as_the_batch_and_shown_at_once(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        for k in range(N_SAMPLES):
            live.push(k, y[k])
            assert live.seen.frames[-1]["t"] == T[k]
        expected = exact_monitor().assess(T, y, EPSILON)
        assert [f["p_value"] for f in live.seen.frames] == expected.p_value.tolist()
        assert len(live.seen.of("alarm")) == 1
        assert len(live.recorder.waiting(0, 1000)) == N_SAMPLES
        await live.close()
        assert live.seen.messages[-1] == {"type": "end", "reason": "enough"}

    flown(fly, tmp_path)


def test_the_journal_alone_gives_the_bits_that_were_shown(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        rng = np.random.default_rng(3)
        for k in rng.permutation(N_SAMPLES):
            live.clock.advance(float(rng.exponential(DT)))
            live.flight.receive(batch(int(k), y[k]), "rest")
            live.seen.take()
        await live.close()
        again = assessed_again(live.setup, live.flight.id)
        assert [one.assessment.t for one in again] == [f["t"] for f in live.seen.frames]
        assert [one.assessment.p_value for one in again] == [f["p_value"] for f in live.seen.frames]

    flown(fly, tmp_path)


def test_a_flight_of_a_killed_server_goes_on_with_the_same_bits(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        for k in range(40):
            await live.push(k, y[k]).stored
        live.clock.freeze(1.0)
        recorder = SilentRecorder(live.clock)
        flight = live.another(recorder)
        lines = lines_of(live.journals.path(flight.id))
        flight.resume(flight.restore(lines, 29, [], []))
        assert (flight.state, flight.head) == (State.STALE, 39)
        assert [sample.seq for sample in recorder.waiting(0, 1000)] == [*range(30, 40)]
        assert (flight.live.last_sequence, flight.live.resumed) == (39, 1)
        assert flight.receive(batch(39, y[39]), "rest").repeated
        with pytest.raises(SequenceConflict, match="the newest is 39"):
            flight.receive(batch(39, y[0]), "rest")
        flight.receive(batch(40, y[40]), "rest")
        expected = exact_monitor().assess(T, y, EPSILON)
        newest = recorder.waiting(40, 40)[0].assessment
        assert newest.p_value == expected[40].p_value
        await flight.stop("enough")

    flown(fly, tmp_path)


def test_a_withdrawal_that_outlasts_a_restart_rings_no_more(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        for k in range(40):
            await live.push(k, 0.0 * y[k], **({"beta": None} if k >= 20 else {})).stored
        alarms = [a for a in live.flight.alarms.at_hand if a.kind == "invalid"]
        assert len(alarms) == 1
        acknowledged = [replace(alarm, acknowledged="now", by="FTE") for alarm in alarms]
        again = live.another(SilentRecorder(live.clock))
        lines = lines_of(live.journals.path(again.id))
        again.resume(again.restore(lines, live.flight.head, acknowledged, []))
        live.clock.advance(DT)
        again.receive(batch(40, 0.0 * y[40], beta=None), "rest")
        assert again.facts.invalid
        assert [a.kind for a in again.alarms.at_hand].count("invalid") == 1
        await again.stop("enough")

    flown(fly, tmp_path)


def test_the_source_began_at_the_arrival_of_its_fastest_sample_less_its_time(
    tmp_path: Path,
) -> None:
    async def fly(live: Live, y: Array) -> None:
        assert live.flight.live.time_zero == ""
        began = datetime.fromisoformat(live.clock.utc())
        live.clock.advance(2.0)
        for k in range(5):
            await live.push(k, y[k]).stored
        fastest = timedelta(seconds=2.0 + DT - T[0])
        zero = live.flight.live.time_zero
        assert abs(datetime.fromisoformat(zero) - began - fastest) <= timedelta(milliseconds=1)
        again = live.another(SilentRecorder(live.clock))
        again.restore(lines_of(live.journals.path(again.id)), 4, [], [])
        assert again.live.time_zero == zero

    flown(fly, tmp_path)


def test_a_restart_counts_exceedances_as_before(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        y = np.zeros_like(y)
        y[5:15, 3] = y[40:50, 3] = 0.6
        for k in range(55):
            await live.push(k, y[k]).stored
        alarms = [alarm for alarm in live.flight.alarms.at_hand if alarm.kind == "limit"]
        again = live.another(SilentRecorder(live.clock))
        lines = lines_of(live.journals.path(again.id))
        again.resume(again.restore(lines, 54, alarms, []))
        assert [one.n for one in again.exceedances.of_channels] == [2]
        assert again.exceedances.of_channels == live.flight.exceedances.of_channels
        assert [alarm for alarm in again.alarms.at_hand if alarm.kind == "limit"] == alarms
        await again.stop("enough")

    flown(fly, tmp_path)


def test_an_exceedance_that_outlasts_a_restart_is_one_alarm(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        y = np.zeros_like(y)
        y[5:45, 3] = y[50:, 3] = 0.6
        for k in range(40):
            await live.push(k, y[k]).stored
        alarms = live.flight.alarms.at_hand
        again = live.another(SilentRecorder(live.clock))
        again.resume(again.restore(lines_of(live.journals.path(again.id)), 39, alarms, []))
        counts = []
        for k in range(40, 60):
            live.clock.advance(DT)
            again.receive(batch(k, y[k]), "rest")
            if k == 43:
                again.acknowledge("1", "FTE", "now")
            counts.append([alarm.kind for alarm in again.alarms.at_hand].count("limit"))
        assert counts == [1] * 10 + [2] * 10
        await again.stop("enough")

    flown(fly, tmp_path)


@pytest.mark.parametrize("n_recorded", [39, 40])
def test_an_exceedance_that_only_the_sensor_showed_before_a_kill_is_one_alarm(
    tmp_path: Path, n_recorded: int
) -> None:
    """Its grid sample is settled after the restart."""

    async def fly(live: Live, y: Array) -> None:
        y = np.zeros_like(y)
        y[40:, 3] = 0.6
        for k in range(41):
            await live.push(k, y[k]).stored
        alarms = [alarm for alarm in live.flight.alarms.at_hand if alarm.kind == "limit"]
        assert len(alarms) == 1
        again = live.another(SilentRecorder(live.clock))
        lines = lines_of(live.journals.path(again.id))
        again.resume(again.restore(lines, n_recorded - 1, alarms, []))
        live.clock.advance(5.0)
        for k in range(41, 50):
            live.clock.advance(DT)
            again.receive(batch(k, y[k]), "rest")
        assert [alarm.kind for alarm in again.alarms.at_hand].count("limit") == 1
        await again.stop("enough")

    flown(fly, tmp_path)


@pytest.mark.parametrize("is_recorded", [True, False])
def test_an_acknowledged_risk_that_outlasts_a_restart_rings_no_more(
    tmp_path: Path, is_recorded: bool
) -> None:
    """Also if the server was killed between the records of the alarm and of its sample."""

    async def fly(live: Live, y: Array) -> None:
        k = 0
        while not (alarms := [a for a in live.flight.alarms.at_hand if a.kind == "risk"]):
            await live.push(k, y[k]).stored
            k += 1
        for _ in range(2):
            await live.push(k, y[k]).stored
            k += 1
        assert live.flight.facts.alert
        acknowledged = [replace(alarm, acknowledged="now", by="FTE") for alarm in alarms]
        again = live.another(SilentRecorder(live.clock))
        lines = lines_of(live.journals.path(again.id))
        stored = live.flight.head if is_recorded else alarms[0].seq - 1
        again.resume(again.restore(lines, stored, acknowledged, []))
        live.clock.advance(DT)
        again.receive(batch(k, y[k]), "rest")
        assert again.facts.alert
        assert [a.kind for a in again.alarms.at_hand].count("risk") == 1
        await again.stop("enough")

    flown(fly, tmp_path)


def test_what_the_clock_settled_before_a_kill_is_not_recorded_twice(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        for k in (0, 1, 3):
            await live.push(k, y[k]).stored
        live.advance(1.5 * DT)
        assert live.flight.head == 2
        recorder = SilentRecorder(live.clock)
        flight = live.another(recorder)
        flight.resume(flight.restore(lines_of(live.journals.path(flight.id)), 2, [], []))
        flight.receive(batch(4, y[4]), "rest")
        assert [sample.seq for sample in recorder.waiting(0, 1000)] == [3]
        await flight.stop("enough")

    flown(fly, tmp_path)


def test_a_late_source_is_stale_by_the_clock_and_recovers(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        live.push(0, y[0])
        live.advance(0.2)
        assert live.flight.state is State.OK
        live.advance(0.1)
        assert live.seen.of("state")[-1]["state"] == "stale"
        assert live.seen.of("state")[-1]["reason"] == "no sample comes"
        assert live.seen.of("alarm")[-1]["alarm"]["kind"] == "stale"
        live.advance(10.0)
        assert [m["state"] for m in live.seen.of("state")].count("stale") == 1
        live.push(60, y[60], t=10.35)
        assert live.seen.of("state")[-1]["state"] == "warming_up"

    flown(fly, tmp_path)


def test_channels_that_go_missing_while_the_monitor_is_withdrawn_are_a_caution(
    tmp_path: Path,
) -> None:
    async def fly(live: Live, y: Array) -> None:
        missing = [*["beta"] * 3, *["Ny"] * 3, *["beta", "Ny"] * 3, "Ny"]
        for k in range(5 + len(missing)):
            live.push(k, y[k], **({missing[k - 5]: None} if k >= 5 else {}))
        raised = {m["alarm"]["id"]: m["alarm"]["reason"] for m in live.seen.of("alarm")}
        assert list(raised.values()) == ["beta is missing", "Ny is missing"]

    flown(fly, tmp_path)


def test_a_source_that_has_not_begun_is_waited_for(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        live.advance(0.3)
        assert (live.flight.state, live.flight.reason) == (
            State.NO_DATA,
            "no sample yet",
        )
        assert not live.seen.of("state")
        assert not live.seen.of("alarm")

    flown(fly, tmp_path)


def test_a_source_that_falls_behind_raises_one_caution(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        for k in range(40):
            live.clock.advance(DT)
            live.push(k, y[k])
        raised = {m["alarm"]["id"]: m["alarm"] for m in live.seen.of("alarm")}
        (caution,) = (alarm for alarm in raised.values() if alarm["kind"] == "stale")
        assert caution["reason"] == f"samples come more than {live.flight.lead:g} s late"
        assert [told["state"] for told in live.seen.of("state")].count("stale") == 1

    flown(fly, tmp_path)


def test_samples_that_come_long_after_the_quickest_are_not_shown_as_now(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        for k in range(20):
            live.push(k, y[k])
        live.advance(5.0)
        live.push(20, y[20])
        assert live.flight.state is State.STALE
        assert live.flight.reason == f"samples come more than {live.flight.lead:g} s late"
        assert live.flight.live.lag == pytest.approx(5.0)
        n_told = len(live.seen.of("state"))
        for k in range(21, 30):
            live.push(k, y[k])
            assert Status.STALE in (live.flight.headline.status, *live.flight.headline.beside)
        assert {said["state"] for said in live.seen.of("state")[n_told:]} <= {"stale"}

    flown(fly, tmp_path)


def exceeding(live: Live) -> list[float]:
    live.seen.take()
    alarms = {m["alarm"]["id"]: m["alarm"] for m in live.seen.of("alarm")}
    return [alarm["exceedance"]["value"] for alarm in alarms.values() if alarm["kind"] == "limit"]


def test_a_limit_exceeded_between_two_times_of_the_monitor_is_an_alarm(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        for k in range(30):
            live.push(2 * k, 0.0 * y[0], t=k * DT)
            live.push(2 * k + 1, 0.0 * y[0], t=(k + 0.5) * DT, Ny=0.9 if k == 20 else 0.0)
        assert exceeding(live) == [0.9]

    flown(fly, tmp_path)


def test_a_late_sample_that_exceeds_a_limit_is_an_alarm(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        for k in (*range(20), *range(21, 30)):
            live.push(k, 0.0 * y[0])
        live.push(20, 0.0 * y[0], Ny=9.0)
        live.push(30, 0.0 * y[0])
        assert live.flight.live.counts["late"] == 1
        assert exceeding(live) == [9.0]

    flown(fly, tmp_path)


def test_samples_that_are_left_out_do_not_keep_a_flight_from_being_stale(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        live.push(0, y[0])
        for k in range(1, 10):
            live.push(k, y[0], t=0.0)
        assert live.flight.state is State.STALE

    flown(fly, tmp_path)


def test_what_waits_is_settled_by_the_clock(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        for k in (0, 1, 3):
            live.push(k, y[k])
        assert live.flight.head == 1
        live.advance(1.5 * DT)
        assert live.flight.head == 2
        assert live.seen.frames[-1]["t"] == T[3]

    flown(fly, tmp_path)


def test_a_flight_begins_with_all_channels_and_then_names_what_is_missing(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        with pytest.raises(TelemetryError, match="missing channels: beta"):
            live.flight.receive(batch(0, y[0], beta=None), "rest")
        with pytest.raises(TelemetryError, match="beta of 20 rad is implausible: check its unit"):
            live.flight.receive(batch(0, y[0], beta=20.0), "rest")
        assert "beta of 20 rad is implausible" in live.flight.live.refused
        live.push(0, y[0])
        assert live.flight.live.refused == ""
        live.push(1, y[1], beta=None)
        assert live.flight.reason == "beta is missing"
        live.push(2, y[2], beta=20.0)
        assert live.flight.reason == "beta of 20 rad is implausible"
        assert live.flight.live.malformed == 2

    flown(fly, tmp_path)


@pytest.mark.parametrize(
    ("content", "error"),
    [
        (b"{", "not JSON"),
        (b"[1]", "not a JSON object"),
        (b'{"sequence": -1, "t": 0}', "number the batches"),
        (b'{"sequence": 1, "beta": 0}', "no time 't'"),
        (b'{"t": [0, 1], "beta": [0]}', "send equally many"),
        (b'{"t": [0, "x"], "beta": [0, 1]}', "non-number"),
        (b'{"t": null, "beta": 1}', "missing or infinite"),
        (b'{"a":{"a":{"a":{"a":{"a":{"a":1}}}}}}', "too deeply"),
    ],
)
def test_what_is_no_batch_is_refused_with_what_is_needed(
    tmp_path: Path, content: bytes, error: str
) -> None:
    async def fly(live: Live, y: Array) -> None:
        with pytest.raises(TelemetryError, match=error):
            live.flight.receive(content, "rest")

    flown(fly, tmp_path)


def test_channels_are_read_by_a_mapping_with_units_signs_and_derivations(tmp_path: Path) -> None:
    channels = {
        key: ChannelSource(f"{key}_deg", unit, -1 if key == "r" else 1)
        for key, unit in zip(KEYS[:5], ("deg", "rad/s", "rad/s", "g", "rad"), strict=True)
    }
    channels["delta_r_left"] = ChannelSource("left", "rad")
    channels["delta_r"] = ChannelSource(derivation="delta_r_of_left")
    reader = ChannelReader(Mapping(channels, {"": TimeSource("clock", "ms")}))

    async def fly(live: Live, y: Array) -> None:
        for k in range(2):
            sent = {f"{key}_deg": float(y[k, KEYS.index(key)]) for key in KEYS[:5]}
            sent |= {"left": float(y[k, 5]), "clock": 1e3 * T[k], "sequence": k}
            sent["beta_deg"] = float(np.degrees(sent["beta_deg"]))
            sent["r_deg"] = -sent["r_deg"]
            live.flight.receive(json.dumps(sent), "rest")
        live.seen.take()
        assert live.seen.frames[1]["t"] == pytest.approx(T[1])
        assert live.seen.frames[1]["y"] == pytest.approx(y[1].tolist())

    flown(fly, tmp_path, reader=reader)


def test_a_mapping_that_needs_the_future_is_refused() -> None:
    channels = {
        "phi": ChannelSource("phi", "rad"),
        "p": ChannelSource(derivation="p_from_attitude"),
    }
    with pytest.raises(TelemetryError, match="future samples"):
        ChannelReader(Mapping(channels, {"": TimeSource("t")}))


KEY = "a key of the range"


class Sender:
    """A socket that sends datagrams to a flight."""

    def __init__(self, flight: LiveFlight) -> None:
        host, port = str(flight.live.udp).split(":")
        self._to = host, int(port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((host, 0))
        self.address = f"{host}:{self._socket.getsockname()[1]}"

    def __enter__(self) -> "Sender":
        return self

    def __exit__(self, *error: object) -> None:
        self._socket.close()

    def send(self, *lines: str) -> None:
        self._socket.sendto("\n".join(lines).encode(), self._to)


async def until(holds: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not holds():
            await asyncio.sleep(0.001)


def test_datagrams_come_from_one_sender_until_a_person_changes_it(tmp_path: Path) -> None:
    flights: list[LiveFlight] = []

    async def fly(live: Live, y: Array) -> None:
        flight = live.flight
        flights.append(flight)
        with Sender(flight) as sender, Sender(flight) as other:
            lines = [batch(k, y[k]) for k in range(7)]
            sender.send("nonsense")
            sender.send(*lines[:2])
            other.send(lines[2])
            sender.send(lines[3])
            await until(lambda: flight.live.batches == 3)
            assert (flight.live.malformed, flight.live.foreign) == (1, 1)
            assert (flight.live.sender, flight.live.other_sender) == (sender.address, other.address)
            live.clock.advance(5.0)  # silence changes nothing
            other.send(lines[2])
            await until(lambda: flight.live.foreign == 2)
            flight.change_sender(other.address, "FTE")
            sender.send(lines[4])
            other.send(lines[5])
            await until(lambda: flight.live.batches == 4)
            assert (flight.live.foreign, flight.live.other_sender) == (3, sender.address)
        await flight.stop("the server is stopping")
        again = live.another(live.recorder)
        again.restore(lines_of(live.journals.path(flight.id)), -1, [], [])
        again.resume([])
        assert again.live.sender == other.address
        await again.stop("enough")

    flown(fly, tmp_path, udp=0)
    assert str(flights[0].live.udp).startswith("127.0.0.1:")


def test_datagrams_need_the_key_of_the_server(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        flight = live.flight
        with Sender(flight) as wrong, Sender(flight) as right:
            for given in ({}, {"key": "another"}, {"key": 7}):
                wrong.send(batch(0, y[0], **given))
            right.send(batch(0, y[0], key=KEY))
            await until(lambda: flight.live.batches == 1)
            assert (flight.live.foreign, flight.live.sender) == (3, right.address)
            assert flight.live.unread == []
        journal = live.journals.path(flight.id).read_text()
        assert KEY not in journal

    flown(fly, tmp_path, udp=0, access=UdpAccess(key=KEY))


def test_datagrams_come_from_the_listed_networks_alone(tmp_path: Path) -> None:
    assert UdpAccess(senders=("10.1.0.0/24",)).admits("10.1.0.7")
    assert UdpAccess(senders=("10.1.0.0/24",)).admits("::ffff:10.1.0.7")
    assert not UdpAccess(senders=("10.1.0.0/24",)).admits("10.1.1.7")

    async def fly(live: Live, y: Array) -> None:
        with Sender(live.flight) as sender:
            sender.send(batch(0, y[0]))
            await until(lambda: live.flight.live.foreign == 1)
        assert live.flight.live.batches == 0

    flown(fly, tmp_path, udp=0, access=UdpAccess(senders=("10.1.0.0/24",)))


def test_a_live_flight_cannot_be_steered_and_takes_nothing_when_it_is_over(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        with pytest.raises(NotPossible, match="cannot be steered"):
            live.flight.act("pause")
        with pytest.raises(NotPossible, match="read assessments"):
            live.flight.source_frames(0, 1)
        with pytest.raises(NotPossible, match="are from trim"):
            live.flight.begin_manoeuvre("FTE")
        await live.close()
        with pytest.raises(NotPossible, match="has ended"):
            live.flight.receive(batch(0, y[0]), "rest")

    flown(fly, tmp_path)


def test_the_age_is_that_of_when_a_sample_was_taken_and_grows_while_none_comes(
    tmp_path: Path,
) -> None:
    async def fly(live: Live, y: Array) -> None:
        for k in range(20):
            live.push(k, y[k])
        assert live.flight.age == pytest.approx(0.0, abs=1e-9)
        assert live.seen.frames[-1]["taken"] == live.seen.frames[-1]["sent"]
        live.advance(5.0)
        live.push(20, y[20])
        newest = live.seen.frames[-1]
        assert newest["sent"] - newest["taken"] == pytest.approx(5000.0)
        assert live.flight.age == pytest.approx(5.0)
        live.advance(40.0)
        assert live.flight.age == pytest.approx(45.0)
        assert (live.flight.state, live.flight.reason) == (State.STALE, "no sample comes")

    flown(fly, tmp_path)


def test_after_a_restart_the_age_goes_on_and_late_samples_are_late(tmp_path: Path) -> None:
    async def fly(live: Live, y: Array) -> None:
        for k in range(40):
            await live.push(k, y[k]).stored
        live.advance(5.0)
        flight = live.another(SilentRecorder(live.clock))
        flight.resume(flight.restore(lines_of(live.journals.path(flight.id)), 39, [], []))
        before = flight.age
        assert before is not None
        assert before >= 5.0
        live.clock.advance(2.0)
        assert flight.age == pytest.approx(before + 2.0)
        flight.receive(batch(40, y[40]), "rest")
        assert flight.reason.startswith("samples come ")
        for k in range(41, 182):  # the source sends again what it could not
            flight.receive(batch(0, y[40], sequence=k, t=k * DT), "rest")
        (late,) = flight.live.late
        assert late.start == T[39]
        assert late.end == pytest.approx(9.0 - flight.lead, abs=2 * DT)
        await flight.stop("enough")

    flown(fly, tmp_path)
