"""The web application: `create_app(settings)`; its lifespan opens everything."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from importlib.util import find_spec
from math import nan
from pathlib import Path
from typing import Any

from anyio.to_thread import current_default_thread_limiter
from fastapi import FastAPI
from fastapi.responses import HTMLResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.middleware.gzip import DEFAULT_EXCLUDED_CONTENT_TYPES, GZipMiddleware
from starlette.routing import BaseRoute

from app.access.audit import Audit
from app.access.guard import BodyLimit, Guard
from app.access.people import People
from app.access.sessions import Sessions
from app.demonstration import Demonstration
from app.flights.clock import MonotonicClock
from app.flights.flights import Flights
from app.flights.follower import Follower
from app.flights.sources.udp import UdpAccess
from app.flights.watcher import FrameTicks
from app.http.document import TAGS, describe_arrays, describe_examples, describe_names
from app.http.events import Changes
from app.http.idempotency import Idempotent, describe_keys
from app.http.metrics import Measured, Metrics
from app.http.problems import describe_problems, install_problems
from app.jobs.jobs import Jobs
from app.recordings.archives import Archives
from app.recordings.recordings import Recordings
from app.recordings.scored import ScoredRecordings
from app.routes import (
    archives,
    campaigns,
    catalog,
    condition_sets,
    datasets,
    flight_sockets,
    flights,
    jobs,
    live,
    monitors,
    people,
    recordings,
    score_telemetry,
    scorings,
    server,
    simulated_flights,
)
from app.routes.dependencies import REFUSALS
from app.routes.guide import guide_router
from app.routes.scene import scene_router
from app.scene.scene import Scenes
from app.settings import Settings
from app.store.schema import forget_copies
from app.store.store import StoreHealth, open_store
from app.telemetry.journal import Journals
from app.upkeep.integrity import Integrity
from app.upkeep.restore import finish
from app.upkeep.retention import retain_daily, retention_rule
from app.upkeep.usage import space_of
from core import __version__
from core.monitor import State
from core.monitor.status import Level

THREADS = 8
"""Threads of the routes; the database keeps as many connections."""
RESUME_TIMEOUT_S = 5.0
"""[s] The server answers after this, though a long live flight may not have resumed yet."""
HERE = Path(__file__).parent
STATIC = next(path for path in (HERE / "static", HERE.parent / "static") if path.is_dir())
"""The page: inside the installed package, or at the repository's root."""
COMPRESSION: dict[str, Any] = {
    "minimum_size": 1024,
    "compresslevel": 5,
    "thread_minimum_size": 32_768,
    "exclude_content_types": (*DEFAULT_EXCLUDED_CONTENT_TYPES, "text/csv"),
}
"""Compression of answers, of large ones in a thread so that no sample waits; not of exports."""
DESCRIPTION = """Trains, flies and replays safety monitors for flight test.

A monitor turns each telemetry sample into a risk p-value and alerts where it exceeds `epsilon`: on
failing flights it stays silent until too late with probability at most `epsilon`.

SI units and radians throughout, N_y in g; a name in another unit says so (`amplitude_deg`). Times
of day are UTC in ISO 8601. Errors are problem documents (RFC 9457). Long work is answered by 202
and the `Location` of a job."""


UPLOADS = (
    recordings.router.prefix,
    datasets.router.prefix,
    f"{datasets.router.prefix}/preview",
)
"""Where bodies may be files of any size."""


class Application(FastAPI):
    """FastAPI with the guard as outermost layer, outside the error pages too."""

    def build_middleware_stack(self) -> Any:
        state, settings = self.state, self.state.settings
        limited = BodyLimit(
            GZipMiddleware(Idempotent(super().build_middleware_stack()), **COMPRESSION),
            settings.max_body_bytes,
            {("POST", path): settings.max_upload_bytes for path in UPLOADS},
        )
        measured = Measured(limited, state.metrics)
        return Guard(measured, settings, state.people, state.sessions, state.audit)

    def openapi(self) -> dict[str, Any]:
        if self.openapi_schema is None:
            document = super().openapi()
            flight_sockets.describe_streams(document)
            describe_problems(document)
            describe_keys(document)
            describe_examples(document)
            describe_names(document)
            describe_arrays(document)
        return super().openapi()


def follower_of(settings: Settings) -> Follower:
    """Follows the flights of the server that owns the database now."""
    return Follower(settings.url, Journals(settings.data_dir / "live"))


