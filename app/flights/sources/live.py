"""The flight of a live source: assessed as its samples arrive, stale when they stop.

Every batch is journalled as received, with its arrival time, and then scored. The display follows
from the journal alone, so it can be computed again from it, also after the server was killed.
"""

import asyncio
from array import array
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from functools import partial
from math import inf, isfinite
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import msgspec
import numpy as np

from app.assessment.batches import Batch, ChannelReader, decode_batch
from app.assessment.monitors_in_use import MonitorsInUse
from app.assessment.recorded import RECEIVED_NEAR
from app.assessment.rulings import LimitsInForce, Ruling
from app.assessment.scorer import (
    CausalScorer,
    LiveAssessed,
    ReceivedExceedance,
    TrimRule,
    replay_line,
)
from app.flights.alarms import REJOIN_S, gives_alarm
from app.flights.clock import Clock
from app.flights.display_monitors import DisplayMonitor
from app.flights.flight import MARKERS_KEPT, Angles, Flight, FlightPlan, stale_after
from app.flights.recorder import JOURNALLED_S, Recorder
from app.flights.sources.simulated import SourceError
from app.flights.sources.udp import UdpAccess, UdpReceiver
from app.flights.transport import NotPossible
from app.messages import (
    ConditionSignal,
    LateInterval,
    LiveChange,
    LiveStatus,
    ManoeuvreBegun,
    TransportState,
)
from app.telemetry.journal import Journal, JournalFull, Journals
from app.telemetry.readers.journal import CALL
from app.telemetry.recording import TelemetryError
from core.channels import LATERAL
from core.conditions import CONDITION_KEYS, CONDITIONS, ConditionKey
from core.flight_events import Alarm, FlightMarker, FlightMarkerKey, TrimChange
from core.limits.exceedance import Exceeded, exceeded_at
from core.monitor import Assessment, Monitor, State
from core.monitor.peak_forecast import Ahead
from core.monitor.status import AlarmKind, Level
from core.simulation.attitude import DisplayAttitude
from core.types import Array

if TYPE_CHECKING:
    import hashlib

    from app.scene.scene import Scene

BEGUN_KEPT = 50
"""Newest manoeuvres whose beginnings are shown."""
UNREAD_KEPT, LONGEST_NAME, LONGEST_REASON = 20, 60, 300
"""Unread names that are shown, letters of each, and letters of a refusal."""
BATCHES_KEPT, NO_BATCH = 200_000, -1
"""Newest batches remembered, if the source numbers them consecutively."""
FORMAT = 1
UDP = "UDP "
"""Before the sender of a batch that came as a datagram."""


class SequenceConflict(ValueError):
    """A sequence number that another batch already has."""


class AcceptedBatch(NamedTuple):
    """The result of a batch.

    stored: done once it is durable.   unread: names in it that nothing reads.
    """

    sequence: int | None
    n_samples: int
    repeated: bool
    stored: "asyncio.Future[None]"
    unread: Sequence[str] = ()


class LiveSetup(NamedTuple):
    """What a live flight is started with. delay: [s], DELAY_INTERVALS of the monitor if None.

    udp: port to listen on, 0 for any; None for none.   access: who may send to it.
    aircraft: name of the one whose mapping is used.   display: monitors without alarms.
    monitors: a set, of which `monitor` is the first one; None for `monitor` throughout.
    """

    monitor: Monitor
    epsilon: float
    reader: ChannelReader
    journals: Journals
    theta0: float
    delay: float | None = None
    trim: TrimRule = "detected"
    udp: int | None = None
    access: UdpAccess = UdpAccess()
    aircraft: str | None = None
    display: tuple[DisplayMonitor, ...] = ()
    monitors: MonitorsInUse | None = None

    @property
    def dt(self) -> float:
        return self.monitor.dt

    def display_attitude(self) -> DisplayAttitude | None:
        """Integrates missing angles from roll and yaw rate; None for other channels."""
        return DisplayAttitude(self.theta0) if self.monitor.dictionary == LATERAL else None

    def scorer(self) -> CausalScorer:
        display = [(shown.monitor, shown.epsilon) for shown in self.display]
        about = self.monitor, self.epsilon, self.delay, self.trim, display, self.monitors
        return CausalScorer(*about)


