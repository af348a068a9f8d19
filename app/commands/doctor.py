"""`forewarn doctor`: check that this installation can serve; say what to do if not."""

import argparse
import asyncio
import json
import platform
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import httpx2
from sqlalchemy import URL
from websockets.asyncio.client import connect

from app.commands import serve
from app.commands.options.option import add_json
from app.commands.output.results import print_result
from app.jobs.cluster import ClusterError, words_of
from app.jobs.training import simulate
from app.main import create_app
from app.scene.server import SUBPROTOCOL
from app.serving import Server, address_of, listen
from app.settings import Settings, SettingsError
from app.store.database import address, is_sqlite
from app.store.disk import LastStop
from app.store.schema import current_revision, migrations, needs_upgrade, revisions
from app.store.store import StoreError, open_store
from app.upkeep.integrity import inventory_of
from core import __version__
from core.counted import counted
from core.monitor import MonitorRecipe, train
from core.planned_test.collection import DatasetRecipe

PACKAGES = ("numpy", "scipy", "numba", "fastapi", "uvicorn", "sqlalchemy", "viser", "websockets")
SERVED = ("/", "/js/main.js", "/docs", "/docs/assets/swagger-ui-bundle.js", "/readyz")
MOST_NAMED = 5
"""Damaged items that are named."""
PATIENCE = 20.0
"""[s] A step that takes longer has failed."""


class Failed(Exception):
    """A check failed. The message gives the cause and what to do."""


@dataclass(frozen=True)
class Finding:
    """The result of a check."""

    what: str
    is_well: bool
    words: str

    def __str__(self) -> str:
        return f"{'ok  ' if self.is_well else 'FAIL'}  {self.what:16} {self.words}"


def add(parser: argparse.ArgumentParser) -> None:
    serve.add_server(parser)
    add_json(parser)


def run(options: argparse.Namespace) -> int:
    """Returns 0 only if all checks pass."""
    findings: list[Finding] = []
    for finding in examine(serve.settings_of(options)):
        findings.append(finding)
        if not options.json:
            print(finding, flush=True)
    if options.json:
        print_result(options, "", {"findings": [asdict(finding) for finding in findings]})
    return 0 if all(finding.is_well for finding in findings) else 1


def examine(settings: Settings) -> Iterator[Finding]:
    """Run every check in turn; a failed check does not stop the others."""
    checks: tuple[tuple[str, Callable[[Settings], str]], ...] = (
        ("versions", versions),
        ("cluster", cluster),
        ("data directory", data_directory),
        ("schema", schema),
        ("contents", contents),
        ("server", round_trip),
    )
    for what, check in checks:
        try:
            yield Finding(what, True, check(settings))
        except (Failed, SettingsError, StoreError, ClusterError) as error:
            yield Finding(what, False, str(error))
        except Exception as error:
            yield Finding(what, False, f"{type(error).__name__}: {error}")


def versions(settings: Settings) -> str:
    installed = [f"forewarn {__version__}", f"Python {platform.python_version()}"]
    for package in PACKAGES:
        try:
            installed.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            raise Failed(f"{package} is not installed: install forewarn again") from None
    return ", ".join(installed)


def cluster(settings: Settings) -> str:
    """Whether the workers of the cluster, if there is one, compute the same bits."""
    return words_of(settings.scheduler) if settings.scheduler else "none: work is done here"


def data_directory(settings: Settings) -> str:
    """Whether files can be created in the data directory."""
    try:
        settings.data_dir.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=settings.data_dir, prefix=".doctor") as file:
            file.write(b"forewarn")
    except OSError as error:
        raise Failed(
            f"{settings.data_dir} is not writable ({error.strerror}): give another --data-dir"
        ) from error
    return f"{settings.data_dir} is writable"


def _is_new(url: URL) -> bool:
    return url.get_backend_name() == "sqlite" and not Path(url.database or "").exists()