def create_app(settings: Settings | None = None, follower: Follower | None = None) -> FastAPI:
    """The application; store, jobs and flights open with its lifespan.

    follower: has followed the flights of the server that it takes over from.
    """
    settings = settings or Settings()
    app = Application(
        title="Forewarn",
        version=__version__,
        description=DESCRIPTION,
        contact={"name": "The Forewarn project"},
        license_info={"name": "MIT", "identifier": "MIT"},
        servers=[{"url": "/", "description": "this server"}],
        openapi_tags=[{"name": name, "description": words} for name, words in TAGS.items()],
        lifespan=_lifespan,
        docs_url=None,
        redoc_url=None,
        telemetry={"tracing": False, "metrics": False},
        routes=[*_routes()],
    )
    app.state.settings, app.state.follower = settings, follower
    app.state.metrics = Metrics()
    app.state.people = People(settings.token)
    app.state.sessions = Sessions(settings.session_seconds)
    app.state.audit = Audit()
    app.state.changes = Changes()
    install_problems(app, REFUSALS)
    _serve_docs(app)
    if STATIC.is_dir():
        app.frontend("/", directory=STATIC, fallback=None)
    return app


def _routes() -> Iterator[BaseRoute]:
    """Routes of the API, built once, when their modules are imported.

    FastAPI would build the routes of an included router again at the first request, while other
    threads run. During this it hides pydantic's warnings, in all threads.
    """
    stored = (
        datasets,
        monitors,
        score_telemetry,
        condition_sets,
        recordings,
        scorings,
        archives,
    )
    flown = (flights, flight_sockets, live)
    for module in (catalog, *stored, simulated_flights, jobs, campaigns, *flown, people, server):
        yield from module.router.routes
    yield from scene_router().routes
    yield from guide_router(STATIC / "guide").routes


async def _resume(live_flights: Flights) -> None:
    """Resume the live flights of a killed server; ended flights become recordings."""
    await live_flights.resume_all()
    live_flights.summarize_ended()
    await live_flights.make_recordings()


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    """The parts while the server runs. A failed start is stored: uvicorn would only log it."""
    async with AsyncExitStack() as stack:
        try:
            await stack.enter_async_context(_parts(app))
        except Exception as error:
            app.state.failure = error
            raise
        yield


@asynccontextmanager
async def _parts(app: FastAPI) -> AsyncIterator[None]:
    """Open the parts of the application; close them in reverse order."""
    current_default_thread_limiter().total_tokens = THREADS
    settings, metrics, follower = app.state.settings, app.state.metrics, app.state.follower
    async with AsyncExitStack() as parts:
        await asyncio.to_thread(settings.data_dir.mkdir, parents=True, exist_ok=True)
        await asyncio.to_thread(finish, settings.data_dir)
        store = app.state.store = await asyncio.to_thread(open_store, settings.url)
        parts.callback(store.close)
        parts.enter_context(store.owned())
        await asyncio.to_thread(store.start)
        parts.callback(store.stop)
        await asyncio.to_thread(store.reserve.make)
        changes = app.state.changes
        for repository in (store.flights, store.alarms):
            repository.on_change = partial(changes.note, "flights")
        store.campaigns.on_change = partial(changes.note, "campaigns")
        people = app.state.people
        await parts.enter_async_context(people.open(store))
        await parts.enter_async_context(app.state.sessions.open(store, people.find_digest))
        await parts.enter_async_context(app.state.audit.open(store))
        store_health = app.state.store_health = StoreHealth(store)
        stored_recordings = app.state.recordings = Recordings(
            store, settings.data_dir / "recordings"
        )
        await parts.enter_async_context(stored_recordings)
        app.state.scored = ScoredRecordings(stored_recordings)
        app.state.archives = Archives(settings.archives)
        work = app.state.jobs = Jobs(
            store, settings.max_jobs, settings.max_queued_jobs, settings.scheduler
        )
        parts.push_async_callback(asyncio.to_thread, work.close)
        scenes = app.state.scenes = Scenes()
        parts.push_async_callback(asyncio.to_thread, scenes.stop)
        journals = app.state.journals = Journals(settings.data_dir / "live")
        parts.push_async_callback(asyncio.to_thread, journals.close)
        live_flights = app.state.flights = Flights(
            store,
            scenes,
            settings.max_flights,
            scored=app.state.scored,
            store_health=store_health,
            journals=journals,
            udp=UdpAccess(
                settings.host,
                settings.udp_senders,
                settings.udp_key or "",
                settings.token is not None,
            ),
            on_change=partial(changes.note, "flights_in_progress"),
            followed=follower and await asyncio.to_thread(follower.end),
        )
        app.state.frame_ticks = FrameTicks(MonotonicClock())
        await parts.enter_async_context(live_flights)
        resuming = asyncio.create_task(_resume(live_flights))
        parts.callback(resuming.cancel)
        await asyncio.wait([resuming], timeout=RESUME_TIMEOUT_S)
        checking_store = asyncio.create_task(
            store_health.repeat(lambda: bool(live_flights.under_way()))
        )
        parts.callback(checking_store.cancel)
        if rule := retention_rule(settings.retain_days, settings.retain_gb):
            parts.callback(
                asyncio.create_task(retain_daily(stored_recordings, journals, rule)).cancel
            )
        integrity = app.state.integrity = Integrity(store, stored_recordings.files, journals)
        integrity.start()
        parts.push_async_callback(asyncio.to_thread, integrity.stop)
        _publish(metrics, live_flights, settings.data_dir)
        metrics.gauge("damaged", "damaged stored items", lambda: integrity.n_damaged)
        metrics.gauge("uploads", "uploads in progress", lambda: stored_recordings.under_way)
        scoring = stored_recordings.workers
        metrics.gauge("scorings", "recordings being scored", lambda: scoring.n_under_way)
        metrics.gauge("jobs_running", "running jobs", lambda: work.n_running)
        metrics.gauge("jobs_waiting", "waiting jobs", lambda: work.n_waiting)
        demonstrator = app.state.demonstration = Demonstration(app)
        parts.callback(demonstrator.stop)
        await asyncio.to_thread(forget_copies, store.engine.url)
        yield