@dataclass
class JournalReplay:
    """What a flight has read of its journal.

    arrived: of the newest line [s].   waiting: settled samples that the record lacks, each with the
    received ones beyond a limit that belong before it.   exceeding: those beyond a limit so far.
    since: when what raises an alarm of a kind began, where it holds [s].
    """

    arrived: float = 0.0
    waiting: deque[tuple[LiveAssessed, list[ReceivedExceedance]]] = field(default_factory=deque)
    exceeding: list[tuple[ReceivedExceedance, Exceeded]] = field(default_factory=list)
    since: dict[AlarmKind, float] = field(default_factory=dict)


class KnownBatches:
    """Digests of batches by sequence, 16 bytes each: a tenth of what objects would take."""

    def __init__(self, kept: int = BATCHES_KEPT) -> None:
        self._kept = kept
        self._sequences, self._digests = array("q"), array("Q")

    def note(self, sequence: int, digest: int) -> None:
        """Remember a batch, in place of the one `kept` numbers before. digest: below 2**64."""
        slot = sequence % self._kept
        if (lacking := slot + 1 - len(self._sequences)) > 0:
            self._sequences.extend([NO_BATCH] * lacking)
            self._digests.extend([0] * lacking)
        self._sequences[slot], self._digests[slot] = sequence, digest

    def digest(self, sequence: int) -> int | None:
        """Digest of a batch; None if it is unknown or too old."""
        slot = sequence % self._kept
        is_known = slot < len(self._sequences) and self._sequences[slot] == sequence
        return self._digests[slot] if is_known else None


