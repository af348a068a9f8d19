"""The flights of a server: start, find, stop, resume, delete."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Self

from app.assessment.rulings import LimitsInForce
from app.flights.clock import Clock, MonotonicClock, Timer
from app.flights.ended import stored_before, summarize
from app.flights.flight import Flight, FlightPlan, stale_after
from app.flights.flight_limits import change_of_limits
from app.flights.flight_recordings import FlightRecordings
from app.flights.flight_records import (
    FlightRecords,
    source_of,
)
from app.flights.follower import Followed, stored_head, unfinished
from app.flights.preparation import Preparation
from app.flights.recorder import INTERVAL_S, Recorder
from app.flights.request import FlightRequest
from app.flights.sources.live import LiveFlight, LiveSetup
from app.flights.sources.playback import Script
from app.flights.sources.simulated import trim_angles
from app.flights.sources.udp import UdpAccess
from app.flights.transport import NotPossible
from app.flights.verdict import Before, first_exceedance
from app.recipes.recipes import simulated_test
from app.recordings.scored import ScoredRecordings
from app.store.flights import INTERRUPTED, FlightInfo, FlightInProgress
from app.store.people import LOCAL
from app.store.store import NotFound, Store, StoreError, StoreHealth
from app.telemetry.journal import JournalReader, Journals
from core.conditions import ConditionKey
from core.flight_events import FlightMarker, FlightMarkerKey
from core.planned_test.planned_test import DatasetRecipe
from core.simulation.attitude import SurfaceSigns, surface_signs

if TYPE_CHECKING:
    from app.scene.scene import Scene, Scenes

LOG = logging.getLogger("forewarn")
STOPPING = "the server is stopping"
HERE_ALONE = UdpAccess()
SUMMARIZED_AT_ONCE = 50
"""Flights in one transaction."""
MARKED_S = 0.5
"""A marker is answered by then, stored or not [s]."""
RECORDING_THREADS = 2
"""So that an alarm can be stored while the other thread waits for the disk."""


class TooManyFlights(RuntimeError):
    """The server has its most flights in progress."""


@dataclass
class _Ending:
    """A flight that is ending: its final status and why, and the progress of ending it."""

    status: str
    reason: str
    has_stopped: bool = False
    lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    timer: Timer | None = None


class Flights:
    """The flights of a server; leaving the context stops and records every flight.

    on_change: called when a list of the flights in progress changes.
    followed: flights of the server before, by id.
    """

    def __init__(
        self,
        store: Store,
        scenes: "Scenes | None" = None,
        max_flights: int = 64,
        clock: Clock | None = None,
        scored: ScoredRecordings | None = None,
        store_health: StoreHealth | None = None,
        journals: Journals | None = None,
        udp: UdpAccess = HERE_ALONE,
        on_change: Callable[[], object] = lambda: None,
        followed: Mapping[str, Followed] | None = None,
    ) -> None:
        self._store_health, self._journals = store_health, journals
        self._on_change = on_change
        self.store, self.max_flights = store, max_flights
        self.preparation = Preparation(store, scored, journals, udp)
        self._scenes, self._clock = scenes, clock or MonotonicClock()
        self._flights: dict[str, Flight] = {}
        self._followed = dict(followed or {})
        self._starting = 0
        self._closing = False
        self._resuming = asyncio.Lock()
        self._stopping: set[asyncio.Task[None]] = set()
        self._endings: dict[str, _Ending] = {}
        self._recording = ThreadPoolExecutor(RECORDING_THREADS, "recorder")
        self.records = FlightRecords(store, self._flights, self._recording, journals)
        self._recordings = (
            None
            if scored is None or journals is None
            else FlightRecordings(scored.recordings, journals)
        )
        self._lost_before = self._samples_before = 0

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *error: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Stop every flight and start no more. Samples that the store refuses are lost."""
        self._closing = True
        await asyncio.gather(*(self._close(flight) for flight in [*self._flights]))
        await asyncio.gather(*self._stopping)
        await asyncio.to_thread(self._recording.shutdown)

    async def _close(self, flight_id: str) -> None:
        try:
            is_live = isinstance(self.get(flight_id), LiveFlight)
            await self.stop(flight_id, INTERRUPTED if is_live else "ended", STOPPING)
        except Exception:
            LOG.exception("flight %s ended with an incomplete record", flight_id)
            if flight := self._flights.pop(flight_id, None):
                flight.recorder.give_up()

    @property
    def unwritten(self) -> int:
        return sum(flight.recorder.unwritten for flight in self._flights.values())

    @property
    def lost(self) -> int:
        under_way = sum(flight.recorder.lost for flight in self._flights.values())
        return self._lost_before + under_way

    @property
    def n_samples(self) -> int:
        """Samples of flights since the server started."""
        return self._samples_before + sum(f.recorder.n_added for f in self.under_way())

    @property
    def problem(self) -> str:
        """Why a flight is not being recorded; empty if all are."""
        problems = (flight.recorder.problem for flight in self._flights.values())
        return next(filter(None, problems), "")

    def under_way(self) -> list[Flight]:
        return list(self._flights.values())

    def get(self, flight_id: str) -> Flight | None:
        return self._flights.get(flight_id)

    def flying(self, flight_id: str) -> Flight:
        """A flight in progress. NotFound."""
        flight = self.get(flight_id)
        if flight is None or flight.is_over:
            raise NotFound(f"no flight {flight_id!r} is in progress: it ended or does not exist")
        return flight

    async def start(self, request: FlightRequest, by: str = LOCAL) -> Flight:
        """Start a flight. by: who starts it.

        TooManyFlights; SourceError and RecipeError for the source; ValueError for an epsilon too
        small for the monitor; LimitsUnknown; UselessMonitor; NotFound.
        """
        self._reserve_place()
        try:
            plan, flown = await asyncio.to_thread(self.preparation.new, request, by)
            return await self._start(plan, request.source.flight, flown)
        finally:
            self._starting -= 1

    async def put_in_force(
        self,
        flight_id: str,
        limit_set: str,
        version: int | None,
        fixed: Mapping[ConditionKey, float],
        by: str,
    ) -> LimitsInForce:
        """Put a limit set in force from the next sample of a flight on.

        NotFound; NotPossible; JournalFull; StoreError: it is in force, and is stored as soon as the
        store accepts it.
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
                f"{in_force.words} is in force on every screen but not stored yet ({error}): it "
                "is stored as soon as possible, do not put it in force again"
            ) from error
        return in_force

    async def live(self, flight_id: str) -> LiveFlight:
        """A live flight that accepts samples; one of a killed server is resumed.

        NotFound; NotPossible if it has ended or is not live.
        """
        flight = self.get(flight_id)
        if flight is None or (isinstance(flight, LiveFlight) and flight.is_restoring):
            async with self._resuming:
                flight = self.get(flight_id) or await self._resume(flight_id)
        if not isinstance(flight, LiveFlight):
            raise NotPossible(f"flight {flight_id} is not live: it accepts no samples")
        if flight.is_over:
            raise NotPossible("the flight has ended: start another one")
        return flight

    async def resume_all(self) -> None:
        """Resume the live flights that were in progress when the server was killed."""
        if self._journals is None:
            return
        for info in await asyncio.to_thread(unfinished, self.store, self._journals):
            try:
                await self.live(info.id)
            except Exception:
                LOG.exception("flight %s could not be resumed", info.id)

    async def make_recordings(self) -> None:
        """Make recordings of the ended live flights that have none, in the background."""
        if self._recordings is None:
            return
        try:
            waiting = await asyncio.to_thread(self._recordings.waiting)
        except (StoreError, OSError) as error:
            LOG.warning("live flights are made recordings at the next start: %s", error)
            return
        for flight_id in waiting:
            self._make_recording(flight_id)

    def summarize_ended(self) -> None:
        """Store in the background what lists show of flights that a server before has ended."""
        self._in_background(self._summarize_ended())

    async def _summarize_ended(self) -> None:
        ended = await asyncio.to_thread(self.store.flights.without_summary)
        for first in range(0, len(ended), SUMMARIZED_AT_ONCE):
            if self._closing:
                return
            await self._summarize(ended[first : first + SUMMARIZED_AT_ONCE])

    async def _summarize(self, flight_ids: list[str]) -> None:
        try:
            await asyncio.to_thread(summarize, self.store, flight_ids)
        except StoreError as error:
            LOG.warning("%d flights are summarized at the next start: %s", len(flight_ids), error)

    def _make_recording(self, flight_id: str) -> None:
        if self._recordings is None or self._closing:
            return
        self._in_background(self._recordings.make(flight_id))

    def _in_background(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._stopping.add(task)
        task.add_done_callback(self._stopping.discard)

    async def end(self, flight_id: str, by: str) -> None:
        """End a flight; one of a killed server is resumed first, to complete its record.

        by: who ends it, for watchers and journal.   Raises as `stop` and `live` do.
        """
        if self.get(flight_id) is None:
            info = await asyncio.to_thread(self.store.flights.info, flight_id)
            is_live = source_of(info).get("kind") == "live" and self._journals is not None
            if is_live and info.status == INTERRUPTED and info.recording_id is None:
                with suppress(NotPossible):  # nothing left to resume
                    await self.live(flight_id)
        await self.stop(flight_id, reason=f"the flight was ended by {by}")

    async def _resume(self, flight_id: str) -> Flight:
        info = await asyncio.to_thread(self.store.flights.info, flight_id)
        journals = self._journals
        if source_of(info).get("kind") != "live" or info.status != INTERRUPTED or journals is None:
            raise NotPossible(f"flight {flight_id} accepts no samples: it has ended or is not live")
        making = self._recordings.under_way if self._recordings else None
        if info.recording_id is not None or making == flight_id:
            raise NotPossible(
                f"flight {flight_id} accepts no samples: it was interrupted and is a recording now"
            )
        self._reserve_place()
        try:
            flown = await asyncio.to_thread(self._followed_or_new, info, journals)
            plan, setup, make, reader = flown
            alarms = await self.records.alarms(flight_id)
            markers = await self.records.markers(flight_id)
            stored = stored_head(info)

            async def resume(flight: Flight) -> None:
                assert isinstance(flight, LiveFlight)
                flight.is_restoring = True
                about = reader.lines(), stored, alarms, markers
                unrecorded = await asyncio.to_thread(flight.restore, *about)
                flight.digest = reader.digest
                before = Before()
                if (first := first_exceedance(alarms)) is not None:
                    about = flight_id, first, flight.lead, plan.monitor.dt
                    before = await asyncio.to_thread(stored_before, self.store, *about)
                flight.judge(before)
                await asyncio.to_thread(self.store.flights.resume, flight_id, flight.head)
                flight.resume(unrecorded)

            return await self._start(plan, make, setup, resume)
        finally:
            self._starting -= 1

    def _followed_or_new(
        self, info: FlightInfo, journals: Journals
    ) -> tuple[FlightPlan, LiveSetup, Callable[..., Flight], JournalReader]:
        """What resumes a flight: as it was followed, or to be replayed from its start."""
        self.preparation.check_journal(info, journals)
        followed = self._followed.pop(info.id, None)
        if followed is None or not followed.is_continued_by(info):
            about = self.preparation.resumed(info, journals)
            return *about, LiveFlight, JournalReader(journals.path(info.id))
        flight, setup, reader = followed
        setup = setup._replace(journals=journals, access=self.preparation.udp)
        return flight.plan, setup, flight.join, reader

    async def stop(
        self, flight_id: str, status: str = "ended", reason: str = "the flight was ended"
    ) -> None:
        """Stop a flight and complete its record; no effect on one that has ended.

        StoreError if the store refuses the record: the flight has ended, and the record is
        completed as soon as possible.
        """
        flight = self.get(flight_id)
        if flight is None:
            return
        ending = self._endings.setdefault(flight_id, _Ending(status, reason))
        async with ending.lock:
            if flight_id not in self._endings:
                return
            if not ending.has_stopped:
                await flight.stop(reason)
                if self._scenes is not None:
                    await asyncio.to_thread(self._scenes.close, flight_id)
                ending.has_stopped = True
            try:
                result = flight.exceeded_t, flight.exceedances.of_channels
                held = list(flight.in_force.of_record)
                how = held, flight.journal_digest, ending.reason
                await flight.recorder.complete(ending.status, *result, *how)
            except StoreError:
                self._stop_later(flight_id, ending)
                raise
            await self._summarize([flight_id])
            self._lost_before += flight.recorder.lost
            self._samples_before += flight.recorder.n_added
            del self._flights[flight_id], self._endings[flight_id]
            self._on_change()
            if isinstance(flight, LiveFlight) and ending.status != INTERRUPTED:
                self._make_recording(flight_id)

    def _stop_later(self, flight_id: str, ending: "_Ending") -> None:

        def retry() -> None:
            ending.timer = None
            self._when_over(flight_id)(ending.status, "")

        if ending.timer is None and not self._closing:
            ending.timer = self._clock.call_at(self._clock.now() + INTERVAL_S, retry)

    async def delete(self, flight_id: str) -> None:
        """Delete the record of an ended flight. FlightInProgress; NotFound; StoreError."""
        flight = self.get(flight_id)
        if flight is not None and flight.is_over:
            raise FlightInProgress(
                f"flight {flight_id} has ended but its record is incomplete: "
                f"{flight.recorder.waiting_words} wait for the store"
            )
        await asyncio.to_thread(self.store.flights.delete, flight_id)
        if self._journals is not None:
            await asyncio.to_thread(self._journals.delete, flight_id)

    async def mark(
        self,
        flight_id: str,
        kind: FlightMarkerKey,
        by: str,
        text: str | None,
        t: float | None = None,
    ) -> FlightMarker:
        """Set a marker in a flight in progress: sent to all watchers at once, then stored.

        A marker that is not stored within MARKED_S, as in a locked database, is stored later.
        t: [s] that it is about.
        NotFound; NotPossible; StoreError: it is not stored yet, and is as soon as the store
        accepts it.
        """
        flight = self.flying(flight_id)
        marker = flight.mark(kind, by, text, t)
        storing = asyncio.ensure_future(flight.recorder.store_alarms())
        done, _ = await asyncio.wait((storing,), timeout=MARKED_S)
        if not done:
            storing.add_done_callback(lambda task: task.cancelled() or task.exception())
            return marker
        try:
            storing.result()
        except StoreError as error:
            raise StoreError(
                f"{marker.word} is on every screen but not stored yet ({error}): it is stored as "
                "soon as possible, do not set it again"
            ) from error
        return replace(marker, stored=True)

    # --- starting -----------------------------------------------------------------------------

    def _reserve_place(self) -> None:
        if self._closing:
            raise TooManyFlights(f"{STOPPING}: start the flight after its restart")
        if len(self._flights) + self._starting >= self.max_flights:
            raise TooManyFlights(
                f"{self.max_flights} flights are in progress, the most allowed: end one of them "
                f"({', '.join(self._flights)})"
            )
        self._starting += 1

    async def _start(
        self,
        plan: FlightPlan,
        make: Callable[..., Flight],
        source: Script | LiveSetup,
        begin: Callable[[Flight], Awaitable[None]] | None = None,
    ) -> Flight:
        try:
            scene = await asyncio.to_thread(self._open_scene, plan, stale_after(source.dt))
            recorder = Recorder(
                self.store, plan.id, self._clock, self._recording, self._store_health
            )
            when_over = self._when_over(plan.id)
            flight = make(plan, source, recorder, self._clock, when_over, scene)
            self._flights[plan.id] = flight
            flight.on_change = self._on_change
            if begin is None:
                flight.start()
            else:
                await begin(flight)
            self._on_change()
        except BaseException:
            self._flights.pop(plan.id, None)
            await asyncio.to_thread(self.store.flights.end, plan.id, "failed")
            raise
        if self._closing:
            await self.stop(plan.id, "ended", STOPPING)
        return flight

    def _when_over(self, flight_id: str) -> Callable[[str, str], None]:
        def stop(status: str, reason: str) -> None:
            self._in_background(try_to_stop(status, reason))

        async def try_to_stop(status: str, reason: str) -> None:
            try:
                await self.stop(flight_id, status, reason)
            except StoreError as error:
                LOG.warning("%s", error)

        return stop

    def _open_scene(self, plan: FlightPlan, stale_after_s: float) -> "Scene | None":
        """The scene of a flight; None if it cannot be opened, and the flight continues without."""
        if self._scenes is None:
            return None
        recipe = plan.monitor.dataset_recipe
        test = simulated_test(recipe)
        signs = SurfaceSigns(1, -1) if test is None else SurfaceSigns(-1, -1)
        if isinstance(test, DatasetRecipe):
            signs = surface_signs(test.aircraft.uncertain_plant())
        try:
            looks = test.aircraft.condition.aircraft_class if test else "fighter"
            alpha0 = trim_angles(recipe)[0]
            own = self.store.airframes.file(plan.monitor_id)
            return self._scenes.open(plan.id, signs, alpha0, stale_after_s, looks, own)
        except (RuntimeError, OSError, ValueError):
            LOG.exception("flight %s flies without a scene", plan.id)
            return None
