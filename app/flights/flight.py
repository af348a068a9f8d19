"""One flight: its assessed samples go to the recorder, the watchers and the scene.

TrackFlight and LiveFlight supply the samples.
"""

import logging
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from app.assessment.grid import Angles, IntegratedAngles
from app.assessment.input_checks import Doubt
from app.assessment.monitors_in_use import MonitorRuling, MonitorsInUse
from app.assessment.rulings import InForceFrom, LimitsInForce, RequestedLimits, Ruling
from app.assessment.scorer import ReceivedExceedance
from app.flights.alarms import Alarms
from app.flights.clock import Clock, Timer
from app.flights.display_monitors import DisplayMonitor, flown_monitor, no_rest
from app.flights.flight_limits import NO_SAMPLE, InForce
from app.flights.planned_card import planned_card
from app.flights.recorder import Recorder
from app.flights.transport import NotPossible, TransportError
from app.flights.verdict import (
    UNASSESSED,
    Before,
    Circumstances,
    SampleCause,
    before_exceedance,
    first_exceedance,
    longest_manoeuvre,
    n_before,
    planned_length,
    verdict,
    verdict_of_recording,
)
from app.flights.watcher import CREDIT, RecentFrames, Screens, Watcher
from app.messages import (
    AlarmRaised,
    CardAhead,
    CardPoint,
    End,
    FlownMonitor,
    Heartbeat,
    Hello,
    LimitsChange,
    LiveStatus,
    ManoeuvreBegun,
    MarkerSet,
    Mode,
    MonitorChange,
    StateChange,
    StatusChange,
    TransportState,
    Verdict,
    encode_frame,
    plain_ahead,
    plain_frame,
    validity_word,
)
from app.scene.shown import KnownAngles, Shown
from core.flight_events import FLIGHT_MARKERS, Alarm, FlightMarker, FlightMarkerKey, TrimChange
from core.limits.exceedance import Exceedances, Exceeded
from core.monitor import Assessment, Monitor, State
from core.monitor.assessment import Cause
from core.monitor.peak_forecast import Ahead
from core.monitor.status import Facts, Headline, Level, headline
from core.types import Array

if TYPE_CHECKING:
    from app.scene.scene import Scene

LOG = logging.getLogger("forewarn")
HEARTBEAT_S = 1.0
AHEAD_S, UNWATCHED_AHEAD_S = 0.1, 0.5
"""[s] of flight between two forecasts of the rest of the card, and while no one watches."""
MARKERS_KEPT = 50
"""Stored markers that a flight keeps in memory; the store has all."""
NOTHING_COMES = "no sample comes"
"""Reason of a stale flight without new samples; each display adds the age."""
STALE_INTERVALS, STALE_S = 3.0, 0.25
"""A source is late after this many intervals, and this time [s], without a sample."""


def stale_after(dt: float, speed: float = 1.0) -> float:
    """Time without a sample after which the display is stale [s]; flight, scene and page use it.

    speed: of play; samples of slow play come at longer intervals.
    """
    return max(STALE_INTERVALS * dt / min(speed, 1.0), STALE_S)


def beyond_of(ruling: Ruling | None) -> str:
    return "" if ruling is None else ruling.beyond


@dataclass(frozen=True, eq=False)
class FlightPlan:
    """What a flight is started with.

    source: as requested, in plain data.   monitor: the alarm authority.   display: monitors without
    alarms.   limits, by: put in force at the start, and by whom; None for the monitor's own.
    wait_for_viewer: see FlightRequest.   monitors: a set, of which the one in use is the alarm
    authority; None for `monitor` throughout.   points: of campaigns, by monitor id.
    """

    id: str
    name: str
    source: dict[str, Any]
    monitor: Monitor
    monitor_id: str
    monitor_name: str
    epsilon: float
    mode: Mode = "live"
    display: tuple[DisplayMonitor, ...] = ()
    limits: RequestedLimits | None = None
    by: str = ""
    wait_for_viewer: bool = False
    monitors: MonitorsInUse | None = None
    points: Mapping[str, CardPoint] = field(default_factory=dict)

    @property
    def authority(self) -> DisplayMonitor:
        """The alarm authority, or of a set the first one."""
        return DisplayMonitor(self.monitor_id, self.monitor_name, self.monitor, self.epsilon)