def schema(settings: Settings) -> str:
    """The database's schema against the program's, and the database's integrity."""
    url = address(settings.url)
    if older := LastStop(url).finding():
        raise Failed(older)
    if _is_new(url):
        return "no database yet: the first start creates it"
    revision = current_revision(url)
    if needs_upgrade(url):
        newest = revisions(migrations())[0]
        return f"{revision or 'empty'}; the next start upgrades it to {newest}"
    with closing(open_store(settings.url, recover=False)) as store:
        if damage := store.damage():
            raise Failed(f"the database is damaged ({damage[0]}): restore a backup")
    undamaged = "undamaged" if is_sqlite(url) else "not checked: PostgreSQL has pg_amcheck"
    return f"{revision}, the newest; the database is {undamaged}"


def contents(settings: Settings) -> str:
    """Every monitor, dataset, file, column, scoring, flight and journal against its digest."""
    url = address(settings.url)
    if _is_new(url):
        return "none yet"
    if needs_upgrade(url):
        return "not checked before the schema is upgraded"
    numbers, damaged, unverified = inventory_of(settings.url, settings.data_dir)
    if damaged:
        more = f"; and {len(damaged) - MOST_NAMED} more" if damaged[MOST_NAMED:] else ""
        raise Failed("; ".join(damaged[:MOST_NAMED]) + more)
    kinds = ("monitor", "dataset", "recording", "scoring", "flight")
    counts = ", ".join(counted(numbers[kind], kind) for kind in kinds)
    if unverified:
        n = counted(len(unverified), "flight")
        return f"{counts}; no damage found, but {n} not verified: no digest recorded"
    return f"{counts}, undamaged"


def round_trip(settings: Settings) -> str:
    """Serve an empty store on a free port, fly a flight, and read its stream and its scene."""
    with tempfile.TemporaryDirectory() as directory:
        trial = replace(
            settings, data_dir=Path(directory), database_url=None, host="127.0.0.1", port=0
        )
        monitor_id = _trial_monitor(trial)
        with _running(trial) as (address, headers):
            return asyncio.run(_watch(address, headers, monitor_id))


def _trial_monitor(settings: Settings) -> str:
    """Store the smallest monitor that can fly."""
    recipe = DatasetRecipe(n_unsafe=12)
    dataset = simulate(recipe, lambda *_: None)
    with closing(open_store(settings.url)) as store:
        return store.monitors.add(train(dataset, MonitorRecipe()), "doctor").id


@contextmanager
def _running(settings: Settings) -> Iterator[tuple[str, dict[str, str]]]:
    """A server in a thread; yields its address and the headers of authorized requests."""
    listening = listen(settings)
    started = threading.Event()

    async def opened(_: object) -> None:
        started.set()

    server = Server(create_app(settings), opened)
    thread = threading.Thread(target=server.run, args=([listening],), name="trial", daemon=True)
    thread.start()
    try:
        if not started.wait(PATIENCE):
            raise Failed("the server did not start: see its log above")
        token = {"Authorization": f"Bearer {settings.token}"} if settings.token else {}
        yield address_of(listening, settings), token
    finally:
        server.should_exit = True
        thread.join(PATIENCE)
        listening.close()


async def _watch(address: str, headers: dict[str, str], monitor_id: str) -> str:
    web_socket = address.replace("http", "ws", 1)
    origin: Any = address
    opened: Any = partial(connect, origin=origin, additional_headers=headers, proxy=None)
    source = {"kind": "simulated", "outcome": "any", "seed": 1}
    async with (
        asyncio.timeout(PATIENCE),
        httpx2.AsyncClient(
            base_url=address, headers=headers, timeout=PATIENCE, trust_env=False
        ) as client,
    ):
        for path in (*SERVED, "/api/v1/catalog"):
            (await client.get(path)).raise_for_status()
        body = {"source": source, "monitor": monitor_id}
        flight = (await client.post("/api/v1/flights", json=body)).raise_for_status().json()["id"]
        async with opened(f"{web_socket}/api/v1/flights/{flight}/stream") as stream:
            awaited = ["hello", "frames"]
            while awaited:
                if json.loads(await stream.recv())["type"] == awaited[0]:
                    awaited.pop(0)
        (await client.get(f"/scene/{flight}/")).raise_for_status()
        async with opened(f"{web_socket}/scene/{flight}", subprotocols=[SUBPROTOCOL]) as scene:
            if not await scene.recv():
                raise Failed("the scene sends no message: install viser again")
    return "page, documentation, stream and scene answer over one port"
