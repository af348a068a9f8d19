"""The scenes of the live flights: each a viser server of its own, redrawn by one common ticker.

`show` only keeps the newest state; a thread draws it, at most 20 times a second, and only while
someone watches. A scene to which nothing comes any more says STALE by itself.
"""

import asyncio
import logging
import threading
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from math import isfinite
from typing import Self

from app.scene.picture import Picture, Shown
from app.scene.server import address, open_server
from core.monitor.assessment import Cause, State
from core.monitor.status import Facts
from core.simulation.aircraft import AircraftClass
from core.simulation.attitude import Attitude, SurfaceSigns

PERIOD_S = 0.05
"""Between two drawings [s]: 20 Hz."""
STALE_AFTER_S = 2.0
"""Without a new sample for so long a scene says STALE that its flight told no better [s]."""
MAX_SCENES = 64
LOG = logging.getLogger("forewarn")

Clock = Callable[[], float]
_Pose = tuple[float, tuple[float, float, float], float, float, float]
_Said = tuple[float | None, float, bool | None, State | str, str, Facts | None, Cause | None]
NOTHING_YET = Shown(
    0.0, Attitude(0.0, 0.0, 0.0), 0.0, 0.0, 0.0, None, 1.0, False, State.STALE, "no sample yet"
)
USUAL_SIGNS = SurfaceSigns(aileron=1, rudder=-1)


class TooManyScenes(RuntimeError):
    """As many flights as there may be show a scene already."""


