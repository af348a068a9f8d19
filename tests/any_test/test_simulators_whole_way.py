"""Each kind of simulator the whole way: `train`, page, live flight, recording, report."""

import json
import shutil
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import httpx2
import numpy as np
import pytest

from app.cli import main
from app.store.store import open_store
from core.dataset import Dataset
from core.monitor import Monitor, load
from tests.support import own_pitch, pitch_fmu
from tests.support.api import served
from tests.support.patience import PATIENCE, until
from tests.support.short_period import resting_first

pytestmark = pytest.mark.usefixtures("few_flights")
PITCH: dict[str, Any] = {
    "channels": {"alpha": "alpha_deg", "q": "q", "Nz": "az", "delta_e": "surface"},
    "inputs": {
        "command": [[0.5, 0], [0.5, -0.06], [1.3, -0.06], [1.3, 0.06], [2.1, 0.06], [2.1, 0]]
    },
    "parameters": {"stiffness": 1.1, "control.gain": [1.0, 0.18]},
    "duration_s": 4.0,
    "dt": 0.05,
}
A4: dict[str, Any] = {
    "altitude_m": 3000,
    "speed_m_s": 180,
    "inputs": {"fcs/elevator-cmd-norm": [[0.3, 0], [0.3, -0.2], [0.8, -0.2], [0.8, 0]]},
    "timing_jitter_s": 0.05,
    "duration_s": 2.0,
    "dt": 0.05,
}


class Kind(NamedTuple):
    """A simulator, its test point, its limit, and why it cannot be tested here."""

    spec: str
    point: dict[str, Any] | None
    limit: str
    missing: str = ""


FMPY = "" if find_spec("fmpy") else "FMPy is not installed: the extra fmu"
JSBSIM = "" if find_spec("jsbsim") else "JSBSim is not installed: the extra jsbsim"
KINDS = {
    "python": Kind("whole_pitch:pitch", None, "Nz=-1.1..2.9g"),
    "fmu": Kind("pitch.fmu", PITCH, "Nz=-1.1..2.9g", FMPY or pitch_fmu.MISSING),
    "jsbsim": Kind("jsbsim:A4", A4, "Nz=..2.75g", JSBSIM),
}


class Own(NamedTuple):
    """A served monitor of a simulator, and its dataset."""

    url: str
    kind: Kind
    monitor: Monitor
    dataset: Dataset
    id: str
    dataset_id: str


@pytest.fixture(scope="module", params=list(KINDS))
def own(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, few_flights: None
) -> Iterator[Own]:
    kind = KINDS[request.param]
    if kind.missing:
        pytest.skip(kind.missing)
    folder = tmp_path_factory.mktemp(request.param)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(sys, "path", [*sys.path])
        shutil.copy(own_pitch.__file__, "whole_pitch.py")
        point: list[str] = []
        if request.param == "fmu":
            pitch_fmu.make_fmu(Path("pitch.fmu"))
        if kind.point is not None:
            Path("point.json").write_text(json.dumps(kind.point))
            point = ["--point", "point.json"]
        sizes = ["--n-unsafe", "40", "--n-test", "0", "--epsilon", "0.1", "--data-dir", "data"]
        method = ["--guarantee", "average", "--predictor", "peak_ridge"]
        assert main(["train", "--simulator", kind.spec, *point, "--limit", kind.limit, *sizes,
                     *method, "-o", "own.fwm"]) == 0  # fmt: skip
    monitor = load(folder / "own.fwm")
    assert isinstance(monitor, Monitor)
    store = open_store(folder / "data" / "forewarn.db", recover=False)
    (stored,), (dataset,) = store.monitors.all(), store.datasets.all()
    flights = store.datasets.get(dataset.id)
    store.close()
    with served(folder / "data") as (url, _):
        yield Own(url, kind, monitor, flights, stored.id, dataset.id)


def get(url: str) -> Any:
    return httpx2.get(url, timeout=PATIENCE).raise_for_status().json()


def post(url: str, body: dict[str, Any]) -> Any:
    return httpx2.post(url, json=body, timeout=PATIENCE).raise_for_status().json()


def test_a_flight_is_flown_recorded_scored_and_reported(own: Own):
    api, dictionary = f"{own.url}/api/v1", own.monitor.dictionary
    assert get(f"{api}/monitors/{own.id}")["dataset_id"] == own.dataset_id
    source = get(f"{api}/datasets/{own.dataset_id}")["recipe"]
    assert source["simulator"] == own.kind.spec
    assert source.get("point", {}).get("inputs") == (own.kind.point or {}).get("inputs")
    unsafe, fail_index = own.dataset.unsafe, own.dataset.fail_index
    assert own.monitor.envelope is not None
    at_failure = unsafe[np.arange(len(unsafe)), fail_index]
    is_measured = own.monitor.envelope.exceeds(at_failure)  # noise may hide it
    k = int(np.argmax(np.where(is_measured, fail_index, -1)))
    y = unsafe[k, : fail_index[k] + 1]
    y = resting_first(y)
    order = {"source": {"kind": "live", "trim": "detected"}, "monitor": own.id}
    flight = post(f"{api}/flights", order)["id"]
    times = (own.monitor.dt * np.arange(len(y))).round(6).tolist()
    sent = {key: y[:, c].tolist() for c, key in enumerate(dictionary.keys)}
    telemetry = {"t": times, **sent}
    for first in range(0, len(y), 20):
        batch = {key: values[first : first + 20] for key, values in telemetry.items()}
        post(f"{api}/flights/{flight}/samples", batch)
    post(f"{api}/flights/{flight}/end", {})
    ended = get(f"{api}/flights/{flight}")
    assert [each["channel"] for each in ended["exceedances"]] == ["Nz"]
    states = [each["state"] for each in get(f"{api}/flights/{flight}/assessments")["frames"]]
    assert states.count("ok") > 5
    until(lambda: get(f"{api}/flights/{flight}")["recording"] is not None)
    recording = f"{api}/recordings/{get(f'{api}/flights/{flight}')['recording']}"
    scoring = post(f"{recording}/scorings", {"monitor": own.id})
    assert scoring["manoeuvres"][0]["exceedance"]["channel"] == "Nz"
    address = f"{recording}/scorings/{scoring['id']}/report"
    report = httpx2.get(address, timeout=PATIENCE).raise_for_status()
    assert "normal acceleration" in report.text
