"""The flight of a source that is known from start to end.

The whole source is assessed before the flight starts. Seek, step, speed and loop only choose which
of these assessed samples is shown when; they cannot change a score.
"""

from typing import Any

from app.assessment.monitors_in_use import MonitorsRule
from app.assessment.rulings import LimitsInForce, LimitsRule, Ruling
from app.flights.alarms import gives_alarm
from app.flights.flight import Flight, FlightPlan, beyond_of, stale_after
from app.flights.sources.playback import Script
from app.flights.transport import Due, NotPossible, Transport, TransportError
from app.messages import ManoeuvreBegun, TransportChange, TransportState, plain_frame
from app.scene.shown import KnownAngles
from core.flight_events import TrimChange
from core.limits.exceedance import Exceeded
from core.limits.limits import Envelope
from core.monitor import Assessment, State
from core.monitor.peak_forecast import OVER, Ahead, NothingAhead
from core.monitor.status import AlarmKind
from core.types import Indices

TICK_S = 0.016
"""[s] Samples due within this time are sent together."""
VIEWER_S = 10.0
"""[s] A flight with `wait_for_viewer` starts after this time without a viewer."""
WAITING = "waiting for a viewer"
KEEP_WAITING = frozenset({"loop", "speed"})
"""Actions that leave a flight waiting for its first viewer; any other starts it."""
LEFT_S = 600.0
"""[s] A flight at the end of its source ends after this time."""
MOST_BACK = 3_000
"""Samples before a sought one that are searched for the onset of its alarms: about 30 ms."""
LASTING: tuple[AlarmKind, ...] = ("limit", "risk", "invalid")
"""Kinds of alarm that a sample alone decides."""


