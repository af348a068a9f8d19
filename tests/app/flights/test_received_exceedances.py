"""Every sample is judged as it is received, whatever the resampler then does with it."""

from collections.abc import Iterator

import httpx2
import pytest

from core.channels import KEYS
from tests.support.live_server import LiveServer, alarms_of, live_server
from tests.support.patience import PATIENCE, until

DT = 0.05


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    with live_server(tmp_path_factory.mktemp("data")) as server:
        yield server


def start(server: LiveServer, trim: str) -> str:
    body = {"source": {"kind": "live", "trim": trim}, "monitor": server.monitor_id}
    answer = httpx2.post(f"{server.url}/api/v1/flights", json=body).raise_for_status()
    return f"{server.url}/api/v1/flights/{answer.json()['id']}"


def push(flight: str, times: list[float], ny: float) -> None:
    channels = dict.fromkeys(KEYS, [0.0] * len(times)) | {"Ny": [ny] * len(times)}
    httpx2.post(f"{flight}/samples", json={"t": times, **channels}).raise_for_status()


GOOD = [k * DT for k in range(40)]
ODD = {
    "one late sample": ([1.52], 1.52),
    "60 samples of one time": ([GOOD[-1]] * 60, GOOD[-1]),
    "times in milliseconds": ([1000.0 * (2.0 + k * DT) for k in range(59)], None),
    "a clock set back for two samples": ([0.31, 0.36], 0.31),
    "one sample 7 s ahead": ([GOOD[-1] + 7.0], None),
}
"""Times of samples at 1.5 g after 40 good ones, and the time of the alarm; None if unknown."""


@pytest.mark.parametrize("trim", ["none", "detected"])
@pytest.mark.parametrize("odd", ODD)
def test_a_sample_beyond_a_limit_is_an_alarm_even_if_no_other_follows(
    server: LiveServer, odd: str, trim: str
) -> None:
    times, alarm_t = ODD[odd]
    flight = start(server, trim)
    push(flight, GOOD, 0.0)
    push(flight, times, 1.5)
    (alarm,) = alarms_of(flight, "limit")
    assert alarm["exceedance"]["value"] == pytest.approx(1.5)
    if alarm_t is None:
        assert "time unknown" in alarm["reason"]
        assert GOOD[-1] <= alarm["t"] <= GOOD[-1] + PATIENCE
    else:
        assert alarm["reason"] is None
        assert alarm["t"] == pytest.approx(alarm_t)
    httpx2.post(f"{flight}/end").raise_for_status()
    ended = httpx2.get(flight).raise_for_status().json()
    assert (ended["status"], ended["exceeded_t"]) == ("alarm", alarm["t"])
    assert ended["exceedances"][0]["worst"] == pytest.approx(1.5)


def test_a_sample_that_reaches_the_grid_too_is_one_exceedance(server: LiveServer) -> None:
    flight = start(server, "none")
    push(flight, GOOD, 0.0)
    push(flight, [GOOD[-1] + k * 0.02 for k in range(1, 20)], 1.5)
    push(flight, [GOOD[-1] + 0.4 + k * 0.02 for k in range(20)], 0.0)
    assert len(alarms_of(flight, "limit")) == 1
    httpx2.post(f"{flight}/end").raise_for_status()
    (of_channel,) = httpx2.get(flight).raise_for_status().json()["exceedances"]
    assert of_channel["n"] == 1


@pytest.mark.parametrize("trim", ["none", "detected"])
def test_a_value_beyond_the_plausible_ones_is_no_calmer_than_an_exceedance(
    server: LiveServer, trim: str
) -> None:
    flight = start(server, trim)
    push(flight, GOOD, 0.0)
    beyond = [GOOD[-1] + k * DT for k in range(1, 12)]
    push(flight, beyond[:4], 45.0)
    (alarm,) = alarms_of(flight, "limit")
    assert "check the sensor" in alarm["reason"]
    assert (alarm["t"], alarm["exceedance"]["value"]) == (pytest.approx(beyond[0]), 45.0)
    path = f"{flight}/alarms/{alarm['id']}/acknowledge"
    httpx2.post(path, json={"by": "FTE"}).raise_for_status()
    for t in beyond[4:]:
        push(flight, [t], 45.0)

    def exceeding() -> bool:
        return httpx2.get(flight).raise_for_status().json()["status"] == "exceeding"

    assert until(exceeding)
    assert len(alarms_of(flight, "limit")) == 1
    httpx2.post(f"{flight}/end").raise_for_status()
    ended = httpx2.get(flight).raise_for_status().json()
    assert ended["exceeded_t"] == alarm["t"]
    assert ended["status"] not in ("ok", "no_alert")
    assert "check the sensor" in ended["verdict"]["text"]
    assert (ended["exceedances"][0]["n"], ended["exceedances"][0]["worst"]) == (1, 45.0)


def test_a_value_beyond_the_plausible_ones_within_the_limits_is_none(server: LiveServer) -> None:
    flight = start(server, "none")
    push(flight, GOOD, 0.0)
    channels = dict.fromkeys(KEYS, [0.0] * 4) | {"delta_a": [40.0] * 4}
    times = [GOOD[-1] + k * DT for k in range(1, 5)]
    httpx2.post(f"{flight}/samples", json={"t": times, **channels}).raise_for_status()
    httpx2.post(f"{flight}/end").raise_for_status()
    assert httpx2.get(flight).raise_for_status().json()["exceeded_t"] is None
