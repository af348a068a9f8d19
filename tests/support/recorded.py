"""Shared by tests of recordings: a flight as a file, and its upload."""

from pathlib import Path
from typing import Any

import numpy as np
from starlette.testclient import TestClient

from tests.support.oscillator import DT

RECORDINGS = "/api/v1/recordings"
OCTETS = {"content-type": "application/octet-stream"}
HEAD = "t_s,beta_rad,p_radps,r_radps,Ny_g,delta_a_rad,delta_r_rad"


def csv_of(y: np.ndarray, dt: float = DT, head: str = HEAD, start: float = 0.0) -> bytes:
    """(n, 6), or more with another head, as a text file, bit for bit. start: [s]."""
    rows = (",".join(repr(float(v)) for v in (start + k * dt, *row)) for k, row in enumerate(y))
    return "\n".join([head, *rows, ""]).encode()


def upload(
    client: TestClient, content: Any, name: str = "flight.csv", aircraft: str | None = None
) -> Any:
    """The answer to an upload."""
    query = {"name": name} | ({} if aircraft is None else {"aircraft": aircraft})
    return client.post(RECORDINGS, content=content, params=query, headers=OCTETS)


def uploaded(client: TestClient, content: bytes, **said: Any) -> dict[str, Any]:
    """A recording that was uploaded without a complaint."""
    answer = upload(client, content, **said)
    assert answer.status_code == 201, answer.text
    return answer.json()


def kept_files(data_dir: Path) -> set[str]:
    """What lies under the recordings' root, without the folder for what comes in."""
    root = data_dir / "recordings"
    return {str(path.relative_to(root)) for path in root.rglob("*")} - {"incoming"}