class TrackFlight(Flight):
    """A flight with play, pause, seek, step, speed, loop and next_alert.

    At the end of its source it pauses and can be played again. It ends LEFT_S later if it is not
    steered, unless someone is watching an unacknowledged alarm: that must stay on the screen.
    """

    def __init__(self, plan: FlightPlan, script: Script, *about: Any, **more: Any) -> None:
        self._near = script.near
        self._transport = Transport(script.t, script.dt)
        super().__init__(plan, *about, **more)
        self.dt, self.theta, self.duration = script.dt, script.theta, script.duration
        self.fail_t, self.is_checked = script.fail_t, script.is_checked
        self._script, self.manoeuvres = script, script.manoeuvres
        self._flown = 0.0
        self._furthest = self._at = -1
        self.no_plan = script.no_plan
        self._held: Ruling | None = None
        self._exceedances = script.exceedances
        self._is_waiting = plan.wait_for_viewer
        if self._is_waiting:
            self.reason = WAITING

    @property
    def lead(self) -> float:
        return self.plan.monitor.lead - self._script.delay

    @property
    def transport(self) -> TransportState:
        transport, script = self._transport, self._script
        return TransportState(
            playing=transport.playing and not self.is_over,
            speed=transport.speed,
            loop=transport.loop,
            start=float(script.t[0]),
            position=transport.position,
            duration=script.duration,
            sample=transport.index,
            n_samples=len(script.t),
            slipped=transport.slipped,
            seekable=True,
            waiting=self._is_waiting and not self.is_over,
        )

    @property
    def _position(self) -> int:
        return self._at

    def _planned_attitude(self) -> KnownAngles | None:
        planned = self._script.planned
        if planned is None:
            return None
        phi, theta, psi = planned[self._at].tolist()
        return phi, theta, psi

    @property
    def begun(self) -> list[ManoeuvreBegun]:
        times = enumerate(self._script.begun, 1)
        return [ManoeuvreBegun(number=number, t=t) for number, t in times]

    @property
    def trims(self) -> list[TrimChange] | None:
        return self._script.trims

    def start(self) -> None:
        if self.plan.monitors is not None and not self._script.shows_rulings:
            self._held = MonitorsRule(self.plan.monitors).at()
            self._hold(self._held)
        if self.plan.limits is not None:
            self.put_in_force(self.plan.limits, self.plan.by)
        self._send_heartbeat()
        if self._is_waiting:
            self._call_at("viewer", self.clock.now() + VIEWER_S, lambda: self.act("play"))
        else:
            self.act("play")

    def act(self, action: str, value: float | bool | None = None) -> None:
        if self.is_over:
            raise NotPossible("the flight has ended: start another one")
        now = self.clock.now()
        starts = self._is_waiting and action not in KEEP_WAITING
        if starts:
            self._transport.play(now)
        try:
            self._do(action, value, now)
        except TransportError:
            if starts:
                self._transport.pause()
            raise
        if starts:
            self._is_waiting = False
            self._stop_timer("viewer")
        self._tick(changed=True)

    def source_frames(self, first: int, last: int) -> list[dict[str, Any]]:
        script = self._script
        span = range(max(first, 0), min(last + 1, len(script.t)))
        return [
            plain_frame(k, script.y(k), assessment, None, display)
            for k in span
            for assessment, display in [self._assessed(k)]
        ]

    def _assess_waiting(self) -> None:
        """Nothing waits: samples are assessed in advance."""

    def _apply_limits(self, in_force: LimitsInForce) -> Ruling:
        if self._script.shows_rulings:
            raise NotPossible(
                "a replay of a live flight keeps the limits of that flight: they cannot be changed"
            )
        plan = self.plan
        monitors = [plan.monitor, *(shown.monitor for shown in plan.display)]
        self._held = LimitsRule(in_force, [monitor.envelope for monitor in monitors]).at()
        self._exceedances = self._script.exceeding(self._held.limits)
        self.alarms.forget()
        return self._held

    def _forecast_ahead(self) -> Ahead | None:
        ahead = self._script.forecast_ahead(self._at)
        if ahead is not None and self._is_at_end:
            return NothingAhead(ahead.made_t, OVER)
        return ahead

    @property
    def _is_at_end(self) -> bool:
        return self._at == len(self._script.t) - 1

    @property
    def _is_paused(self) -> bool:
        return self._transport.index >= 0 and not self._transport.playing

    def _ruled(self, k: int) -> Ruling | None:
        return self._script.ruling(k) or self._held

    def _assessed(self, k: int) -> tuple[Assessment, tuple[Assessment, ...]]:
        """The assessments of sample k under the limits in force, and those for display."""
        ruling, about = self._ruled(k), (self._script.assessment(k), self._script.display(k))
        return about if ruling is None or self._script.shows_rulings else ruling.apply(*about)

    def _exceeded(self, k: int) -> Exceeded | None:
        return self._script.exceeded(k, self._limits(k))

    def _limits(self, k: int) -> Envelope | None:
        ruling = self._ruled(k)
        return self.plan.monitor.envelope if ruling is None else ruling.limits

    def _do(self, action: str, value: float | bool | None, now: float) -> None:
        transport = self._transport
        is_number = isinstance(value, float | int) and not isinstance(value, bool)
        match action:
            case "play":
                transport.play(now)
            case "pause":
                transport.pause()
            case "next_alert":
                transport.jump(self._next_alert(), now)
            case "step" if value is None or (is_number and value == int(value)):
                transport.step(1 if value is None else int(value), now)
            case "seek" if value is not None and is_number:
                transport.seek(value, now)
            case "speed" if value is not None and is_number:
                transport.set_speed(value, now)
                self._use_scene(lambda scene: scene.wait(stale_after(self.dt, transport.speed)))
            case "loop" if isinstance(value, bool):
                transport.loop = value
            case _:
                raise TransportError(
                    f"{action} was given {value}: seek needs seconds, speed a factor, step a whole "
                    "number, loop true or false"
                )

    def _tick(self, changed: bool = False) -> None:
        transport = self._transport
        if self.is_over:
            return
        try:
            before, now = (transport.playing, transport.slipped), self.clock.now()
            flown = [self._fly_due(due) for due in transport.due_samples(now)]
            if flown:
                self._flown = now
                self._show()
            if changed or (transport.playing, transport.slipped) != before:
                self._broadcast(TransportChange(transport=self.transport).encode())
                self._send_headline()
                self._use_scene(lambda scene: scene.restate(self._facts))
            due = transport.next_due(now)
            self._await_stale()
            self._stop_timer("left")
            if due is None:
                self._stop_timer("tick")
                self._wait_at_end()
            else:
                self._call_at("tick", max(due, self._flown + TICK_S), self._tick)
        except Exception:
            self._fail()

    def _await_stale(self) -> None:
        """Plan `stale` where the replayed source was stale before its next sample."""
        after = self._script.stale_after(self._transport.index)
        if after is None or not self._transport.playing:
            self._stop_timer("stale")
        elif self.state is not State.STALE or self.reason == self._late:
            when = self._flown + after / self._transport.speed
            self._call_at("stale", when, lambda: self._miss(stale_after(self.dt)))

    def _wait_at_end(self) -> None:
        if self._transport.at_end:
            self._call_at("left", self.clock.now() + LEFT_S, self._leave_end)

    def _leave_end(self) -> None:
        if self.n_watchers and any(alarm.acknowledged is None for alarm in self.alarms.at_hand):
            self._wait_at_end()
            return
        minutes = LEFT_S / 60.0
        after = f"after {minutes:g} minutes at its end without a command"
        self._end("ended", f"the flight was ended by the server {after}")

    def _fly_due(self, due: Due) -> None:
        script, k = self._script, due.sample
        if due.restarts:
            self._restart(float(script.t[k]), script.held_until(k))
            self._pass(k)
        for sample in script.received(k, self._limits(k)):
            exceeded = self._note_received(sample)
            if not due.restarts:
                self._exceed(sample, exceeded)
        self._furthest, self._at = max(self._furthest, k), k
        self._manoeuvre = script.manoeuvre(k)
        self._late = script.late(k)
        self._hold(self._ruled(k), float(script.t[k]))
        assessment, display = self._assessed(k)
        about = self._exceeded(k), due.due, k, script.attitude(k), display
        self._fly(
            script.y(k),
            assessment,
            *about,
            judged=script.judged(k),
            recorded=script.recorded(k),
            far=script.far(k),
            arrived=script.arrived(k),
        )
        self._doubt(script.doubts(k))

    def _pass(self, k: int) -> None:
        """Raise the alarms that a seek to sample k passes: the first new one of each kind.

        A condition that still holds at k raises its alarm with the sample of its onset.
        """
        script, passed = self._script, set[tuple[int, AlarmKind]]()
        about: tuple[tuple[AlarmKind, Indices], ...] = (
            ("limit", self._exceedances),
            ("risk", script.alerts),
        )
        for kind, begins in about:
            new = begins[(begins > self._furthest) & (begins < k)][:1]
            passed.update((at, kind) for at in new.tolist())
        under_way = set[tuple[int, AlarmKind]]()
        under_way.update((at, kind) for kind in LASTING if (at := self._since(k, kind)) < k)
        for at, kind in sorted(passed | under_way):
            exceeded, ruling = self._exceeded(at) if kind == "limit" else None, self._ruled(at)
            if exceeded is not None:
                self.exceedances.pass_by(exceeded, goes_on=(at, kind) in under_way)
            seq, (assessment, _) = self.head + 1, self._assessed(at)
            self._raise_alarms(
                self.alarms.update(
                    seq,
                    at,
                    assessment,
                    exceeded,
                    self.clock,
                    only=kind,
                    beyond=beyond_of(ruling),
                    arrived=script.arrived(at),
                    manoeuvre=script.manoeuvre(at),
                )
            )

    def _since(self, k: int, kind: AlarmKind) -> int:
        """Onset of the condition that raises this alarm at sample k; k if it does not hold."""
        began = k
        for at in range(k, max(k - MOST_BACK, 0) - 1, -1):
            if kind == "limit":
                holds = goes_on = self._exceeded(at) is not None
            else:
                assessment, _ = self._assessed(at)
                holds = goes_on = gives_alarm(kind, assessment)
                if kind == "risk" and at < k:
                    goes_on = holds or assessment.state is not State.OK
            if not goes_on:
                break
            began = at if holds else began
        return began

    def _next_alert(self) -> int:
        if self._held is not None and self._held.reasons[0]:
            raise NotPossible(f"no alerts under these limits: {self._held.reasons[0]}")
        k = self._script.next_alert(self._transport.index)
        if k is None:
            raise NotPossible(
                f"no alert after {self._transport.position:g} s: seek back to an earlier one"
            )
        return k