def _publish(metrics: Metrics, flights: Flights, data_dir: Path) -> None:
    """Publish the metrics of flights and of the disk."""

    def n_open(level: Level) -> int:
        return sum(flight.alarms.n_open(level) for flight in flights.under_way())

    def age() -> float:
        ages = (flight.age for flight in flights.under_way())
        return max((each for each in ages if each is not None), default=nan)

    def n_stale() -> int:
        silent = State.STALE, State.NO_DATA
        return sum(flight.state in silent for flight in flights.under_way())

    def n_watchers() -> int:
        return sum(flight.n_watchers for flight in flights.under_way())

    for name, text, read in (
        ("flights", "flights in progress", lambda: len(flights.under_way())),
        ("stale_flights", "flights in progress whose samples are late or missing", n_stale),
        ("watchers", "screens and programs that watch flights", n_watchers),
        (
            "open_warnings",
            "unacknowledged warnings of flights in progress",
            partial(n_open, Level.WARNING),
        ),
        (
            "open_cautions",
            "unacknowledged cautions of flights in progress",
            partial(n_open, Level.CAUTION),
        ),
        ("sample_age_seconds", "largest age of the newest sample of a live flight [s]", age),
        ("samples", "samples of flights since the server started", lambda: flights.n_samples),
        ("samples_unwritten", "samples not yet written", lambda: flights.unwritten),
        ("samples_lost", "samples not recorded", lambda: flights.lost),
        ("disk_bytes", "size of the disk of the data", lambda: space_of(data_dir).total),
        ("disk_free_bytes", "free space on the disk of the data", lambda: space_of(data_dir).free),
    ):
        metrics.gauge(name, text, read)


def _serve_docs(app: FastAPI) -> None:
    """Interactive documentation from an installed package, without the internet."""
    package = find_spec("fastapi_offline")
    assert package is not None
    assert package.origin is not None
    files = Path(package.origin).parent / "static"
    app.mount("/docs/assets", StaticFiles(directory=files), name="docs-assets")
    start = (
        'SwaggerUIBundle({url: "/openapi.json", dom_id: "#swagger-ui", deepLinking: true,'
        " presets: [SwaggerUIBundle.presets.apis, SwaggerUIBundle.SwaggerUIStandalonePreset]});"
    )
    page = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Forewarn API</title>
<link rel="stylesheet" href="/docs/assets/swagger-ui.css">
<link rel="icon" href="/docs/assets/favicon.png"></head><body><div id="swagger-ui"></div>
<script src="/docs/assets/swagger-ui-bundle.js"></script><script src="/docs/start.js"></script>
</body></html>"""

    @app.get("/docs", include_in_schema=False)
    async def documentation() -> Response:
        return HTMLResponse(page)

    @app.get("/docs/start.js", include_in_schema=False)
    async def start_documentation() -> Response:
        return Response(start, media_type="text/javascript")
