"""A flight, a scoring of its recording and of a file of its samples give one verdict."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from core.channels import BY_KEY, KEYS
from tests.app.flights.test_flight_recordings import DT, FLIGHTS, RECORDINGS, Range
from tests.support.api import api
from tests.support.oscillator import Array
from tests.support.recorded import csv_of, uploaded

WARNED = re.compile(r", warned .*")
"""In flight a warning counts from when it was raised; this one was not flown in its own time."""
N, FIRST, NY = 120, 40, KEYS.index("Ny")


def calm() -> Array:
    """(N, 6) two seconds of rest and a rudder doublet that exceeds no limit."""
    y = np.zeros((N, len(KEYS)))
    t = DT * np.arange(N - FIRST)
    y[FIRST:, KEYS.index("delta_r")] = 0.166 * np.select([t < 0.5, t < 1.0], [1.0, -1.0], 0.0)
    motion = np.sin(3.0 * t) * np.exp(-0.5 * t)
    y[FIRST:, :4] = motion[:, None] * np.array([0.02, 0.05, 0.05, 0.32])
    return y


def with_ny(*values: tuple[int, float]) -> Array:
    y = calm()
    for k, ny in values:
        y[k, NY] = ny
    return y


WAYS = {
    "calm": calm(),
    "exceeds_from_trim": with_ny((60, 0.7)),
    "largest_number": with_ny((60, 1e300)),
    "one_sample_of_500_g": with_ny((60, 500.0)),
    "failed_sensor": with_ny(*((k, -500.0) for k in range(60, 72))),
    "failed_before_it_exceeds": with_ny((48, 500.0), (90, 0.7)),
    "exceeds_before_it_fails": with_ny((48, 0.7), (90, 500.0)),
    "exceeds_as_recorded": calm() + 0.3 * (np.arange(6) == NY),
    "from_trim_after_as_recorded": with_ny((58, 0.32), (59, 0.45), (60, 0.55), (61, 0.52))
    + 0.225 * (np.arange(6) == NY),
    "fails_at_rest": with_ny((20, 500.0)),
}


@pytest.fixture(scope="module")
def range_(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Range]:
    root = tmp_path_factory.mktemp("data")
    with api(root) as client:
        yield Range(client, root)


@pytest.mark.parametrize("trim", ["none", "detected"])
@pytest.mark.parametrize("way", WAYS)
def test_a_flight_its_recording_and_a_file_have_one_verdict(
    range_: Range, way: str, trim: str
) -> None:
    y, client = WAYS[way], range_.client
    flight = range_.start(way, trim=trim)
    range_.push_all(flight, y[:FIRST], at_once=10)
    range_.push_all(flight, y, FIRST)
    ended = range_.end(flight)
    frames = client.get(f"{FLIGHTS}/{flight}/assessments", params={"limit": N}).json()["frames"]
    file = uploaded(client, csv_of(y, DT), name=f"{way}.csv")
    signals = {key: each["signal"] for key, each in file["mapping"]["channels"].items()}
    channels = {key: {"signal": signals[key], "unit": BY_KEY[key].unit} for key in KEYS}
    mapping = {"channels": channels, "times": file["mapping"]["times"]}
    client.put(f"{RECORDINGS}/{file['id']}/mapping", json=mapping).raise_for_status()
    recordings = [range_.recording_of(flight), file]
    for recording in recordings:
        request: dict[str, Any] = {"monitor": range_.monitor, "epsilon": ended["epsilon"]}
        if trim == "none":
            request |= {"trim": None, "manoeuvres": "entire"}
        path = f"{RECORDINGS}/{recording['id']}/scorings"
        answer = client.post(path, json=request)
        assert answer.status_code == 201, answer.text
        scoring = answer.json()
        assert_one_verdict(ended, scoring)
        path = f"{path}/{scoring['id']}/assessments"
        scored = client.get(path, params={"limit": N}).json()["frames"]
        shown = {round(each["t"] / DT): each["p_value"] for each in frames}
        again = {round(each["t"] / DT): each["p_value"] for each in scored}
        assert shown == again


def test_one_from_trim_follows_one_as_recorded_without_a_break(range_: Range) -> None:
    """Both are told, with their own times; the verdict and its warning are of that from trim."""
    flight = range_.start("follows", trim="detected")
    range_.push_all(flight, WAYS["from_trim_after_as_recorded"])
    ended = range_.end(flight)
    recording = range_.recording_of(flight)["id"]
    request = {"monitor": range_.monitor, "epsilon": ended["epsilon"]}
    scoring = range_.client.post(f"{RECORDINGS}/{recording}/scorings", json=request).json()
    (manoeuvre,) = scoring["manoeuvres"]
    assert ended["verdict"]["exceeded_t"] == manoeuvre["exceedance"]["t"] == pytest.approx(3.0)
    assert "as recorded" not in ended["verdict"]["text"]
    (listed,) = [each for each in range_.client.get(FLIGHTS).json() if each["id"] == flight]
    assert listed["verdict"] == ended["verdict"]
    raw = manoeuvre["recorded_exceedance"]
    assert (raw["t"], raw["value"]) == (pytest.approx(2.9), pytest.approx(0.545))
    (of_ny,) = ended["exceedances"]
    assert (of_ny["worst"], of_ny["worst_t"]) == (pytest.approx(0.55), pytest.approx(3.0))
    assert (of_ny["recorded"], of_ny["recorded_t"]) == (pytest.approx(0.775), pytest.approx(3.0))
    remark = "from trim at 3.00 s (Ny 0.55 g); as recorded at 3.00 s (Ny 0.775 g)"
    assert remark in " ".join(manoeuvre["remarks"])
    report = range_.client.get(f"{RECORDINGS}/{recording}/scorings/{scoring['id']}/report").text
    assert "as recorded, a limit was exceeded before it was from trim" in report


@pytest.mark.parametrize("ny", [0.7, 0.48])
def test_a_peak_at_unknown_limits_is_never_calm(range_: Range, ny: float) -> None:
    """The limits are 0.5 or 0.45 g by Mach, which is unknown at the peak alone."""
    client, flight = range_.client, range_.start(f"peak of {ny} g", trim="detected")
    cases = [
        {"name": "low", "ranges": {"mach": [None, 0.8]}, "limits": {"Ny": 0.5}},
        {"name": "high", "ranges": {"mach": [0.8, None]}, "limits": {"Ny": 0.45}},
    ]
    limits = client.post("/api/v1/limit-sets", json={"name": f"{ny} g", "cases": cases}).json()
    asked = {"limit_set": limits["limit_set"], "by": "Ann"}
    client.put(f"{FLIGHTS}/{flight}/limits", json=asked).raise_for_status()
    for k, row in enumerate(with_ny((60, ny)).tolist()):
        y = {key: [value] for key, value in zip(KEYS, row, strict=True)}
        range_.push(flight, k, **y, mach=[None if 58 <= k <= 62 else 0.6])
    range_.end(flight)
    alarms = client.get(f"{FLIGHTS}/{flight}/alarms").json()
    for alarm in alarms:
        path = f"{FLIGHTS}/{flight}/alarms/{alarm['id']}/acknowledge"
        client.post(path, json={"by": "Ann"}).raise_for_status()
    ended = client.get(f"{FLIGHTS}/{flight}").json()
    recording = range_.recording_of(flight)["id"]
    request = {"monitor": range_.monitor, "epsilon": ended["epsilon"]}
    scoring = client.post(f"{RECORDINGS}/{recording}/scorings", json=request).json()
    (manoeuvre,) = scoring["manoeuvres"]
    assert ended["level"] == "caution"
    if ny < 0.5:
        why = "INVALID: limits unknown from 2.90 to 3.10 s"
        assert ended["verdict"]["text"].startswith(why)
        assert (ended["status"], manoeuvre["outcome"]) == ("caution", "invalid")
        return
    (of_limit,) = [alarm for alarm in alarms if alarm["kind"] == "limit"]
    assert of_limit["reason"].startswith("beyond the limit of every case of the set")
    assert of_limit["t"] == manoeuvre["exceedance"]["t"] == ended["exceeded_t"]
    assert of_limit["exceedance"]["limit"] == manoeuvre["exceedance"]["limit"] == 0.5
    worded = manoeuvre["verdict"]["word"]
    assert WARNED.sub("", ended["verdict"]["text"]) == WARNED.sub("", worded)


def assert_one_verdict(ended: dict[str, Any], scoring: dict[str, Any]) -> None:
    """The verdict of an ended flight is that of the only manoeuvre, or of what is outside it."""
    (manoeuvre,) = scoring["manoeuvres"]
    outside = scoring["outside_exceedances"]
    verdict = ended["verdict"]
    found = [manoeuvre["exceedance"], manoeuvre["recorded_exceedance"], *outside]
    found = [each for each in found if each is not None]
    if not found:
        is_cut = manoeuvre["outcome"] == "cut"
        assert ((verdict or {"text": ""})["text"].startswith("ENDS WITHIN")) == is_cut
        assert (verdict is None or is_cut, ended["exceedances"]) == (True, [])
        return
    first = min(found, key=lambda each: each["t"])
    assert ended["exceedances"][0]["first_t"] == pytest.approx(first["t"])
    worst = {each["channel"]: each["value"] for each in manoeuvre["worst"]}
    for each in outside:
        known = worst.get(each["channel"], 0.0), each["worst"]
        worst[each["channel"]] = max(known, key=abs)
    assert {each["channel"]: each["worst"] for each in ended["exceedances"]} == worst
    recorded = {each["channel"]: each["value"] for each in manoeuvre["worst_recorded"]}
    named = {each["channel"]: each["recorded"] for each in ended["exceedances"]}
    assert {key: value for key, value in named.items() if value is not None} == recorded
    worded = manoeuvre["verdict"]
    if first not in outside:
        assert WARNED.sub("", verdict["text"]) == WARNED.sub("", worded["word"].split(";")[0])
    if manoeuvre["exceedance"] is None and first["doubt"]:
        assert "check the sensor" in verdict["text"]
        assert ended["exceedances"][0]["worst"] == first["value"]
        is_outside = first in outside
        assert is_outside or (worded["sign"], worded["level"]) == ("▲", "alert")