class Scene:
    """The 3-D view of one flight. `show`, `hold` and `close` may be called from any thread."""

    def __init__(
        self,
        clock: Clock,
        signs: SurfaceSigns,
        alpha0: float,
        stale_after_s: float,
        aircraft_class: AircraftClass = "fighter",
    ) -> None:
        self._clock, self._stale_after_s = clock, stale_after_s
        self._lock, self._latest = threading.RLock(), threading.Lock()
        self._shown, self._came = NOTHING_YET, clock()
        self._pose: _Pose = NOTHING_YET[:5]
        self._said: _Said | None = None
        self._drawn: Shown | None = None
        self._watchers: list[Callable[[], object]] = []
        self._closed = False
        self._server = open_server()
        try:
            self._picture = Picture(self._server, signs, alpha0, aircraft_class)
        except BaseException:
            self._server.stop()
            raise
        self.address = address(self._server)

    def show(
        self,
        t: float,
        attitude: tuple[float, float, float],
        beta: float,
        delta_a: float,
        delta_r: float,
        p_value: float | None,
        alert_above: float,
        alert: bool | None,
        state: State | str,
        reason: str = "",
        facts: Facts | None = None,
        cause: Cause | None = None,
    ) -> None:
        """Show this from the next drawing on; an earlier one that was not drawn yet is dropped.

        t: flight time [s].   attitude: phi, theta, psi [rad].   beta, delta_a, delta_r: [rad].
        p_value, alert: None unless state is `ok`; `ok` without a finite p-value shows as INVALID.
        facts: what the flight's headline is decided from; of this sample alone unless given.
        cause: why the sample is invalid, where there is a word of its own for it.
        Angles that are not finite keep the last pose.
        After `close` this does nothing. Costs a microsecond or two and never waits.
        """
        with self._latest:
            if isfinite(t + sum(attitude) + beta + delta_a + delta_r):
                self._pose = t, attitude, beta, delta_a, delta_r
            self._said = p_value, alert_above, alert, state, reason, facts, cause
            self._came = self._clock()

    def wait(self, stale_after_s: float) -> None:
        """From now on wait so long for a sample before saying STALE [s]; the wait begins anew."""
        with self._latest:
            self._stale_after_s, self._came = stale_after_s, self._clock()

    def restate(self, facts: Facts) -> None:
        """The headline's facts have changed, without a sample."""
        with self._latest:
            self._shown = self._newest()._replace(facts=facts)

    def hold(self) -> None:
        """The flight is paused: keep what is shown, and say PAUSED, not STALE, until a `show`."""
        with self._latest:
            self._shown = self._newest()._replace(paused=True)

    def draw(self) -> bool:
        """Bring the watchers' picture up to date; whether there was anything new."""
        with self._lock:
            if self._closed:
                return False
            shown = self._now()
            if shown is self._drawn or shown == self._drawn:
                return False
            self._picture.draw(shown)
            self._drawn = shown
            return True

    def _newest(self) -> Shown:
        """What was shown last, made when it is needed; under the lock."""
        if self._said is not None:
            t, attitude, beta, delta_a, delta_r = self._pose
            p_value, alert_above, alert, state, reason, facts, cause = self._said
            if p_value is not None and not isfinite(p_value):
                p_value = None
            assessment = p_value, alert_above, bool(alert), State(state), reason
            pose = t, Attitude(*attitude), beta, delta_a, delta_r
            self._shown = Shown(*pose, *assessment, facts=facts, cause=cause)
            self._said = None
        return self._shown

    def _now(self) -> Shown:
        """What is to be seen now: what came last, or STALE where that is too long ago."""
        with self._latest:
            came, shown, patience = self._came, self._newest(), self._stale_after_s
        silent = self._clock() - came
        if silent <= patience or shown.paused or shown.state is State.STALE:
            return shown
        reason = f"no sample for {max(silent // 1.0, patience):g} s"
        facts = shown.facts and shown.facts._replace(stale=True)
        late = {"p_value": None, "alert": False, "state": State.STALE, "reason": reason}
        return shown._replace(**late, facts=facts)

    @property
    def is_watched(self) -> bool:
        """Whether anyone has the scene open."""
        return bool(self._watchers)

    @contextmanager
    def watching(self, on_close: Callable[[], object]) -> Iterator[None]:
        """Someone watches: the picture is made current at once, and on_close called at `close`."""
        with self._lock:
            self._watchers.append(on_close)
            if self._closed:
                on_close()
            else:
                self.draw()
        try:
            yield
        finally:
            with self._lock:
                self._watchers.remove(on_close)

    def close(self) -> None:
        """Send the watchers away and stop the server; blocks for up to a second or so."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            watchers = list(self._watchers)
        for send_away in watchers:
            send_away()
        self._server.stop()


class Scenes:
    """All scenes of the program, by flight, and the thread that draws them.

    clock: seconds, monotonic.   Use `lifespan` around the server's life, or `stop` at its end.
    """

    def __init__(
        self,
        max_scenes: int = MAX_SCENES,
        clock: Clock = time.monotonic,
        stale_after_s: float = STALE_AFTER_S,
    ) -> None:
        self.max_scenes, self._clock, self._stale_after_s = max_scenes, clock, stale_after_s
        self._scenes: dict[str, Scene] = {}
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._ticker: threading.Thread | None = None

    def open(
        self,
        flight: str,
        signs: SurfaceSigns = USUAL_SIGNS,
        alpha0: float = 0.0,
        stale_after_s: float | None = None,
        aircraft_class: AircraftClass = "fighter",
    ) -> Scene:
        """Open the scene of a flight, or return the one that is open; blocks for some 30 ms.

        signs: which way the aircraft's surfaces act.   alpha0: angle of attack at trim [rad].
        stale_after_s: as of `Scene.wait`.   aircraft_class: what the aircraft looks like.
        Raises TooManyScenes at max_scenes, and RuntimeError after `stop`.
        """
        with self._lock:
            if self._stopping.is_set():
                raise RuntimeError("the server is stopping: no scene opens any more")
            if flight in self._scenes:
                return self._scenes[flight]
            if len(self._scenes) >= self.max_scenes:
                raise TooManyScenes(
                    f"{self.max_scenes} flights show a scene already; end one of them, or raise "
                    "the number of flights"
                )
            patience = stale_after_s or self._stale_after_s
            scene = Scene(self._clock, signs, alpha0, patience, aircraft_class)
            self._scenes[flight] = scene
            if self._ticker is None:
                self._ticker = threading.Thread(target=self._tick, name="scenes", daemon=True)
                self._ticker.start()
            return scene

    def get(self, flight: str) -> Scene | None:
        """The open scene of a flight, if it has one."""
        return self._scenes.get(flight)

    def close(self, flight: str) -> None:
        """Close the scene of a flight, if it has one; blocks, see Scene.close."""
        with self._lock:
            scene = self._scenes.pop(flight, None)
        if scene is not None:
            scene.close()

    def stop(self) -> None:
        """Close every scene and end the drawing thread."""
        with self._lock:
            self._stopping.set()
        for flight in list(self._scenes):
            self.close(flight)
        if self._ticker is not None:
            self._ticker.join()

    @asynccontextmanager
    async def lifespan(self) -> AsyncIterator[Self]:
        """For the server's lifespan: stops everything at its end, off the event loop."""
        try:
            yield self
        finally:
            await asyncio.to_thread(self.stop)

    def _tick(self) -> None:
        while not self._stopping.wait(PERIOD_S):
            for flight, scene in list(self._scenes.items()):
                if scene.is_watched:
                    self._draw(flight, scene)

    def _draw(self, flight: str, scene: Scene) -> None:
        """Draw one scene; one that fails is closed, since a frozen picture would lie."""
        try:
            scene.draw()
        except Exception:
            LOG.exception("the scene of flight %s failed and is closed", flight)
            self.close(flight)
