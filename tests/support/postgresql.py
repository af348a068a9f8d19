"""A PostgreSQL of this machine, started for tests and stopped after them."""

import os
import shutil
import signal
import socket
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import create_engine, text
from sqlalchemy.exc import OperationalError

from app.store.database import address
from app.store.tables import new_id
from tests.support.patience import PATIENCE, until

UNPRIVILEGED = "nobody"


def free_port() -> int:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        return held.getsockname()[1]


class PostgreSQL:
    """A server of one cluster; `stop` and `start` restart it."""

    def __init__(self, directory: Path) -> None:
        self.directory, self.port = directory, free_port()
        self._as: dict[str, Any] = {}
        if os.geteuid() == 0:  # it refuses the superuser
            shutil.chown(directory, UNPRIVILEGED)
            self._as = {"user": UNPRIVILEGED, "extra_groups": []}
        self._process: subprocess.Popen[Any] | None = None
        call = ["initdb", "-D", str(directory / "data"), "-A", "trust", "-U", "crew", "--no-sync"]
        encoding = ["-E", "UTF8", "--locale", "C.UTF-8"]
        subprocess.run(
            [*call, *encoding], check=True, stdout=subprocess.DEVNULL, cwd=directory, **self._as
        )

    def start(self) -> None:
        where = ["-p", str(self.port), "-k", str(self.directory), "-h", "127.0.0.1"]
        self._process = subprocess.Popen(
            ["postgres", "-D", str(self.directory / "data"), *where],
            stderr=subprocess.DEVNULL,
            cwd=self.directory,
            **self._as,
        )
        until(self._answers)

    def stop(self) -> None:
        self._end(signal.SIGINT)

    def kill(self) -> None:
        """End it as a crash does: it recovers when it starts again."""
        self._end(signal.SIGQUIT)

    def _end(self, by: signal.Signals) -> None:
        assert self._process is not None
        self._process.send_signal(by)
        self._process.wait(PATIENCE)

    def url(self, database: str) -> str:
        return f"postgresql://crew@127.0.0.1:{self.port}/{database}"

    def new_database(self) -> str:
        """URL of a new, empty database."""
        name = f"d{new_id()}"
        self.run(f"CREATE DATABASE {name}")
        return self.url(name)

    def run(self, sql: str, url: str | None = None) -> list[Any]:
        """Rows of a statement, by default in the cluster's first database."""
        engine = create_engine(address(url or self.url("postgres")), isolation_level="AUTOCOMMIT")
        try:
            with engine.connect() as connection:
                done = connection.execute(text(sql))
                return list(done.all()) if done.returns_rows else []
        finally:
            engine.dispose()

    def _answers(self) -> bool:
        try:
            return bool(self.run("SELECT 1"))
        except OperationalError:
            return False


@contextmanager
def running() -> Iterator[PostgreSQL]:
    """A started server; the test is skipped where PostgreSQL is not installed."""
    for program in ("initdb", "postgres"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed: add PostgreSQL's programs to the path")
    pytest.importorskip("psycopg", reason="psycopg is not installed: forewarn[postgres]")
    directory = Path(tempfile.mkdtemp(prefix="forewarn-postgresql-"))
    try:
        server = PostgreSQL(directory)
        server.start()
        try:
            yield server
        finally:
            server.stop()
    finally:
        shutil.rmtree(directory)
