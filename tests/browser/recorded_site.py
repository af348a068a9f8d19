"""A server with a monitor, and a recorded file for it: what browser tests of recordings share."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import httpx2
import numpy as np

from app.store.store import Store
from core.monitor import Monitor
from core.simulation.aircraft import PublishedAircraft
from tests.browser.site import Site, open_site
from tests.support import attas

DT = attas.TEST.dt
DEGREES = 180 / np.pi
KNOT = 0.514444
HEAD = "Time_s,AOSS_deg,RollRate_deg_s,YawRate_deg_s,Ny,Aileron_deg,Rudder_deg,TAS_kt,Bank_deg"
BAD_LINE, BAD_ROW = 52, "2.5,garbage,1,2,3,4,5,6,7"
LOST = slice(180, 196)
OUTCOMES = ["quiet", "timely_alert", "invalid"]
"""Of the three manoeuvres in the file: within the limit, beyond it, and with reversed surfaces."""


@cache
def recorded_file() -> bytes:
    """Three rudder doublets in degrees and knots, with a bad row and a gap."""
    flown = attas.fly(30, 5)
    safe, unsafe = flown.y[~flown.is_unsafe], flown.y[flown.is_unsafe]
    y = np.concatenate([safe[0], unsafe[0], -safe[1]])
    aircraft = attas.TEST.aircraft
    assert isinstance(aircraft, PublishedAircraft)
    scale = np.array([DEGREES, DEGREES, DEGREES, 1.0, DEGREES, DEGREES])
    speed = aircraft.model.speed / KNOT
    bank = np.cumsum(y[:, 1]) * DT * DEGREES
    rows = [
        ",".join(f"{value:.7g}" for value in (k * DT, *row, speed, bank[k]))
        for k, row in enumerate(y * scale)
    ]
    rows[BAD_LINE - 2] = BAD_ROW
    del rows[LOST]
    return "\n".join([HEAD, *rows, ""]).encode()


@dataclass(frozen=True)
class RecordedSite:
    """A server with one monitor, and a file that it can score."""

    site: Site
    monitor: str
    file: bytes

    @property
    def http(self) -> str:
        return self.site.http

    @property
    def store(self) -> Store:
        return self.site.store

    def ask(self, method: str, path: str, **given: Any) -> Any:
        answer = httpx2.request(method, f"{self.http}/api/v1{path}", timeout=60, **given)
        assert answer.is_success, answer.text
        return answer.json() if answer.content else None

    def upload(self, name: str = "flight.csv", content: bytes = b"", **query: str) -> str:
        """Id of a new recording, of the site's file unless another is given."""
        octets = {"content-type": "application/octet-stream"}
        params = {"name": name} | query
        content = content or self.file
        made = self.ask("POST", "/recordings", params=params, content=content, headers=octets)
        return made["id"]

    def confirm(self, recording: str) -> None:
        """Take the proposed mapping."""
        mapping = self.ask("GET", f"/recordings/{recording}")["mapping"]
        self.ask("PUT", f"/recordings/{recording}/mapping", json={"mapping": mapping})

    def score(self, recording: str, **order: Any) -> dict[str, Any]:
        """A scoring by the monitor."""
        body = {"monitor": self.monitor} | order
        return self.ask("POST", f"/recordings/{recording}/scorings", json=body)


@contextmanager
def open_recorded_site(data_dir: Path, monitor: Monitor) -> Iterator[RecordedSite]:
    """The server with this monitor and compiled kernels, until the block ends."""
    attas.score(monitor, attas.recorded(attas.fly(1, 5).y[0]))
    with open_site(data_dir) as site:
        stored = site.store.monitors.add(monitor, "transport doublet")
        yield RecordedSite(site, stored.id, recorded_file())