class Flight(ABC):
    """A flight in progress. Its methods are called in the event loop; only `stop` waits.

    on_over: called once if the flight ends by itself, with status and reason.
    is_checked: whether its monitor's validity is calibrated.   verdict: how the flight was warned
    of its first exceedance.
    manoeuvres: plain, of a scored recording.   _late: why the source is late; empty if it is not.
    _is_waiting: whether it waits at its start for a first viewer.
    _manoeuvre: number of the one that the newest sample is part of, 0 for none or where not known.
    journal_digest: SHA-256 of a live flight's complete journal.
    on_change: called when its headline, verdict or state changes, and when it is over.
    """

    dt: float
    is_checked: bool = False
    theta: dict[str, float] | None = None
    duration: float | None = None
    fail_t: float | None = None
    _near: float = 0.0
    manoeuvres: Sequence[Mapping[str, Any]] | None = None
    _is_waiting = False
    journal_digest: str | None = None
    no_plan: str = "a live flight has no planned flight to the same times"
    on_change: Callable[[], object] = staticmethod(lambda: None)

    def __init__(
        self,
        plan: FlightPlan,
        recorder: Recorder,
        clock: Clock,
        on_over: Callable[[str, str], object],
        scene: "Scene | None" = None,
    ) -> None:
        self.plan, self.scene = plan, scene
        self._planned_s = planned_length(plan.monitor.dataset_recipe)
        self._longest = longest_manoeuvre(self._planned_s)
        self.recorder, self.alarms, self.clock = recorder, Alarms(self._longest), clock
        self.markers: dict[int, FlightMarker] = {}
        self.limits_at_hand: list[LimitsInForce] = []
        self.in_force = InForce(plan.authority, plan.monitors)
        self.is_over = False
        self.t = 0.0
        self.state, self.reason, self._late = State.NO_DATA, NO_SAMPLE, ""
        self.cause: Cause | None = None
        self._assessment: Assessment | None = None
        self._exceeds = False
        self.doubts: tuple[Doubt, ...] = ()
        self._is_in_doubt = False
        monitor = plan.monitor
        keys = monitor.dictionary.keys
        rest = np.zeros(len(keys)) if monitor.envelope is None else monitor.envelope.rest
        self.exceedances = Exceedances(dict(zip(keys, rest.tolist(), strict=True)), self._near)
        self._on_over = on_over
        self._recent = RecentFrames(held=lambda: list(self.in_force.changes))
        self._watchers: set[Watcher] = set()
        self._screens = Screens()
        self._timers: dict[str, Timer] = {}
        self._pose: tuple[Angles, Array] | None = None
        self._ahead_t, self._is_predicted = -inf, False
        self.verdict: Verdict | None = None
        self._facts = self.facts
        self._shown = self._facts, self.verdict, self.exceedances.latched, self.call
        self._sent = self._current
        self._has_new_evidence = False
        n = n_before(monitor.lead, monitor.dt)
        self._newest = deque[SampleCause](maxlen=n + 1)
        self._before_exceedance = Before()
        self._manoeuvre = 0

    @property
    @abstractmethod
    def transport(self) -> TransportState:
        """Position and state of play."""

    @abstractmethod
    def start(self) -> None: ...

    @abstractmethod
    def act(self, action: str, value: float | bool | None = None) -> None:
        """Perform an action of the transport. TransportError."""

    @abstractmethod
    def _assess_waiting(self) -> None:
        """Assess waiting samples, still under the current limits."""

    @abstractmethod
    def _apply_limits(self, in_force: LimitsInForce) -> Ruling:
        """Apply other limits from the next sample on; return the current ruling. NotPossible."""

    @abstractmethod
    def source_frames(self, first: int, last: int) -> list[dict[str, Any]]:
        """Frames first..last of the source, flown or not; `seq` is their number in it."""

    @property
    def lead(self) -> float:
        return self.plan.monitor.lead

    @property
    def monitors(self) -> list[FlownMonitor]:
        """The alarm authority, then the monitors for display."""
        delay, authority = self.plan.monitor.lead - self.lead, self.in_force.authority
        return [
            flown_monitor(
                *shown,
                shown.warnings,
                delay=delay,
                is_authority=shown is authority and self.in_force.has_authority,
            )
            for shown in (authority, *self.plan.display)
        ]

    @property
    def monitor_id(self) -> str | None:
        """Of the alarm authority; None while there is none."""
        return self.in_force.authority.id if self.in_force.has_authority else None

    @property
    def live(self) -> LiveStatus | None:
        """State of a live source; None for other flights."""
        return None

    @property
    def begun(self) -> list[ManoeuvreBegun]:
        """The newest inputs, or all of a source that is known from start to end."""
        return []

    @property
    def call(self) -> FlightMarker | None:
        """The newest of the most urgent calls in force; a new manoeuvre ends a call."""
        if not self.markers:
            return None
        markers, begun = self.markers.values(), self.begun
        cleared = max((m.number for m in markers if m.kind == "call_cleared"), default=0)
        calls = [m for m in markers if m.level is not Level.NONE and m.number > cleared]
        calls = [m for m in calls if not any(m.t < each.t <= self.t for each in begun)]
        urgent = [m for m in calls if m.level is Level.WARNING] or calls
        return urgent[-1] if urgent else None

    @property
    def trims(self) -> list[TrimChange] | None:
        """Where the trim of a limited channel changed; None where samples are from trim."""
        return None

    @property
    def id(self) -> str:
        return self.plan.id

    @property
    def head(self) -> int:
        """Newest seq; -1 before the first sample."""
        return self._recent.head

    @property
    def _position(self) -> int:
        """Number of the newest sample in its source."""
        return self.head

    @property
    def facts(self) -> Facts:
        assessment = self._assessment
        return Facts(
            exceeds=self._exceeds and not self.is_over,
            alarm=self.alarms.n_open(Level.WARNING) > 0,
            caution=self.alarms.n_open(Level.CAUTION) > 0
            or (self._is_in_doubt and not self.is_over),
            alert=assessment is not None and bool(assessment.alert) and not self.is_over,
            stale=self.state is State.STALE,
            invalid=assessment is not None and assessment.state is State.INVALID,
            paused=self._is_paused and not self.is_over,
            no_data=self.state is State.NO_DATA,
            warming_up=self.state is State.WARMING_UP,
            calibrated=self.is_checked,
            exceeded_t=self.exceeded_t,
            exceeded_as_recorded=self.exceedances.is_first_as_recorded,
            predicted=self._is_predicted and not self.is_over,
        )

    @property
    def exceeded_t(self) -> float | None:
        """First exceedance, flown or passed by a seek [s]; None for none."""
        return self.exceedances.first_t

    @property
    def headline(self) -> Headline:
        return headline(self.facts)

    @property
    def n_watchers(self) -> int:
        return len(self._watchers)

    # --- watching -----------------------------------------------------------------------------

    def watch(self, screen: str = "", by: str = "") -> Watcher:
        """Add a watcher; its first message is hello, then new frames follow.

        screen, by: id and person of the screen that it is; empty for a program.
        """
        watcher = Watcher(self._recent, screen)
        watcher.send(self._hello())
        self._watchers.add(watcher)
        if screen:
            self._screens.join(screen, by)
            self._broadcast(self._screens.message.encode())
        if self.is_over:
            watcher.end(End(reason="the flight has ended").encode())
        elif self._is_waiting:
            self.act("play")
        return watcher

    def leave(self, watcher: Watcher) -> None:
        self._watchers.discard(watcher)
        if watcher.screen:
            self._screens.leave(watcher.screen)
            self._broadcast(self._screens.message.encode())

    def steer(self, action: str, value: float | bool | None, screen: str) -> None:
        """Perform an action of the transport for a screen, which leads from then on.

        screen: id; empty for a program, which leads nothing.   TransportError.
        """
        takes_lead = action == "lead"
        if takes_lead and not (screen and self.transport.seekable):
            raise TransportError("lead needs the id of a screen that shows a replay")
        if not takes_lead:
            if screen:
                self._screens.check(screen)
            self.act(action, value)
        if screen and self._screens.lead(screen):
            self._broadcast(self._screens.message.encode())

    def acknowledge(self, alarm_id: str, by: str, utc: str) -> Alarm:
        """Apply a stored acknowledgement and send it to all watchers; KeyError if not in memory."""
        alarm, is_first = self.alarms.acknowledge(alarm_id, by, utc)
        if is_first:
            if alarm.kind == "limit":
                self.exceedances.acknowledge()
            self._broadcast(AlarmRaised(alarm=alarm).encode())
            self._send_headline()
            self._use_scene(lambda scene: scene.restate(self._facts))
        return alarm

    def mark(
        self, kind: FlightMarkerKey, by: str, text: str | None, t: float | None = None
    ) -> FlightMarker:
        """Set a marker: sent to all watchers, then stored. NotPossible.

        t: time that it is about [s], not after the newest sample's; that one's if None.
        """
        if t is not None and t > self.t + 0.5 * self.dt:
            raise NotPossible(
                f"{t:g} s is later than the newest sample, {self.t:g} s: give its time or an "
                "earlier one"
            )
        number, at = max(self.markers, default=0) + 1, self.t if t is None else t
        marker = FlightMarker(number, kind, self.head, at, self.clock.utc(), by, text)
        self.markers[number] = marker
        self._broadcast(MarkerSet(marker=marker).encode())
        self._send_headline()
        self.recorder.add_event(marker, partial(self._note_marker, number))
        self.on_change()
        return marker

    def put_in_force(self, change: RequestedLimits, by: str) -> LimitsInForce:
        """Put a limit set in force from the next sample on; all watchers are told. NotPossible.

        Values declared for the flight condition stay unless given again.
        """
        if self.plan.monitors is not None:
            raise NotPossible(
                "a flight on a monitor set is judged by the limits of its monitors: start it with "
                "one monitor to put other limits in force"
            )
        self._assess_waiting()
        before = self.limits_at_hand[-1].fixed if self.limits_at_hand else {}
        in_force = LimitsInForce(
            len(self.limits_at_hand) + 1,
            change.limit_set,
            change.name,
            change.version,
            fixed=before | dict[str, float]((change.fixed or {}).items()),
            seq=self.head + 1,
            t=self.t,
            created=self.clock.utc(),
            by=by,
            limits=change.limits,
            serving=change.serving,
        )
        ruling = self._apply_limits(in_force)
        self.limits_at_hand.append(in_force)
        self._hold(ruling)
        self.recorder.add_event(in_force)
        return in_force

    def _hold(self, ruling: Ruling | None, t: float | None = None) -> None:
        """Apply a ruling; if it changed, tell all watchers.

        t: of its first sample [s]; None for all samples or before the next one.
        """
        if ruling is self.in_force.ruling:
            return
        is_undated = t is None and self.head >= 0
        since = self.t + self.dt if is_undated else t
        self.in_force.note(ruling, since, is_undated=is_undated)
        self._change(ruling, since)

    def _change(self, ruling: Ruling | None, since: float | None) -> None:
        """Apply, record and announce a ruling; None for the monitor's own limits.

        since: time of the first sample under it [s]; None for all samples.
        """
        change = self.in_force.use(ruling, since, self.head + 1)
        if isinstance(ruling, MonitorRuling):
            if ruling.used is not None:
                self.is_checked = self.in_force.authority.monitor.support is not None
            self._broadcast(MonitorChange(held=change, **self._authority_facts).encode())
            return
        status, channels = self.in_force.status, self.in_force.channels
        self._broadcast(LimitsChange(limits=status, channels=channels).encode())

    @property
    def _authority_facts(self) -> dict[str, Any]:
        """The alarm authority, as sent."""
        authority_id, name, monitor, epsilon = self.in_force.authority
        return {
            "channels": self.in_force.channels,
            "epsilon": epsilon,
            "guarantee": monitor.recipe.guarantee,
            "n_unsafe": monitor.n_unsafe,
            "validity": validity_word(self.is_checked),
            "monitor": {"id": authority_id, "name": name} if self.in_force.has_authority else None,
            "monitors": self.monitors,
            "warnings": self.in_force.authority.warnings,
            "card": planned_card(monitor, self.plan.points.get(authority_id)),
            "no_rest": no_rest(monitor),
            "monitor_set": self.in_force.monitor_set,
        }

    def _note_marker(self, number: int, is_stored: bool) -> None:
        if is_stored:
            self.markers[number] = marker = replace(self.markers[number], stored=True)
            for old in [n for n, known in self.markers.items() if known.stored][:-MARKERS_KEPT]:
                del self.markers[old]
            self._broadcast(MarkerSet(marker=marker).encode())
            self._send_headline()

    async def stop(self, reason: str) -> None:
        self._halt(reason)

    def _hello(self) -> str:
        plan, ahead = self.plan, self._newest_ahead()
        return Hello(
            **self._authority_facts,
            flight=plan.id,
            name=plan.name,
            server_time=self.clock.utc(),
            lead=self.lead,
            dt=self.dt,
            stale_after=stale_after(self.dt),
            ahead=None if ahead is None else CardAhead.model_validate(plain_ahead(ahead)),
            no_plan=self.no_plan,
            source=plan.source,
            mode=plan.mode,
            theta=self.theta,
            fail_t=self.fail_t,
            duration=self.duration,
            planned_s=self._planned_s,
            begun=self.begun,
            trims=self.trims,
            transport=self.transport,
            state=self.state,
            reason=self.reason,
            cause=self.cause,
            **self._current,
            exceedances=self.exceedances.of_channels,
            held=list(self.in_force.changes),
            head=self.head,
            alarms=self.alarms.at_hand,
            markers=list(self.markers.values()),
            marker_kinds=list(FLIGHT_MARKERS.values()),
            credit=CREDIT,
            live=self.live,
            limits=self.in_force.status,
        ).encode()

    # --- flying -------------------------------------------------------------------------------

    def _fly(
        self,
        y: Array,
        assessment: Assessment,
        exceedance: Exceeded | None,
        due: float,
        index: int,
        attitude: Angles,
        display: tuple[Assessment, ...] = (),
        *,
        judged: Array,
        recorded: Array,
        far: Mapping[str, int],
        arrived: float | None = None,
    ) -> None:
        """Record, check and encode one sample; `_show` follows once per burst.

        display: assessments by the monitors for display.   judged: y, NaN where its trim is
        unknown.   recorded: y including trim.   far: see TrimCheck.   arrived: see Alarm.
        """
        seq = self._recent.head + 1
        self.recorder.add(seq, y, assessment, display, self._manoeuvre)
        sent = round(due * 1e3, 3)
        about = y, assessment, exceedance, attitude, display, sent
        self._follow(*about, judged=judged, recorded=recorded, far=far)
        about = assessment, exceedance, self.clock, self._late
        beyond = beyond_of(self.in_force.ruling)
        when = {"arrived": arrived, "manoeuvre": self._manoeuvre}
        if raised := self.alarms.update(seq, index, *about, beyond=beyond, **when):
            self._raise_alarms(raised)
        if self._has_new_evidence:
            self._judge(seq)

    def _follow(
        self,
        y: Array,
        assessment: Assessment,
        exceedance: Exceeded | None,
        attitude: Angles,
        display: tuple[Assessment, ...] = (),
        sent: float | None = None,
        *,
        judged: Array,
        recorded: Array,
        far: Mapping[str, int],
    ) -> None:
        """Update the display with one sample. sent: monotonic milliseconds; None for an old one."""
        if self.in_force.is_undated:
            self.in_force.date(assessment.t)
        if self._late:
            self._set_state(State.STALE, self._late)
        else:
            self._set_state(assessment.state, assessment.reason, assessment.cause)
        taken = self._taken(assessment.t)
        ahead = self._ahead_of(assessment)
        is_integrated = isinstance(attitude, IntegratedAngles)
        sensor = {key: value for key, c in far.items() if isfinite(value := recorded.item(c))}
        about = display, taken, ahead, attitude, is_integrated, sensor
        frame = plain_frame(self._recent.head + 1, y, assessment, sent, *about)
        self._recent.append(encode_frame(frame))
        cause = SampleCause(assessment.t, assessment.state, assessment.cause)
        self._newest.append(cause.after(self._newest[-1] if self._newest else None))
        self.t, self._assessment, self._pose = assessment.t, assessment, (attitude, y)
        self._exceeds = exceedance is not None
        at, named, _ = (assessment.t, None, "") if exceedance is None else exceedance
        self.exceedances.update(at, judged, self.in_force.limits, named, recorded)

    def _ahead_of(self, assessment: Assessment) -> Ahead | None:
        """Forecast of the rest of the card, from time to time and at the last sample."""
        passed, every = assessment.t - self._ahead_t, AHEAD_S
        if not self._watchers:
            every = UNWATCHED_AHEAD_S
        is_apart = self._is_at_end or not 0 <= passed < every - 1e-6
        is_assessed = assessment.p_value is not None and not self._late
        if is_assessed and not is_apart:
            return None
        ahead = self._ahead_by(assessment)
        self._is_predicted = ahead is not None and ahead.exceeds
        if ahead is not None:
            self._ahead_t = assessment.t
        return ahead

    def _newest_ahead(self) -> Ahead | None:
        """Forecast by the newest sample, for a watcher that joins a paused flight."""
        newest = self._assessment
        ahead = None if newest is None or self.is_over else self._ahead_by(newest)
        self._is_predicted = ahead is not None and ahead.exceeds
        return ahead

    def _ahead_by(self, assessment: Assessment) -> Ahead | None:
        if assessment.p_value is None or self._late:
            return None
        ahead = self._forecast_ahead()
        return ahead if ahead is not None and ahead.made_t == assessment.t else None

    def _forecast_ahead(self) -> Ahead | None:
        """Forecast of the alarm authority by the sample that is shown next."""
        return None

    def _planned_attitude(self) -> KnownAngles | None:
        """Attitude of the planned flight at the newest sample; None without one."""
        return None

    @property
    def _is_at_end(self) -> bool:
        """Whether that sample is the last one of the source."""
        return False

    @property
    def _is_paused(self) -> bool:
        """Whether no next sample is played."""
        return False

    def _taken(self, t: float) -> float | None:
        """Clock time at which the sample of t was taken [s]; None if that is when it was due."""
        return None

    @property
    def age(self) -> float | None:
        """Time since the newest sample was taken [s]; None before the first and after the end."""
        taken = None if self.head < 0 or self.is_over else self._taken(self.t)
        return None if taken is None else max(self.clock.now() - taken, 0.0)

    def _note_received(self, sample: ReceivedExceedance) -> Exceeded:
        """Count the exceedance of a received sample."""
        exceeded = sample.exceeded(self.plan.monitor.dictionary.keys)
        self.exceedances.add(exceeded, sample.y, sample.limits, sample.recorded)
        return exceeded

    def _exceed(self, sample: ReceivedExceedance, exceeded: Exceeded) -> None:
        """Raise the alarm of a received sample, which may not reach the grid.

        It comes before the grid sample that may show it: the sensor's own sample gives an
        exceedance its time and value.
        """
        seq, about = max(self.head, 0), (sample.doubt_of(exceeded), self.clock, self._manoeuvre)
        if raised := self.alarms.exceed(seq, max(self._position, 0), exceeded, *about):
            self._raise_alarms(raised)
        if self._has_new_evidence and self._newest:
            self._judge(seq)
        elif self._has_new_evidence:
            self.judge(Before(unassessed=UNASSESSED))

    def _doubt(self, doubts: tuple[Doubt, ...]) -> None:
        if doubts or self.doubts:
            self.doubts = doubts
            self._is_in_doubt = any(doubt.level is Level.CAUTION for doubt in doubts)
            about = self.head, self._position, doubts, self.clock
            self._raise_alarms(self.alarms.note_doubts(*about))

    def _judge(self, seq: int) -> None:
        first = first_exceedance(self.alarms.evidence)
        if first is not None and first.seq == seq:
            about = [*self._newest], self.lead, self.plan.monitor.dt
            self._before_exceedance = before_exceedance(first.t, *about)
        self.judge(self._before_exceedance)

    def judge(self, before: Before) -> None:
        """Decide the verdict. before: see before_exceedance."""
        self._has_new_evidence, self._before_exceedance = False, before
        alarms, live = self.alarms.evidence, self.plan.source.get("kind") == "live"
        reached = [alarm.t for alarm in alarms if alarm.kind == "limit"]
        if self.manoeuvres is None or not reached:
            about = live, self._longest, self.plan.monitor.dictionary.controls
            self.verdict = verdict(alarms, Circumstances(self.lead, *before, *about))
        else:
            about = alarms, reached, self.plan.monitor.dt, self.lead
            self.verdict = verdict_of_recording(self.manoeuvres, *about)

    def _raise_alarms(self, alarms: list[Alarm]) -> None:
        for alarm in alarms:
            self._has_new_evidence |= alarm.level is Level.WARNING or alarm.kind == "frozen"
            self.recorder.add_event(alarm, partial(self._announce, alarm.id))

    def _announce(self, alarm_id: str, is_stored: bool) -> None:
        if is_stored:
            self.alarms.note_stored(alarm_id)
        for alarm in self.alarms.at_hand:
            if alarm.id == alarm_id:
                self._broadcast(AlarmRaised(alarm=alarm).encode())

    def _restart(self, t: float, held: Sequence[InForceFrom] = ()) -> None:
        """The next sample, at t [s], does not follow the last one.

        held: limits in force for the samples of the source up to that one; empty for the current
        ones, whatever the time.
        """
        if self.in_force.is_undated:
            self.in_force.date(t)
        for watcher in self._watchers:
            watcher.before_reset()
        self.alarms.restart()
        self.exceedances.restart()
        self.in_force.restart(held)
        self._broadcast(self._recent.restart(t))
        if held and held[-1].ruling is not self.in_force.ruling:
            self._change(held[-1].ruling, held[-1].t)

    def _show(self) -> None:
        self._send_headline()
        for watcher in self._watchers:
            watcher.wake()
        if self.scene is None or self._pose is None or self._assessment is None:
            return
        (attitude, y), assessment = self._pose, self._assessment
        is_stale = self.state is State.STALE
        phi, theta, psi = (angle if isfinite(angle) else None for angle in attitude)
        shown = Shown(
            self.t,
            (phi, theta, psi),
            self._value(y, "beta"),
            self._value(y, "delta_a"),
            self._value(y, "delta_r"),
            None if is_stale else assessment.p_value,
            self.in_force.alert_above,
            bool(assessment.alert) and not is_stale,
            self.state,
            self.reason,
            facts=self._facts,
            cause=assessment.cause,
            delta_e=self._value(y, "delta_e"),
            alpha=self._value(y, "alpha"),
            planned=self._planned_attitude(),
        )
        self._use_scene(lambda scene: scene.show(shown))

    def _value(self, y: Array, key: str) -> float | None:
        """A channel of a sample; None if the monitor has no such channel."""
        keys = self.plan.monitor.dictionary.keys
        return y.item(keys.index(key)) if key in keys else None

    def _miss(self, seconds: float) -> None:
        reason, is_new = f"no sample came for {seconds:g} s", self.state is not State.STALE
        if is_new or self.reason == self._late:
            self._set_state(State.STALE, NOTHING_COMES)
        about = self.head, self._position, self.t, reason, self.clock
        self._raise_alarms(self.alarms.note_late(*about))
        if is_new:
            self._show()

    def _send_headline(self) -> None:
        shown = self._facts, *_ = self.facts, self.verdict, self.exceedances.latched, self.call
        if shown == self._shown:
            return
        self._shown, now = shown, self._current
        if now != self._sent:
            self._sent = now
            self._broadcast(StatusChange(**now).encode())
            self.on_change()

    @property
    def _current(self) -> dict[str, Any]:
        """Headline, verdict, latched exceedances and call, as sent."""
        about = {"verdict": self.verdict, "latched": self.exceedances.latched, "call": self.call}
        return self.headline._asdict() | about

    def _use_scene(self, act: "Callable[[Scene], object]") -> None:
        """Use the scene. If it fails, the flight continues without it; the scene turns stale."""
        if self.scene is None:
            return
        try:
            act(self.scene)
        except Exception:
            LOG.exception("flight %s continues without its scene", self.id)
            self.scene = None

    def _set_state(self, state: State, reason: str, cause: Cause | None = None) -> None:
        if (state, reason) != (self.state, self.reason):
            self.state, self.reason, self.cause = state, reason, cause
            self._broadcast(StateChange(state=state, reason=reason, cause=cause).encode())
            self.on_change()

    # --- time and end -------------------------------------------------------------------------

    def _broadcast(self, text: str) -> None:
        for watcher in self._watchers:
            watcher.send(text)

    def _send_heartbeat(self) -> None:
        """Send a heartbeat each second, encoded once per count of skipped frames."""
        recorder = self.recorder
        beat = Heartbeat(
            server_time=self.clock.utc(),
            sent=round(self.clock.now() * 1e3, 3),
            lost=recorder.lost,
            unwritten=recorder.unwritten,
            problem=recorder.problem,
            conflated=0,
        )

        @cache
        def heartbeat(conflated: int) -> str:
            return beat.model_copy(update={"conflated": conflated}).encode()

        for watcher in self._watchers:
            watcher.beat(heartbeat)
        self._call_at("beat", self.clock.now() + HEARTBEAT_S, self._send_heartbeat)

    def _call_at(self, name: str, when: float, call: Callable[[], object]) -> None:
        self._stop_timer(name)
        if not self.is_over:
            self._timers[name] = self.clock.call_at(when, call)

    def _stop_timer(self, name: str) -> None:
        timer = self._timers.pop(name, None)
        if timer is not None:
            timer.cancel()

    def _halt(self, reason: str) -> None:
        if self.is_over:
            return
        self.is_over = True
        self.recorder.announce_pending()
        for name in list(self._timers):
            self._stop_timer(name)
        for watcher in self._watchers:
            watcher.end(End(reason=reason).encode())
        self.on_change()

    def _end(self, status: str, reason: str) -> None:
        self._halt(reason)
        self._on_over(status, reason)

    def _fail(self) -> None:
        LOG.exception("flight %s failed", self.id)
        self._end("failed", "the flight failed: see the server's log")
