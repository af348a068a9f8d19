"""All flights under way: started, found, stopped, and none left behind at the end."""

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self

from pydantic import ValidationError

from app.flights.clock import Clock, MonotonicClock, Timer
from app.flights.display_monitors import DisplayMonitor, check_alike, check_limits
from app.flights.ended import before_exceedance
from app.flights.flight import Flight, FlightPlan, patience
from app.flights.flight_limits import change_of_limits
from app.flights.flight_recordings import RESUMED_WITHIN_S, FlightRecordings
from app.flights.flight_records import (
    ACCEPT_USELESS,
    NAME,
    FlightRecords,
    flight_name,
    source_of,
)
from app.flights.recorder import INTERVAL_S, Recorder
from app.flights.request import FlightRequest
from app.flights.shown_flight import ShownFlight
from app.flights.sources.live import LiveFlight, LiveSetup
from app.flights.sources.playback import Script
from app.flights.sources.source import (
    FlownLive,
    Live,
    Opening,
    aircraft_of,
    journal_setup,
    mode_of,
    trim_angles,
)
from app.flights.sources.track import SourceError
from app.flights.transport import NotPossible
from app.flights.verdict import first_exceedance
from app.live.again import header_of
from app.live.journal import Journals, lines_of
from app.messages import FlightMarker, LiveStatus
from app.recordings.scored import ScoredRecordings
from app.scoring.limits_in_force import LimitsInForce, RequestedLimits
from app.store.flights import INTERRUPTED, FlightInProgress
from app.store.health import StoreHealth
from app.store.store import NotFound, Store, StoreError
from app.store.tokens import LOCAL
from core.evaluation.certificate import check_use
from core.flight_markers import FlightMarkerKey
from core.limit_set import ConditionKey
from core.monitor import Monitor
from core.simulation.attitude import SurfaceSigns, surface_signs

if TYPE_CHECKING:
    from app.scene.scene import Scene, Scenes

LOG = logging.getLogger("forewarn")
STOPPING = "the server is stopping"
RECORDING_THREADS = 2
"""One may wait for the disk while the other stores an alarm."""


class TooManyFlights(RuntimeError):
    """As many flights are under way as may be."""


@dataclass
class _Ending:
    """A flight that is being ended: with which word, and how far that got."""

    status: str
    has_stopped: bool = False
    lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    timer: Timer | None = None


