"""The scenes of flights in progress: one viser server each, redrawn by one common thread.

`show` only stores the newest state; the thread draws it at most 20 times a second, and only while
someone watches. Without new samples a scene turns STALE by itself.
"""

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import isfinite

from app.scene.airframes import Part, airframe
from app.scene.own_airframe import own_airframe
from app.scene.picture import Picture
from app.scene.server import address, open_server
from app.scene.shown import POSE, Shown
from core.monitor.assessment import State
from core.monitor.status import Facts
from core.simulation.aircraft import AircraftClass
from core.simulation.attitude import SurfaceSigns

PERIOD_S = 0.05
"""Between two drawings [s]: 20 Hz."""
STALE_AFTER_S = 2.0
"""Default time without a new sample after which a scene is STALE [s]."""
LOG = logging.getLogger("forewarn")

Clock = Callable[[], float]
NOTHING_YET = Shown(
    0.0,
    attitude=(None, None, None),
    beta=None,
    delta_a=None,
    delta_r=None,
    p_value=None,
    alert_above=1.0,
    alert=False,
    state=State.STALE,
    reason="no sample yet",
    facts=Facts(stale=True),
)
USUAL_SIGNS = SurfaceSigns(aileron=1, rudder=-1)


class Scene:
    """The 3-D view of one flight. `show`, `hold` and `close` may be called from any thread."""

    def __init__(
        self,
        clock: Clock,
        signs: SurfaceSigns,
        alpha0: float,
        stale_after_s: float,
        parts: tuple[Part, ...] = (),
    ) -> None:
        self._clock, self._stale_after_s = clock, stale_after_s
        self._lock, self._latest = threading.RLock(), threading.Lock()
        self._shown, self._shown_at = NOTHING_YET, clock()
        self._drawn: Shown | None = None
        self._watchers: list[Callable[[], object]] = []
        self._closed = False
        self._server = open_server()
        try:
            self._picture = Picture(self._server, signs, alpha0, parts or airframe("fighter"))
        except BaseException:
            self._server.stop()
            raise
        self.address = address(self._server)

    def show(self, shown: Shown) -> None:
        """Show this state at the next drawing; it replaces one that was not drawn yet.

        Non-finite angles keep the last pose; None is an angle that the flight does not know. No
        effect after `close`. Costs a microsecond or two and never waits.
        """
        with self._latest:
            t, attitude, *angles = shown[:5]
            numbers = (t, *attitude, *angles, shown.delta_e, shown.alpha)
            if not all(map(isfinite, [number for number in numbers if number is not None])):
                shown = shown._replace(**{name: getattr(self._shown, name) for name in POSE})
            self._shown, self._shown_at = shown, self._clock()

    def wait(self, stale_after_s: float) -> None:
        """Set the time without a sample after which the scene is STALE [s]; the wait restarts."""
        with self._latest:
            self._stale_after_s, self._shown_at = stale_after_s, self._clock()

    def restate(self, facts: Facts) -> None:
        with self._latest:
            self._shown = self._shown._replace(facts=facts)

    def draw(self) -> bool:
        """Update the picture. Returns whether anything was new."""
        with self._lock:
            if self._closed:
                return False
            shown = self._now()
            if shown is self._drawn or shown == self._drawn:
                return False
            self._picture.draw(shown)
            self._drawn = shown
            return True

    def _now(self) -> Shown:
        with self._latest:
            shown_at, shown, stale_after_s = self._shown_at, self._shown, self._stale_after_s
        silent = self._clock() - shown_at
        if silent <= stale_after_s or shown.facts.paused or shown.state is State.STALE:
            return shown
        reason = f"no sample for {max(silent // 1.0, stale_after_s):g} s"
        facts = shown.facts._replace(stale=True)
        late = {"p_value": None, "alert": False, "state": State.STALE, "reason": reason}
        return shown._replace(**late, facts=facts)

    @property
    def is_watched(self) -> bool:
        return bool(self._watchers)

    @contextmanager
    def watching(self, on_close: Callable[[], object]) -> Iterator[None]:
        """While someone watches: update the picture at once, and call on_close at `close`."""
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
        """Disconnect the watchers and stop the server; blocks for up to about a second."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            watchers = list(self._watchers)
        for disconnect in watchers:
            disconnect()
        self._server.stop()


class Scenes:
    """All scenes of the program, by flight, and the thread that draws them; `stop` at the end."""

    def __init__(
        self,
        stale_after_s: float = STALE_AFTER_S,
    ) -> None:
        self._stale_after_s = stale_after_s
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
        own: bytes | None = None,
    ) -> Scene:
        """Open the scene of a flight, or return the open one; blocks for about 30 ms.

        signs: directions in which the surfaces act.   alpha0: angle of attack at trim [rad].
        stale_after_s: see `Scene.wait`.   aircraft_class: shape of the drawn aircraft, but for
        an `own` one as a file, see `own_airframe`.
        RuntimeError after `stop`.
        """
        with self._lock:
            if self._stopping.is_set():
                raise RuntimeError("the server is stopping: no scene can be opened")
            if flight in self._scenes:
                return self._scenes[flight]
            stale_after_s = stale_after_s or self._stale_after_s
            parts = airframe(aircraft_class) if own is None else own_airframe(own)
            scene = Scene(time.monotonic, signs, alpha0, stale_after_s, parts)
            self._scenes[flight] = scene
            if self._ticker is None:
                self._ticker = threading.Thread(target=self._tick, name="scenes", daemon=True)
                self._ticker.start()
            return scene

    def get(self, flight: str) -> Scene | None:
        return self._scenes.get(flight)

    def close(self, flight: str) -> None:
        """Close the scene of a flight, if any; blocks, see Scene.close."""
        with self._lock:
            scene = self._scenes.pop(flight, None)
        if scene is not None:
            scene.close()

    def stop(self) -> None:
        with self._lock:
            self._stopping.set()
        for flight in list(self._scenes):
            self.close(flight)
        if self._ticker is not None:
            self._ticker.join()

    def _tick(self) -> None:
        while not self._stopping.wait(PERIOD_S):
            for flight, scene in list(self._scenes.items()):
                if scene.is_watched:
                    self._draw(flight, scene)

    def _draw(self, flight: str, scene: Scene) -> None:
        """Draw one scene; close it if that fails, since a frozen picture would mislead."""
        try:
            scene.draw()
        except Exception:
            LOG.exception("the scene of flight %s failed and is closed", flight)
            self.close(flight)
