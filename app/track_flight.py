"""The flight of a source that is known from start to end.

It is assessed whole before it flies. What is played of it, in whatever order and speed, are
samples of that one batch: seek, step and loop cannot change a bit of a score, and each sample has
the history of the flight, not that of the jump.
"""

from typing import Any

import numpy as np

from app.flight import Angles, Flight, FlightPlan
from app.messages import TransportChange, TransportState, plain_frame
from app.sources import Track
from app.transport import Due, NotPossible, Transport, TransportError
from core.monitor import Assessment, State
from core.monitor.assessment import REASONS, STATES

TICK_S = 0.016
"""[s] Samples due within this time go out together."""


class TrackFlight(Flight):
    """A flight with play, pause, seek, step, speed, loop and next_alert.

    Making one assesses the whole track: it may be made in a thread.
    At the end of its source it pauses, and can be played again until it is stopped.
    """

    def __init__(self, plan: FlightPlan, track: Track, *about: Any, **more: Any) -> None:
        super().__init__(plan, *about, **more)
        self.dt, self.theta, self.duration = track.dt, track.theta, track.duration
        if track.fail_index is not None:
            self.fail_t = float(track.t[track.fail_index])
        self._track = track
        self._said = plan.monitor.assess(track.t, track.y, plan.epsilon)
        self._transport = Transport(track.t, track.dt)
        self._flown = 0.0

    @property
    def transport(self) -> TransportState:
        """Where it is in its source."""
        transport, track = self._transport, self._track
        return TransportState(
            playing=transport.playing and not self.is_over,
            speed=transport.speed,
            loop=transport.loop,
            position=transport.position,
            duration=track.duration,
            sample=transport.index,
            n_samples=len(track.t),
            slipped=transport.slipped,
            seekable=True,
        )

    def start(self) -> None:
        """Begin to fly, playing."""
        self._beat()
        self.act("play")

    def act(self, action: str, value: float | bool | None = None) -> None:
        """Do an action of the transport; TransportError says what is wrong with it."""
        if self.is_over:
            raise NotPossible("the flight is over: start another one")
        self._do(action, value, self.clock.now())
        self._tick(changed=True)

    def source_frames(self, first: int, last: int) -> list[dict[str, Any]]:
        """Samples first..last of the source, flown yet or not; `seq` is their number in it."""
        span = range(max(first, 0), min(last + 1, len(self._track.t)))
        return [plain_frame(k, self._track.y[k], self._assessment(k), None) for k in span]

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
            case "loop" if isinstance(value, bool):
                transport.loop = value
            case _:
                raise TransportError(
                    f"{action} was asked with value {value}: seek takes seconds, speed a factor, "
                    "step a whole number, loop true or false"
                )

    def _tick(self, changed: bool = False) -> None:
        """Fly what is due, then wait for what follows."""
        transport = self._transport
        if self.is_over:
            return
        try:
            before, now = (transport.playing, transport.slipped), self.clock.now()
            flown = [self._fly_due(due) for due in transport.take(now)]
            if flown:
                self._flown = now
                self._show()
            if changed or (transport.playing, transport.slipped) != before:
                self._tell(TransportChange(transport=self.transport).encode())
                if not transport.playing:
                    self._stage(lambda scene: scene.hold())
            due = transport.next_due(now)
            if due is None:
                self._stop_timer("tick")
            else:
                self._call_at("tick", max(due, self._flown + TICK_S), self._tick)
        except Exception:
            self._fail()

    def _fly_due(self, due: Due) -> None:
        track, k = self._track, due.sample
        if due.restarts:
            self._restart(float(track.t[k]))
        phi, theta, psi = track.attitude[k].tolist()
        angles: Angles = phi, theta, psi
        self._fly(track.y[k], self._assessment(k), due.due, k, angles)

    def _assessment(self, k: int) -> Assessment:
        """What the batch says of sample k."""
        said = self._said
        code = int(said.state[k])
        t, state, reason = float(said.t[k]), STATES[code], REASONS[code]
        if state is not State.OK:
            return Assessment(t, None, None, state, reason)
        forecasts = self.plan.monitor.recipe.predictor.forecasts
        y_hat = said.y_hat[k] if forecasts else None
        return Assessment(t, float(said.p_value[k]), bool(said.alert[k]), state, reason, y_hat)

    def _next_alert(self) -> int:
        """Sample at which the next alert begins."""
        alert = self._said.alert
        onsets = np.flatnonzero(alert & ~np.concatenate([[False], alert[:-1]]))
        later = onsets[onsets > self._transport.index]
        if not len(later):
            raise NotPossible(
                f"no alert begins after {self._transport.position:g} s: seek back to find one"
            )
        return int(later[0])
