"""Processes that open a store, mostly to be killed; forked from one with the imports done."""

import os
import signal
import warnings
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from sqlalchemy import event

from app.store import datasets, repository, schema
from app.store.store import open_store
from tests.support import oscillator
from tests.support.forked_processes import PROCESSES
from tests.support.stored import append


class Writer:
    """Adds datasets, and samples of two flights; reports what the store has taken.

    last_statement: number of the SQL statement that it dies after.
    """

    def __init__(self, path: Path, reports: Connection, last_statement: int | None) -> None:
        self.reports, self._reporting = reports, Lock()
        self.last_statement, self.n_statements = last_statement, 0
        self.store = open_store(path)
        event.listen(self.store.engine, "after_cursor_execute", self._count)
        self.dataset = oscillator.collect(np.random.default_rng(11), 12)
        self.job = self.store.jobs.add("collect", {})
        monitor = self.store.monitors.all()[0].id
        self.flights = [self.store.flights.add({}, monitor, 0.1) for _ in range(2)]

    def _count(self, *_: Any) -> None:
        self.n_statements += 1
        if self.n_statements == self.last_statement:
            os.kill(os.getpid(), signal.SIGKILL)

    def report(self, *words: Any) -> None:
        with self._reporting:
            self.reports.send(words)

    def collect(self, n: int) -> None:
        self.store.jobs.update(self.job, "running")
        for k in range(n):
            self.report("dataset", self.store.datasets.add(self.dataset, f"d{k}").id)

    def fly(self, flight: str, n: int) -> None:
        for first in range(0, n, 50):
            append(self.store, flight, first, 50)
            self.report("stored", flight, first + 49)


def write_in_turn(path: Path, reports: Connection, last_statement: int | None) -> None:
    """Write a little, one thing after another."""
    datasets.BLOCK_BYTES, repository.TRANSACTION_BYTES = 10_000, 50_000
    writer = Writer(path, reports, last_statement)
    writer.collect(2)
    for flight in writer.flights:
        writer.fly(flight, 150)
    writer.report("statements", writer.n_statements)


def write_at_once(path: Path, reports: Connection) -> None:
    """Write without end, from three threads."""
    datasets.BLOCK_BYTES, repository.TRANSACTION_BYTES = 10_000, 50_000
    writer = Writer(path, reports, None)
    with ThreadPoolExecutor(3) as pool:
        pool.submit(writer.collect, 10**6)
        for flight in writer.flights:
            pool.submit(writer.fly, flight, 10**9)


def add_a_job(path: Path, reports: Connection) -> None:
    """Open a store and add a job; warnings are errors."""
    warnings.simplefilter("error")
    open_store(path).jobs.add("a", {})


def serve_a_job(url: str, reports: Connection) -> None:
    """Own a store in which a job runs, until killed."""
    store = open_store(url)
    with store.owned():
        job = store.jobs.add("collect", {})
        store.jobs.update(job, "running")
        reports.send((job,))
        signal.pause()


def open_by_migrations(path: Path, reports: Connection, directory: Path) -> None:
    """Open a store as a program with these migrations does."""
    schema.migrations = lambda: directory
    open_store(path)


def start(target: Any, path: Path | str, *arguments: Any) -> tuple[BaseProcess, Connection]:
    """A process under way, and the end of the pipe where its reports come out."""
    reports, sender = PROCESSES.Pipe(duplex=False)
    process = PROCESSES.Process(target=target, args=(path, sender, *arguments))
    process.start()
    sender.close()
    return process, reports


def remaining(process: BaseProcess, reports: Connection) -> list[tuple[Any, ...]]:
    """What it reports until it ends."""
    received = []
    with reports:
        try:
            while True:
                received.append(reports.recv())
        except EOFError:
            process.join()
            return received
