"""A server on a socket with a monitor, and what its live flights have on disk."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import httpx2
import numpy as np

from app.assessment.batches import ChannelReader
from app.assessment.scorer import LiveAssessed, rescored
from app.flights.sources.live import LiveSetup
from app.settings import Settings
from app.store.store import open_store
from app.telemetry.journal import Journals, lines_of
from core.monitor.assessment import STATES
from tests.app.flights.test_flights import monitor
from tests.support.api import served
from tests.support.patience import until


class LiveServer(NamedTuple):
    """Its address, the id of its monitor, and the folder of its data."""

    url: str
    monitor_id: str
    root: Path


@contextmanager
def live_server(root: Path) -> Iterator[LiveServer]:
    store = open_store(Settings(data_dir=root).url)
    monitor_id = store.monitors.add(monitor(), "F-16 doublet").id
    store.close()
    with served(root) as (url, _):
        yield LiveServer(url, monitor_id, root)


def alarms_of(flight: str, *kinds: str) -> list[dict[str, Any]]:
    """The alarms of some kinds of the flight at this address, as soon as there is one."""

    def find() -> list[dict[str, Any]]:
        alarms = httpx2.get(f"{flight}/alarms").raise_for_status().json()
        return [alarm for alarm in alarms if alarm["kind"] in kinds]

    return until(find)


def journal_samples(root: Path, flight: str, name: str = "t") -> list[float]:
    """The values of one channel in a journal, in the order of arrival; each batch is there once."""
    lines = [line for line in lines_of(root / "live" / f"{flight}.jsonl") if "b" in line]
    numbers = [line["s"] for line in lines if line["s"] is not None]
    assert len({*numbers}) == len(numbers)
    return [value for line in lines for value in line["b"][name]]


def assessed_again(setup: LiveSetup, flight_id: str) -> list[LiveAssessed]:
    """What the journal of a flight shows by its setup, by what had come at each moment."""
    lines = lines_of(setup.journals.path(flight_id))
    return [*rescored(lines, setup.scorer(), setup.reader)]


def assert_shown_again(root: Path, flight: str) -> int:
    """That the journal of an ended flight gives the bits that were stored; their number."""
    store = open_store(Settings(data_dir=root).url)
    try:
        info = store.flights.info(flight)
        stored = store.flights.assessments(flight)
    finally:
        store.close()
    trim, journals = info.source["trim"], Journals(root / "live")
    setup = LiveSetup(monitor(), info.epsilon, ChannelReader(), journals, 0.0, None, trim)
    again = assessed_again(setup, flight)
    assessments = [one.assessment for one in again]
    assert stored.seq.tolist() == [*range(len(again))]
    assert stored.t.tolist() == [one.t for one in assessments]
    assert [STATES[code] for code in stored.state] == [one.state for one in assessments]
    assert [*stored.reasons] == [one.reason for one in assessments]
    np.testing.assert_array_equal(stored.y, [one.y for one in again])
    p_values = np.array([one.p_value for one in assessments], np.float64)
    np.testing.assert_array_equal(stored.p_value, p_values)
    return len(again)