class Flights:
    """The flights of a server; a context, at whose end every flight is stopped and recorded."""

    def __init__(
        self,
        store: Store,
        scenes: "Scenes | None" = None,
        max_flights: int = 64,
        clock: Clock | None = None,
        scored: ScoredRecordings | None = None,
        store_health: StoreHealth | None = None,
        journals: Journals | None = None,
        host: str = "127.0.0.1",
    ) -> None:
        self._store_health, self._journals, self._host = store_health, journals, host
        self.store, self.max_flights, self._scored = store, max_flights, scored
        self._scenes, self._clock = scenes, clock or MonotonicClock()
        self._flights: dict[str, Flight] = {}
        self._starting = 0
        self._closing = False
        self._resuming = asyncio.Lock()
        self._stopping: set[asyncio.Task[None]] = set()
        self._endings: dict[str, _Ending] = {}
        self._recording = ThreadPoolExecutor(RECORDING_THREADS, "recorder")
        self.records = FlightRecords(store, self._flights, self._recording)
        self._recordings = (
            None
            if scored is None or journals is None
            else FlightRecordings(scored.recordings, journals)
        )
        self._lost_before = 0

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Stop every flight; none starts any more. What the store refuses to the last is lost."""
        self._closing = True
        await asyncio.gather(*(self._close(flight) for flight in [*self._flights]))
        await asyncio.gather(*self._stopping)
        await asyncio.to_thread(self._recording.shutdown)

    async def _close(self, flight_id: str) -> None:
        try:
            is_live = isinstance(self.get(flight_id), LiveFlight)
            await self.stop(flight_id, INTERRUPTED if is_live else "ended", STOPPING)
        except Exception:
            LOG.exception("flight %s ended, but its record is not complete", flight_id)
            if flight := self._flights.pop(flight_id, None):
                flight.recorder.give_up()

    @property
    def unwritten(self) -> int:
        """Samples of flights under way that wait for the store."""
        return sum(flight.recorder.unwritten for flight in self._flights.values())

    @property
    def lost(self) -> int:
        """Samples that could not be recorded since the server started."""
        under_way = sum(flight.recorder.lost for flight in self._flights.values())
        return self._lost_before + under_way

    @property
    def problem(self) -> str:
        """Why a flight is not recorded at present; empty where all are."""
        problems = (flight.recorder.problem for flight in self._flights.values())
        return next(filter(None, problems), "")

    def under_way(self) -> list[Flight]:
        """Flights under way, newest last."""
        return list(self._flights.values())

    def get(self, flight_id: str) -> Flight | None:
        """Return a flight under way."""
        return self._flights.get(flight_id)

    def flying(self, flight_id: str) -> Flight:
        """Return a flight under way; NotFound."""
        flight = self.get(flight_id)
        if flight is None or flight.is_over:
            raise NotFound(f"no flight {flight_id!r} is under way: it ended, or never was")
        return flight

    async def start(self, request: FlightRequest, by: str = LOCAL) -> Flight:
        """Start a flight. by: who does.

        TooManyFlights; SourceError and RecipeError for the source; ValueError for an epsilon that
        the monitor cannot serve; LimitsUnknown; UselessMonitor; NotFound.
        """
        self._take_place()
        try:
            monitor = await asyncio.to_thread(self._monitor, request.monitor)
            epsilon = monitor.check_epsilon(request.epsilon)
            if not request.accept_useless:
                check_use(monitor.evaluation, epsilon)
            shown = [(one, None) for one in request.monitors]
            display = await asyncio.to_thread(self._display, monitor, shown)
            limits = await asyncio.to_thread(self._asked_limits, request, monitor)
            opening = self._opening(request.monitor, monitor, epsilon)
            opening = opening._replace(display=display, conditions=request.source_names)
            script, name = await asyncio.to_thread(request.source.open, opening)
            source = request.source.model_dump(exclude_none=True)
            plan = await self._plan(request, request.name or name, source, epsilon, display)
            waits = request.wait_for_viewer
            plan = replace(plan, limits=limits, by=by, wait_for_viewer=waits)
            return await self._start(plan, request.source.flight, script)
        finally:
            self._starting -= 1

    def _asked_limits(self, request: FlightRequest, monitor: Monitor) -> RequestedLimits | None:
        if request.limit_set is None:
            return None
        if isinstance(request.source, FlownLive):
            raise SourceError(
                "a replay of a live flight is held against the limits that it was: leave limit_set "
                "out"
            )
        asked = request.limit_set, request.limit_set_version, request.declared
        return change_of_limits(self.store, monitor, *asked)

    async def put_in_force(
        self,
        flight_id: str,
        limit_set: str,
        version: int | None,
        fixed: Mapping[ConditionKey, float],
        by: str,
    ) -> LimitsInForce:
        """Hold a flight under way against a limit set from its next sample on.

        NotFound; NotPossible; JournalFull; StoreError: it is in force, and stored as soon as the
        store takes it.
        """
        monitor = self.flying(flight_id).plan.monitor
        asked = limit_set, version, fixed
        change = await asyncio.to_thread(change_of_limits, self.store, monitor, *asked)
        flight = self.flying(flight_id)
        in_force = flight.put_in_force(change, by)
        try:
            await flight.recorder.store_alarms()
        except StoreError as error:
            raise StoreError(
                f"{in_force.words} is in force and shown on every screen, and is not stored yet: "
                f"{error}; it is stored as soon as that is so, do not put it in force again"
            ) from error
        return in_force

    def _opening(self, monitor_id: str, monitor: Monitor, epsilon: float) -> Opening:
        return Opening(
            self.store, self._scored, monitor_id, monitor, epsilon, self._journals, self._host
        )

    async def live(self, flight_id: str) -> LiveFlight:
        """A live flight that takes samples; one that a killed server flew goes on.

        NotFound; NotPossible where it is over, or not live.
        """
        flight = self.get(flight_id)
        if flight is None or (isinstance(flight, LiveFlight) and flight.is_restoring):
            async with self._resuming:
                flight = self.get(flight_id) or await self._resume(flight_id)
        if not isinstance(flight, LiveFlight):
            raise NotPossible(f"flight {flight_id} is not live: it takes no samples")
        if flight.is_over:
            raise NotPossible("the flight is over: start another one")
        return flight

    async def live_status(self, flight_id: str) -> LiveStatus | None:
        """How the source of a live flight does, or did at its end; None where nobody knows."""
        flight = self.get(flight_id)
        if flight is not None or self._journals is None:
            return flight.live if flight else None
        end = await asyncio.to_thread(self._journals.last, flight_id)
        try:
            return LiveStatus.model_validate(end["live"])
        except (KeyError, ValidationError):
            return None

    async def resume_all(self) -> None:
        """Go on with the live flights that were under way when the server was killed."""
        if self._journals is None:
            return
        for info in await asyncio.to_thread(self.store.flights.all):
            if info.status == INTERRUPTED and source_of(info).get("kind") == "live":
                path = self._journals.path(info.id)
                if path.exists() and time.time() - path.stat().st_mtime < RESUMED_WITHIN_S:
                    try:
                        await self.live(info.id)
                    except Exception:
                        LOG.exception("flight %s is not resumed", info.id)

    def show_again(
        self, flight_id: str, monitor_id: str | None, epsilon: float | None
    ) -> tuple[ShownFlight, Opening]:
        """Score a live flight that is over by what had come at each moment; for a thread.

        monitor_id, epsilon: those of the flight if None; of another monitor its own epsilon.
        NotFound; SourceError where it has no journal; LimitsUnknown; ValueError for the epsilon.
        """
        info = self.store.flights.info(flight_id)
        is_own = monitor_id in (None, info.monitor_id)
        monitor = self._monitor(monitor_id or info.monitor_id)
        epsilon = info.epsilon if is_own and epsilon is None else monitor.check_epsilon(epsilon)
        opening = self._opening(monitor_id or info.monitor_id, monitor, epsilon)
        return ShownFlight(journal_setup(opening, flight_id), flight_id), opening

    async def make_recordings(self) -> None:
        """Make the recordings of live flights that are over and have none, in the background."""
        if self._recordings is None:
            return
        try:
            waiting = await asyncio.to_thread(self._recordings.waiting)
        except (StoreError, OSError) as error:
            LOG.warning("live flights become recordings at the next start: %s", error)
            return
        for flight_id in waiting:
            self._make_recording(flight_id)

    def _make_recording(self, flight_id: str) -> None:
        """Have a live flight that is over become a recording, in the background."""
        if self._recordings is None or self._closing:
            return
        task = asyncio.create_task(self._recordings.make(flight_id))
        self._stopping.add(task)
        task.add_done_callback(self._stopping.discard)

    async def end_reason(self, flight_id: str) -> str:
        """Why a live flight that is over ended and by whom; empty where its journal does not say.

        OSError.
        """
        if self.get(flight_id) is not None or self._journals is None:
            return ""
        return str((await asyncio.to_thread(self._journals.last, flight_id)).get("reason", ""))

    async def end(self, flight_id: str, by: str) -> None:
        """End a flight; one of a killed server is gone on with first, so that its record is whole.

        by: who ends it, as its watchers and its journal are told.   As `stop` and `live`.
        """
        if self.get(flight_id) is None:
            info = await asyncio.to_thread(self.store.flights.info, flight_id)
            is_live = source_of(info).get("kind") == "live" and self._journals is not None
            if is_live and info.status == INTERRUPTED and info.recording_id is None:
                with suppress(NotPossible):  # nothing is left to go on with
                    await self.live(flight_id)
        await self.stop(flight_id, reason=f"the flight was ended by {by}")

    async def _resume(self, flight_id: str) -> Flight:
        """Go on with a live flight whose server was killed, by its journal."""
        info = await asyncio.to_thread(self.store.flights.info, flight_id)
        source = source_of(info)
        journals = self._journals
        if source.get("kind") != "live" or info.status != INTERRUPTED or journals is None:
            raise NotPossible(f"flight {flight_id} takes no samples: it is over, or not live")
        making = self._recordings.under_way if self._recordings else None
        if info.recording_id is not None or making == flight_id:
            raise NotPossible(
                f"flight {flight_id} takes no samples: it was interrupted and is a recording now"
            )
        self._take_place()
        try:
            monitor = await asyncio.to_thread(self._monitor, info.monitor_id)
            request = FlightRequest.model_validate({"source": source, "monitor": info.monitor_id})
            of_flight = await asyncio.to_thread(self.store.flights.display, [flight_id])
            shown = of_flight.get(flight_id, [])
            display = await asyncio.to_thread(self._display, monitor, shown)
            opening = self._opening(info.monitor_id, monitor, info.epsilon)
            opening = opening._replace(display=display)
            live, path = request.source, journals.path(flight_id)
            assert isinstance(live, Live)
            if not path.exists():
                raise NotPossible(
                    f"flight {flight_id} takes no samples: it was interrupted, and its journal "
                    "is missing"
                )
            header = await asyncio.to_thread(header_of, path)
            setup, name = await asyncio.to_thread(live.open_again, opening, header or {})
            alarms = await self.records.alarms(flight_id)
            markers = await self.records.markers(flight_id)
            about = await asyncio.to_thread(self.store.monitors.info, info.monitor_id)
            plan = FlightPlan(
                flight_id,
                flight_name(info) or name,
                source,
                monitor,
                info.monitor_id,
                about.name,
                info.epsilon,
                display=display,
            )
            stored = -1 if info.head is None else info.head

            async def go_on(flight: Flight) -> None:
                assert isinstance(flight, LiveFlight)
                flight.is_restoring = True
                lines = lines_of(path)
                unrecorded = await asyncio.to_thread(flight.restore, lines, stored, alarms, markers)
                if (first := first_exceedance(alarms)) is not None:
                    about = flight_id, first.seq, monitor.dt
                    flight.judge(await asyncio.to_thread(before_exceedance, self.store, *about))
                await asyncio.to_thread(self.store.flights.resume, flight_id, flight.head)
                flight.resume(unrecorded)

            return await self._start(plan, request.source.flight, setup, go_on)
        finally:
            self._starting -= 1

    async def stop(
        self, flight_id: str, status: str = "ended", reason: str = "the flight was ended"
    ) -> None:
        """Stop a flight and complete its record; nothing for one that is not under way.

        StoreError where the store does not take it: the flight is over, and what waits is written,
        without being asked again, as soon as it can be.
        """
        flight = self.get(flight_id)
        if flight is None:
            return
        ending = self._endings.setdefault(flight_id, _Ending(status))
        async with ending.lock:
            if flight_id not in self._endings:
                return
            if not ending.has_stopped:
                await flight.stop(reason)
                if self._scenes is not None:
                    await asyncio.to_thread(self._scenes.close, flight_id)
                ending.has_stopped = True
            try:
                came_to = flight.exceeded_t, flight.exceedances.of_channels, flight.limits_held
                await flight.recorder.complete(ending.status, *came_to)
            except StoreError:
                self._stop_later(flight_id, ending)
                raise
            self._lost_before += flight.recorder.lost
            del self._flights[flight_id], self._endings[flight_id]
            if isinstance(flight, LiveFlight) and ending.status != INTERRUPTED:
                self._make_recording(flight_id)

    def _stop_later(self, flight_id: str, ending: "_Ending") -> None:
        """Try again to complete the record of a flight that is over."""

        def again() -> None:
            ending.timer = None
            self._when_over(flight_id)(ending.status, "")

        if ending.timer is None and not self._closing:
            ending.timer = self._clock.call_at(self._clock.now() + INTERVAL_S, again)

    async def delete(self, flight_id: str) -> None:
        """Delete the record of a flight that is over. FlightInProgress; NotFound; StoreError."""
        flight = self.get(flight_id)
        if flight is not None and flight.is_over:
            raise FlightInProgress(
                f"flight {flight_id} is over, but its record is not complete: "
                f"{flight.recorder.waiting_words} wait for the store"
            )
        await asyncio.to_thread(self.store.flights.delete, flight_id)
        if self._journals is not None:
            await asyncio.to_thread(self._journals.delete, flight_id)

    async def mark(
        self, flight_id: str, kind: FlightMarkerKey, by: str, text: str | None
    ) -> FlightMarker:
        """Set a marker in a flight under way: everyone is told at once, then it is stored.

        NotFound; StoreError: it is not stored yet, and will be as soon as the store takes it.
        """
        flight = self.flying(flight_id)
        marker = flight.mark(kind, by, text)
        try:
            await flight.recorder.store_alarms()
        except StoreError as error:
            raise StoreError(
                f"{marker.word} is shown on every screen and is not stored yet: {error}; it is "
                "stored as soon as that is so, do not set it again"
            ) from error
        return marker.model_copy(update={"stored": True})

    # --- starting -----------------------------------------------------------------------------

    def _take_place(self) -> None:
        if self._closing:
            raise TooManyFlights(f"{STOPPING}: start the flight when it is up again")
        if len(self._flights) + self._starting >= self.max_flights:
            raise TooManyFlights(
                f"{self.max_flights} flights are under way, as many as may be: end one of them "
                f"({', '.join(self._flights)})"
            )
        self._starting += 1

    def _monitor(self, monitor_id: str) -> Monitor:
        """The monitor of a flight. NotFound; LimitsUnknown: it could not say what it warns of."""
        monitor = self.store.monitors.get(monitor_id)
        check_limits(monitor_id, monitor)
        return monitor

    def _display(
        self, authority: Monitor, shown: Sequence[tuple[str, float | None]]
    ) -> tuple[DisplayMonitor, ...]:
        """The monitors of a flight for display; for a thread. NotFound; SourceError; LimitsUnknown.

        shown: id of each and its epsilon, its own if None.
        """
        monitors = self.store.monitors
        display = tuple(
            DisplayMonitor(one, monitors.info(one).name, monitor, monitor.check_epsilon(epsilon))
            for one, epsilon in shown
            for monitor in (monitors.get(one),)
        )
        check_alike(authority, display)
        return display

    async def _plan(
        self,
        request: FlightRequest,
        name: str,
        source: dict[str, Any],
        epsilon: float,
        display: tuple[DisplayMonitor, ...],
    ) -> FlightPlan:
        monitor_id = request.monitor
        monitor = await asyncio.to_thread(self.store.monitors.get, monitor_id)
        info = await asyncio.to_thread(self.store.monitors.info, monitor_id)
        stored = {**source, NAME: name, ACCEPT_USELESS: request.accept_useless}
        used = [(shown.id, shown.epsilon) for shown in display]
        add = self.store.flights.add
        flight_id = await asyncio.to_thread(add, stored, monitor_id, epsilon, used)
        about = monitor, monitor_id, info.name, epsilon, mode_of(source), display
        return FlightPlan(flight_id, name, source, *about)

    async def _start(
        self,
        plan: FlightPlan,
        make: Callable[..., Flight],
        source: Script | LiveSetup,
        begin: Callable[[Flight], Awaitable[None]] | None = None,
    ) -> Flight:
        try:
            scene = await asyncio.to_thread(self._open_scene, plan, patience(source.dt))
            recorder = Recorder(
                self.store, plan.id, self._clock, self._recording, self._store_health
            )
            when_over = self._when_over(plan.id)
            flight = make(plan, source, recorder, self._clock, when_over, scene)
            self._flights[plan.id] = flight
            if begin is None:
                flight.start()
            else:
                await begin(flight)
        except BaseException:
            self._flights.pop(plan.id, None)
            await asyncio.to_thread(self.store.flights.end, plan.id, "failed")
            raise
        if self._closing:
            await self.stop(plan.id, "ended", STOPPING)
        return flight

    def _when_over(self, flight_id: str) -> Callable[[str, str], None]:
        def stop(status: str, reason: str) -> None:
            task = asyncio.get_running_loop().create_task(try_to_stop(status, reason))
            self._stopping.add(task)
            task.add_done_callback(self._stopping.discard)

        async def try_to_stop(status: str, reason: str) -> None:
            try:
                await self.stop(flight_id, status, reason)
            except StoreError as error:
                LOG.warning("%s", error)

        return stop

    def _open_scene(self, plan: FlightPlan, stale_after_s: float) -> "Scene | None":
        """Scene of a flight; it flies without one where there can be none."""
        if self._scenes is None:
            return None
        recipe = plan.monitor.dataset_recipe
        aircraft = aircraft_of(recipe)
        signs = surface_signs(aircraft.uncertain_plant()) if aircraft else SurfaceSigns(1, -1)
        try:
            looks = aircraft.aircraft_class if aircraft else "fighter"
            alpha0 = trim_angles(recipe)[0]
            return self._scenes.open(plan.id, signs, alpha0, stale_after_s, looks)
        except (RuntimeError, OSError):
            LOG.exception("flight %s flies without a scene", plan.id)
            return None
