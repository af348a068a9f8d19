"""An exceedance has one time in every view: that of the sample that the sensor gave."""

from collections.abc import Iterator
from typing import Any

import httpx2
import numpy as np
import pytest

from core.channels import KEYS
from tests.support.live_server import LiveServer, alarms_of, live_server
from tests.support.patience import until

DT, LIMIT = 0.05, 0.5


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    with live_server(tmp_path_factory.mktemp("data")) as server:
        yield server


def post(server: LiveServer, path: str, body: Any = None) -> dict[str, Any]:
    answer = httpx2.post(f"{server.url}/api/v1{path}", json=body, timeout=60)
    return answer.raise_for_status().json()


def get(server: LiveServer, path: str) -> Any:
    return httpx2.get(f"{server.url}/api/v1{path}").raise_for_status().json()


def replayed(server: LiveServer, source: dict[str, Any]) -> dict[str, Any]:
    """The alarm of a replay; it has the times of its record too."""
    flight = post(server, "/flights", {"source": source, "monitor": server.monitor_id})["id"]
    post(server, f"/flights/{flight}/transport", {"action": "speed", "value": 10})
    (alarm,) = alarms_of(f"{server.url}/api/v1/flights/{flight}", "limit")
    post(server, f"/flights/{flight}/end")
    ended = get(server, f"/flights/{flight}")
    assert ended["exceeded_t"] == ended["exceedances"][0]["first_t"] == alarm["t"]
    return alarm


@pytest.mark.parametrize("together", [1, 25])
@pytest.mark.parametrize("step", [0.02, DT, 0.07])
def test_an_exceedance_has_one_time_and_value(
    server: LiveServer, step: float, together: int
) -> None:
    """A quick rise through the limit, at several rates of the source and sizes of a batch."""
    t = (np.arange(round(4.0 / step)) * step).round(6)
    ny = np.clip(3.0 * (t - 2.013), 0.0, 0.9)
    first = int(np.argmax(ny >= LIMIT))
    source = {"kind": "live", "trim": "none"}
    flight = post(server, "/flights", {"source": source, "monitor": server.monitor_id})["id"]
    for k in range(0, len(t), together):
        part = slice(k, k + together)
        zeros = dict.fromkeys(KEYS, [0.0] * len(t[part]))
        sent = {"t": t[part].tolist(), **zeros, "Ny": ny[part].tolist()}
        post(server, f"/flights/{flight}/samples", sent)
    (alarm,) = alarms_of(f"{server.url}/api/v1/flights/{flight}", "limit")
    expected = pytest.approx(t[first]), pytest.approx(ny[first])
    assert (alarm["t"], alarm["exceedance"]["value"]) == expected
    flying = get(server, f"/flights/{flight}")
    post(server, f"/flights/{flight}/end")
    ended = get(server, f"/flights/{flight}")
    for told in (flying, ended):
        (of_channel,) = told["exceedances"]
        assert (told["exceeded_t"], of_channel["first_t"], of_channel["n"]) == (
            *[pytest.approx(t[first])] * 2,
            1,
        )
        assert of_channel["worst"] == pytest.approx(0.9)
    assert get(server, f"/flights/{flight}/comparison")["exceeded_t"] == alarm["t"]

    def recording_of() -> str:
        return get(server, f"/flights/{flight}")["recording"]

    recording = until(recording_of)
    path = f"/recordings/{recording}/scorings"
    scoring = post(server, path, {"monitor": server.monitor_id})
    (manoeuvre,) = scoring["manoeuvres"]
    exceedance = manoeuvre["exceedance"]
    assert (exceedance["t"], exceedance["value"]) == expected
    sources = (
        {"kind": "journal", "flight_id": flight},
        {"kind": "recording", "recording": recording, "scoring": scoring["id"]},
    )
    for source in sources:
        again = replayed(server, source)
        assert (again["t"], again["exceedance"]["value"]) == expected, source