class LiveFlight(Flight):
    """A flight of a live source. `receive` accepts batches until a person ends the flight."""

    def __init__(self, plan: FlightPlan, setup: LiveSetup, *about: Any, **more: Any) -> None:
        self.scorer = setup.scorer()
        self._near = RECEIVED_NEAR * setup.dt
        super().__init__(plan, *about, **more)
        self._pace_recorder()
        self.dt, self.is_checked = setup.dt, plan.monitor.support is not None
        self._setup, self._stale_after = setup, stale_after(setup.dt)
        self._replay = JournalReplay()
        self.needed = self.scorer.needed
        self._display = setup.display_attitude()
        self._keys = setup.monitor.dictionary.keys
        self._began = self._last_arrival = self.clock.now()
        self._began_utc = self.clock.utc()
        self._settled = 0.0
        self._journal: Journal | None = None
        self.is_restoring = False
        self.digest: hashlib._Hash | None = None
        self._udp: UdpReceiver | None = None
        self._port = setup.udp
        self._sender: str | None = None
        self._known_batches = KnownBatches()
        self._last_sequence: int | None = None
        self._n_malformed = self._n_batches = self._n_resumed = 0
        self._refused = ""
        self._begun: deque[ManoeuvreBegun] = deque(maxlen=BEGUN_KEPT)
        self._newest_manoeuvre = 0
        self._unread: dict[str, None] = {}
        self._received: list[ReceivedExceedance] = []
        self._implausible: Exceeded | None = None
        self._has_begun = False
        self._sent_status: LiveStatus | None = None

    @property
    def lead(self) -> float:
        return self.scorer.lead

    @property
    def transport(self) -> TransportState:
        return TransportState(playing=not self.is_over, position=self.t, sample=self.head)

    @property
    def live(self) -> LiveStatus:
        return LiveStatus(
            delay=self.scorer.delay,
            interval=self.scorer.interval if self._has_begun else None,
            lag=round(self.scorer.lag.now, 3),
            manoeuvre=self.scorer.manoeuvre,
            trim=self._setup.trim,
            begun=self.begun,
            trims=self.trims,
            late=[LateInterval(**each._asdict()) for each in self.scorer.lag.intervals],
            resumed=self._n_resumed,
            time_zero=self._time_zero(),
            needed=self.needed,
            names=self._setup.reader.names,
            conditions=[self._signal_of(key) for key in self.scorer.conditions],
            condition=dict(zip(CONDITION_KEYS, self.scorer.condition_at(self.t), strict=True)),
            batches=self._n_batches,
            last_sequence=self._last_sequence,
            malformed=self._n_malformed,
            refused=self._refused,
            foreign=self._udp.n_foreign if self._udp else 0,
            sender=self._udp.sender if self._udp else None,
            other_sender=self._udp.other if self._udp else None,
            counts=self.scorer.counts.to_plain(),
            unread=list(self._unread),
            udp=self._udp.address if self._udp else None,
            problem=self._journal.problem if self._journal else "",
            drift=round(self.scorer.lag.drift * 1e6),
            doubts=[doubt.reason for doubt in self.doubts],
        )

    @property
    def begun(self) -> list[ManoeuvreBegun]:
        return list(self._begun)

    @property
    def trims(self) -> list[TrimChange] | None:
        return self.scorer.trims

    def _time_zero(self) -> str:
        if not isfinite(zero := self.scorer.zero):
            return ""
        try:
            utc = datetime.fromisoformat(self._began_utc) + timedelta(seconds=zero)
        except OverflowError:
            return ""
        return utc.isoformat(timespec="milliseconds").replace("+00:00", "Z")

    def start(self) -> None:
        self._open()
        self._record(self._header())
        self._hold(self.scorer.ruling)
        if self.plan.limits is not None:
            self.put_in_force(self.plan.limits, self.plan.by)
        self._listen()

    def _header(self) -> dict[str, Any]:
        plan, mapping = self.plan, self._setup.reader.mapping
        return {
            "format": FORMAT,
            "flight": self.id,
            "began": self._began_utc,
            "name": plan.name,
            "aircraft": self._setup.aircraft,
            "monitor": plan.monitor_id,
            "epsilon": plan.epsilon,
            "monitors": [{"monitor": d.id, "epsilon": d.epsilon} for d in plan.display],
            "conditions": dict(self._setup.reader.conditions),
            "source": plan.source,
            "mapping": mapping.to_plain() if mapping else None,
        } | ({"monitor_set": plan.monitors.to_plain()} if plan.monitors else {})

    def _pace_recorder(self) -> None:
        self.recorder.interval, self.recorder.is_spread = JOURNALLED_S, True

    def follow(self, lines: Iterable[dict[str, Any]], stored: int) -> None:
        """Replay the next lines of the journal, which another server writes; for a thread.

        stored: newest sample of the record.
        """
        for line in lines:
            self._wait_for_record(self._replay_line(line))
            self._show_recorded(stored)

    def join(
        self,
        plan: FlightPlan,
        setup: LiveSetup,
        recorder: Recorder,
        clock: Clock,
        on_over: Callable[[str, str], object],
        scene: "Scene | None",
    ) -> Self:
        """Continue in the server that owns the flight now. plan, setup: its own, with its ports."""
        self.plan, self._setup, self.recorder, self.clock = plan, setup, recorder, clock
        self._on_over, self.scene = on_over, scene
        self._pace_recorder()
        return self

    def restore(
        self,
        lines: Iterable[dict[str, Any]],
        stored: int,
        alarms: list[Alarm],
        markers: list[FlightMarker],
    ) -> list[LiveAssessed]:
        """Restore the flight of a killed server; for a thread. Returns samples not recorded yet.

        lines: of its journal, after those that it has followed.
        stored, alarms, markers: newest sample and contents of its record.
        """
        self.follow(lines, stored)
        arrival = max(self._since_start(), self._replay.arrived)
        self._began = self.clock.now() - arrival
        self._wait_for_record(self.scorer.advance(arrival))
        self._show_recorded(stored)
        replay, self._replay = self._replay, JournalReplay()
        unrecorded, replayed = [], replay.exceeding
        for assessed, received in replay.waiting:
            replayed += self._judged(received)
            unrecorded.append(assessed)
        self.markers = {marker.number: marker for marker in markers[-MARKERS_KEPT:]}
        replayed += self._judged(self._due())
        stored_t = [alarm.t for alarm in alarms if alarm.kind == "limit"]
        known = {(alarm.kind, alarm.t) for alarm in alarms}
        active: list[AlarmKind] = [
            d.kind for d in self.scorer.doubts if d.kind and (d.kind, d.t) in known
        ]
        newest = [(self.t, key) for key in self.exceedances.over]
        newest += [(t, named.channel) for _, (t, named, _) in replayed if t > self.t]
        if any(self._is_alarmed(t, key, stored_t) for t, key in newest):
            active.append("limit")
        for kind, since in replay.since.items():
            if any(alarm.kind == kind and alarm.t > since - REJOIN_S for alarm in alarms):
                active.append(kind)
        self.alarms.restore(alarms, active, self.head)
        self._received = [
            sample
            for sample, (t, measured, _) in replayed
            if not self._is_alarmed(t, measured.channel, stored_t)
        ]
        return unrecorded

    def _is_alarmed(self, t: float, key: str, alarms: Sequence[float]) -> bool:
        """Whether an alarm was stored of the exceedance of a channel at t [s].

        alarms: their times [s].
        """
        start = self.exceedances.start_of(key, t)
        return any(start - REJOIN_S < alarm < t + REJOIN_S for alarm in alarms)

    def resume(self, unrecorded: list[LiveAssessed]) -> None:
        """Continue a restored flight. OSError."""
        self._open()
        self._record({"e": "resumed"})
        self._n_resumed += 1
        self.is_restoring = False
        for assessed in unrecorded:
            self._judge_received(assessed.assessment.t)
            self._fly_one(assessed, self.clock.now())
        self._judge_received()
        self._hold(self.scorer.ruling)
        for in_force in self.limits_at_hand:
            self.recorder.add_event(in_force)
        self._newest_ahead()
        self._listen()
        self._set_state(State.STALE, "the server restarted: waiting for the source")

    def receive(self, content: bytes | str, via: str) -> AcceptedBatch:
        """Journal a batch, score the samples that it settles, and show them.

        via: its way and sender, for people.
        TelemetryError; SequenceConflict; JournalFull: nothing of it was used.
        """
        try:
            batch = decode_batch(content)
            if (known := self._known(batch)) is not None:
                return known
            if not self._has_begun:
                self._setup.reader.check(batch, self.needed)
            samples = self._setup.reader.samples(batch)
        except (TelemetryError, SequenceConflict) as error:
            self._n_malformed += 1
            self._refused = str(error)[:LONGEST_REASON]
            raise
        values = msgspec.json.encode(batch.values)
        line = {"v": via, "s": batch.sequence, "b": msgspec.Raw(values)}
        written = self._record(line)
        self._note_batch(batch.sequence, values)
        now, n_before, arrived = self.clock.now(), self.scorer.n_accepted, line["a"]
        push = self.scorer.push
        assessed = [settled for sample in samples for settled in push(arrived, sample, via)]
        if self.scorer.n_accepted > n_before:
            self._last_arrival = now
        self._received += self.scorer.pop_exceedances()
        self._fly_all(assessed, now)
        self._judge_received()
        if (doubts := self.scorer.doubts) != self.doubts:
            self._doubt(doubts)
            self._send_live()
        if assessed or self.facts != self._facts:
            self._show()
        self._settle_later()
        return AcceptedBatch(batch.sequence, len(samples), False, written, self._note_unread(batch))

    def _judge_received(self, until: float = inf) -> None:
        """Raise the alarms of received samples that the grid sample at this time [s] may show."""
        for sample, exceeded in self._judged(self._due(until)):
            self._exceed(sample, exceeded)

    def _due(self, until: float = inf) -> list[ReceivedExceedance]:
        """Received samples up to this time and a little later [s], which wait no more."""
        if not self._received:
            return []
        due = [sample for sample in self._received if sample.t <= until + self._near]
        self._received = [sample for sample in self._received if sample.t > until + self._near]
        return due

    def _judged(
        self, due: Sequence[ReceivedExceedance]
    ) -> list[tuple[ReceivedExceedance, Exceeded]]:
        """Note the exceedances of received samples."""
        judged = [(sample, self._note_received(sample)) for sample in due]
        for sample, exceeded in judged:
            if not sample.is_plausible:
                self._implausible = exceeded
        return judged

    def mark(
        self, kind: FlightMarkerKey, by: str, text: str | None, t: float | None = None
    ) -> FlightMarker:
        """Also keep a call in the journal, which a scoring of its file then knows."""
        marker = super().mark(kind, by, text, t)
        if marker.level is not Level.NONE and self._journal is not None:
            with suppress(JournalFull):
                self._record({"e": CALL, "kind": kind, "by": by, "t": marker.t})
        return marker

    def begin_manoeuvre(self, by: str) -> asyncio.Future[None]:
        """Begin a manoeuvre by hand. NotPossible while one is in progress."""
        if self._setup.trim == "none":
            raise NotPossible("no manoeuvre to begin: all samples of this flight are from trim")
        now = self._arrival()
        self._show_all(self.scorer.advance(now), self.clock.now())
        if self.scorer.manoeuvre > 0:
            raise NotPossible(f"manoeuvre {self.scorer.manoeuvre} is in progress")
        t = self.t if self.head >= 0 else None
        written = self._record({"e": "manoeuvre", "by": by, "t": t}, now)
        self.scorer.begin()
        return written

    def _assess_waiting(self) -> None:
        self._settled = self._arrival()
        self._show_all(self.scorer.advance(self._settled), self.clock.now())

    def _apply_limits(self, in_force: LimitsInForce) -> Ruling:
        self._record({"e": "limits", "limits": in_force.to_plain()}, self._settled)
        return self.scorer.put_in_force(in_force)

    def act(self, action: str, value: float | bool | None = None) -> None:
        raise NotPossible(
            f"{action} is not possible: a live flight follows its source and cannot be steered"
        )

    def source_frames(self, first: int, last: int) -> list[dict[str, Any]]:
        raise NotPossible("a live source has only the samples received: read assessments")

    async def stop(self, reason: str) -> None:
        """End the flight: settle waiting samples, tell watchers, complete the record."""
        if not self.is_over and self._journal is not None:
            arrived = self._arrival()
            self._show_all(self.scorer.advance(arrived), self.clock.now())
            end = {"e": "end", "reason": reason, "live": self.live.model_dump()}
            with suppress(JournalFull):
                self._record(end, arrived)
        self._halt(reason)
        if self._udp is not None:
            self._udp.close()
        if self._journal is not None:
            journal, self._journal = self._journal, None
            self.journal_digest = await asyncio.to_thread(journal.close)
        await super().stop(reason)

    # --- the journal --------------------------------------------------------------------------

    def _arrival(self) -> float:
        return max(self.clock.now() - self._began, self._settled)

    def _record(self, line: dict[str, Any], arrived: float | None = None) -> asyncio.Future[None]:
        """Journal a line with its arrival time [s]; now if None."""
        line["a"] = self._arrival() if arrived is None else arrived
        return self._open_journal.append(line)

    @property
    def _open_journal(self) -> Journal:
        if self._journal is None:
            raise NotPossible("the flight has ended: start another one")
        return self._journal

    def _since_start(self) -> float:
        """Time since the flight began, by the date [s]."""
        began, now = map(datetime.fromisoformat, (self._began_utc, self.clock.utc()))
        return (now - began).total_seconds()

    def _wait_for_record(self, settled: Iterable[LiveAssessed]) -> None:
        for assessed in settled:
            self._replay.waiting.append((assessed, self._due(assessed.assessment.t)))

    def _show_recorded(self, stored: int) -> None:
        """Show the samples up to `stored`; those after it are recorded by who resumes."""
        replay = self._replay
        while replay.waiting and self.head < stored:
            assessed, received = replay.waiting.popleft()
            replay.exceeding += self._judged(received)
            shown = *self._flown(assessed), assessed.display
            self._follow(
                *shown, judged=assessed.judged, recorded=assessed.recorded, far=assessed.far
            )
            assessment = assessed.assessment
            if gives_alarm("invalid", assessment):
                replay.since.setdefault("invalid", assessment.t)
            else:
                replay.since.pop("invalid", None)
            if assessment.alert:
                replay.since.setdefault("risk", assessment.t)
            elif assessment.alert is not None:
                replay.since.pop("risk", None)

    def _replay_line(self, line: dict[str, Any]) -> list[LiveAssessed]:
        self._replay.arrived = line["a"]
        if "began" in line:
            self._began_utc = line["began"]
            self._began = self.clock.now() - self._since_start()
        if "b" in line:
            self._note_batch(line["s"], msgspec.json.encode(line["b"]))
            self._note_unread(Batch(line["s"], line["b"]))
        if line.get("e") == "limits":
            self.limits_at_hand.append(LimitsInForce.from_plain(line["limits"]))
        self._port = line.get("port", self._port)
        if line.get("e") == "sender":
            self._sender = line["sender"]
        elif (via := line.get("v", "")).startswith(UDP):
            self._sender = via.removeprefix(UDP)
        self._n_resumed += line.get("e") == "resumed"
        settled = replay_line(line, self.scorer, self._setup.reader)
        self._received += self.scorer.pop_exceedances()
        return settled

    def _note_batch(self, sequence: int | None, values: bytes) -> None:
        """Remember a batch, to recognise a repetition. values: as JSON."""
        self._has_begun = True
        self._n_batches += 1
        self._refused = ""
        if sequence is not None:
            self._known_batches.note(sequence, _digest(values))
            self._last_sequence = max(sequence, self._last_sequence or 0)

    def _note_unread(self, batch: Batch) -> list[str]:
        """Names of a batch that nothing reads, at most UNREAD_KEPT; the flight keeps them."""
        unread = [name[:LONGEST_NAME] for name in self._setup.reader.unread(batch)[:UNREAD_KEPT]]
        for name in unread:
            if len(self._unread) < UNREAD_KEPT:
                self._unread[name] = None
        return unread

    def _known(self, batch: Batch) -> AcceptedBatch | None:
        """The answer to a repeated batch; None for a new one. SequenceConflict."""
        known = self._known_batches.digest(batch.sequence) if batch.sequence is not None else None
        if known is None:
            return None
        if known != _digest(msgspec.json.encode(batch.values)):
            raise SequenceConflict(
                f"sequence {batch.sequence} was used for another batch: give each batch a new "
                f"number; the newest is {self._last_sequence}"
            )
        return AcceptedBatch(batch.sequence, 0, True, self._open_journal.settled())

    # --- showing ------------------------------------------------------------------------------

    def _open(self) -> None:
        """Open port and journal, or neither. SourceError; OSError."""
        if self._port is not None:
            try:
                about = self._setup.access, self._port, self._receive_datagram, self._sender
                self._udp = UdpReceiver(*about)
            except OSError as error:
                raise SourceError(
                    f"UDP port {self._port} of {self._setup.access.host} is not available "
                    f"({error.strerror}): give another one, or 0 for any free one"
                ) from None
        try:
            self._journal = self._setup.journals.open(self.id, self.digest)
        except OSError:
            if self._udp is not None:
                self._udp.close()
            raise

    def _listen(self) -> None:
        if self._udp is not None:
            self._record({"e": "listening", "port": self._udp.port})
        self._send_heartbeat()
        self._last_arrival = self.clock.now()
        self._watch_out()

    def change_sender(self, sender: str, by: str) -> asyncio.Future[None]:
        """Accept the datagrams of this sender alone. NotPossible without a port."""
        if self._udp is None:
            raise NotPossible("this flight does not listen for datagrams: start it with `udp`")
        written = self._record({"e": "sender", "sender": sender, "by": by})
        self._udp.sender, self._udp.other = sender, None
        self._send_live()
        return written

    def _receive_datagram(self, lines: list[bytes], sender: str) -> bool:
        """Receive the batches of a datagram. Returns whether any was one."""
        n_taken = 0
        for line in lines:
            with suppress(TelemetryError, SequenceConflict, NotPossible, JournalFull):
                self.receive(line, f"{UDP}{sender}")
                n_taken += 1
        return n_taken > 0

    def _signal_of(self, key: ConditionKey) -> ConditionSignal:
        name, unit = self._setup.reader.condition_of(key)
        return ConditionSignal(key=key, name=name, label=CONDITIONS[key].label, unit=unit)

    def _taken(self, t: float) -> float:
        return self._began + self.scorer.lag.taken(t)

    def _forecast_ahead(self) -> Ahead | None:
        return None if self.is_restoring else self.scorer.forecast_ahead()

    def _show_all(self, assessed: list[LiveAssessed], now: float) -> None:
        if assessed:
            self._fly_all(assessed, now)
            self._show()

    def _fly_all(self, assessed: list[LiveAssessed], now: float) -> None:
        if not assessed:
            return
        self._late = self.scorer.lag.reason
        known = self._newest_manoeuvre, self.trims
        for sample in assessed:
            self._judge_received(sample.assessment.t)
            self._fly_one(sample, now)
        if (self._newest_manoeuvre, self.trims) != known:
            self._send_live()

    def _fly_one(self, assessed: LiveAssessed, due: float) -> None:
        y, assessment, exceeded, attitude = self._flown(assessed)
        about = due, self.head + 1, attitude, assessed.display
        shown = y, assessment, exceeded, *about
        self._fly(
            *shown,
            judged=assessed.judged,
            recorded=assessed.recorded,
            far=assessed.far,
            arrived=assessed.shown,
        )

    def _flown(self, assessed: LiveAssessed) -> tuple[Array, Assessment, Exceeded | None, Angles]:
        judged, recorded, ruling = assessed.judged, assessed.recorded, assessed.ruling
        self._manoeuvre = assessed.manoeuvre if self._setup.trim == "detected" else 1
        if assessed.manoeuvre > self._newest_manoeuvre:
            self._newest_manoeuvre = assessed.manoeuvre
            begun = ManoeuvreBegun(number=assessed.manoeuvre, t=assessed.assessment.t)
            self._begun.append(begun)
        self._hold(ruling, assessed.assessment.t)
        limits = self.plan.monitor.envelope if ruling is None else ruling.limits
        t = assessed.assessment.t
        exceeded = exceeded_at(t, self._keys, limits, judged, recorded)
        exceeded = exceeded or self._goes_on(t, recorded)
        if exceeded is not None:
            exceeded = exceeded._replace(arrived=self.scorer.lag.due(t, assessed.shown))
        return assessed.y, assessed.assessment, exceeded, assessed.shown_attitude(self._display)

    def _goes_on(self, t: float, recorded: Array) -> Exceeded | None:
        """The exceedance of a channel that is missing at t [s]: its values are not plausible."""
        if self._implausible is None or abs(t - self._implausible.t) > self._near:
            return None
        channel = self._implausible.measured.channel
        is_missing = np.isnan(recorded[self._keys.index(channel)])
        return self._implausible._replace(t=t, arrived=None) if is_missing else None

    def _settle_later(self) -> None:
        deadline = self.scorer.deadline
        if deadline is None:
            self._stop_timer("settle")
        else:
            self._call_at("settle", self._began + deadline, partial(self._settle, deadline))

    def _settle(self, deadline: float) -> None:
        self._settled = max(deadline, self._arrival())
        self._show_all(self.scorer.advance(self._settled), self.clock.now())
        self._settle_later()

    def _send_heartbeat(self) -> None:
        super()._send_heartbeat()
        self._send_live()

    def _send_live(self) -> None:
        if (now := self.live) != self._sent_status:
            self._sent_status = now
            self._broadcast(LiveChange(live=now).encode())

    def _watch_out(self) -> None:
        now = self.clock.now()
        when = self._last_arrival + self._stale_after
        if when <= now:
            when = now + self._stale_after
            if self._has_begun:
                self._miss(self._stale_after)
        self._call_at("watch out", when, self._watch_out)


def _digest(values: bytes) -> int:
    """Digest below 2**64, by a key of this process that no source knows."""
    return hash(values) & 0xFFFF_FFFF_FFFF_FFFF
