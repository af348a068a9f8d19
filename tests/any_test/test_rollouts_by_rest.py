"""Flights of a user's simulator through REST: previewed, added, looked at and trained on."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from app.recordings import flown_flights
from core.channels import Dictionary
from tests.support.api import api, finished, problem, store_of
from tests.support.rollout_files import (
    KEYS,
    TO_FILE,
    N,
    as_folder,
    as_hdf5,
    as_long_csv,
    as_long_parquet,
    as_matlab,
    as_npz,
    flights,
    npz,
)
from tests.support.short_period import DICTIONARY, DT, LIMITS

PATH = "/api/v1/datasets"
LIMIT = {"limit": "Nz=-1.1..2.9g"}


def files(*paths: Path) -> list[tuple[str, tuple[str, bytes]]]:
    return [("file", (path.name, path.read_bytes())) for path in paths]


def add(client: TestClient, *sent: tuple[str, bytes], **said: str) -> dict[str, Any]:
    """The ended job that adds these files."""
    form = [("file", each) for each in sent]
    return finished(client, client.post(PATH, files=form, data=said))


def incoming(client: TestClient) -> list[Path]:
    return list(client.app.state.recordings.files.incoming.glob("*"))  # pyright: ignore


@pytest.fixture(scope="module")
def pitch(client: TestClient) -> dict[str, Any]:
    """600 pitch doublets, as they are stored."""
    job = add(client, ("pitch.npz", npz(flights(600))), **LIMIT, name="pitch doublets")
    assert job["status"] == "done", job["error"]
    return client.get(f"{PATH}/{job['result']['dataset']}").json() | {"job": job}


def test_rollouts_are_stored_with_their_channels_and_limits(
    client: TestClient, pitch: dict[str, Any]
) -> None:
    y = flights(600)
    fails = LIMITS.envelope.exceeds(y).any(axis=1)
    assert pitch["name"] == "pitch doublets"
    assert pitch["recipe"] == {}
    assert (pitch["n_unsafe"], pitch["n_safe"]) == (fails.sum(), (~fails).sum())
    assert pitch["dt"] == DT
    assert Dictionary.from_stored(pitch["dictionary"]).keys == KEYS
    assert (pitch["limits"]["Nz"]["low"], pitch["limits"]["Nz"]["high"]) == (-1.1, 2.9)
    assert pitch["limits"]["Nz"]["rest"] == pytest.approx(1.0, abs=0.01)
    (peaks,) = pitch["peaks"]
    assert (peaks["channel"], peaks["limit"]) == ("Nz", None)
    beyond = sum(n for n, edge in zip(peaks["unsafe"], peaks["edges"], strict=False) if edge >= 1)
    assert beyond == sum(peaks["unsafe"]) == fails.sum()
    assert sum(peaks["safe"][: peaks["edges"].index(1.0)]) == (~fails).sum()
    assert pitch["findings"] == pitch["job"]["result"]["findings"] == []
    assert incoming(client) == []


def test_its_arrays_and_rollouts_have_its_own_channels(
    client: TestClient, pitch: dict[str, Any]
) -> None:
    path = f"{PATH}/{pitch['id']}"
    with np.load(io.BytesIO(client.get(f"{path}/arrays").content)) as stored:
        assert tuple(stored["channels"]) == KEYS
        assert tuple(stored["units"]) == ("rad", "rad/s", "g", "rad")
        safe = stored["safe"]
    y = flights(600)
    expected = y[~LIMITS.envelope.exceeds(y).any(axis=1)]
    np.testing.assert_allclose(safe, expected, rtol=1e-9, atol=1e-12)
    rollout = client.get(f"{path}/rollouts/{pitch['n_unsafe']}").json()
    assert list(rollout["telemetry"]) == ["t", *KEYS]
    np.testing.assert_array_equal(rollout["telemetry"]["Nz"], safe[0, :, 2])


@pytest.mark.parametrize(
    "write", [as_npz, as_matlab, as_hdf5, as_folder, as_long_csv, as_long_parquet]
)
def test_every_kind_of_file_gives_the_same_flights(
    write: Any, client: TestClient, tmp_path: Path
) -> None:
    source = write(tmp_path, flights())
    paths = sorted(source.iterdir()) if source.is_dir() else [source]
    job = finished(client, client.post(PATH, files=files(*paths)))
    assert job["status"] == "done", job["error"]
    stored = store_of(client).datasets.get(job["result"]["dataset"])
    assert stored.fail_index.tolist() == [40, 50]
    np.testing.assert_allclose(stored.safe, flights()[[0, 2, 3, 5]], rtol=1e-9, atol=1e-9)
    assert stored.specification == "labels of the rollouts"


@pytest.mark.parametrize("name", ["{away}/rollouts", "a/../../b", "F-16 1.2/3", "..", ".hidden"])
def test_rollouts_are_stored_among_the_uploads_whatever_their_name(
    name: str, client: TestClient, tmp_path: Path
) -> None:
    job = add(client, ("own.npz", npz(flights(200))), name=name.format(away=tmp_path), **LIMIT)
    assert job["status"] == "done", job["error"]
    assert client.get(f"{PATH}/{job['result']['dataset']}").json()["name"] == name.format(
        away=tmp_path
    )
    assert list(tmp_path.iterdir()) == []
    assert incoming(client) == []


def test_a_preview_shows_channels_and_ranges_and_stores_nothing(client: TestClient) -> None:
    before = client.get(PATH).json()
    form = [("file", ("labelled.npz", npz(flights(), unsafe=[0, 1, 0, 0, 0, 0])))]
    seen = client.post(f"{PATH}/preview", files=form).json()
    assert [channel["key"] for channel in seen["dictionary"]["channels"]] == list(KEYS)
    assert (seen["n_flights"], seen["n_samples"], seen["n_failing"]) == (N, 81, 1)
    assert seen["dt"] == DT
    y = flights()
    for c, key in enumerate(KEYS):
        assert seen["ranges"][key]["low"] == pytest.approx(y[..., c].min())
        assert seen["ranges"][key]["high"] == pytest.approx(y[..., c].max())
    assert seen["ranges"]["Nz"]["rest"] == pytest.approx(np.median(y[:, 0, 2]))
    assert client.get(PATH).json() == before
    assert incoming(client) == []


def test_a_dictionary_chooses_channels_units_and_roles(client: TestClient) -> None:
    text = "key,unit,label,role,reference\nNz,g,load factor,output,absolute\n"
    text += "alpha,deg,vane,condition,absolute\n"
    job = add(client, ("a.npz", npz(flights(200))), dictionary=text, **LIMIT)
    info = client.get(f"{PATH}/{job['result']['dataset']}").json()
    first, second = info["dictionary"]["channels"]
    assert (first["label"], second["role"]) == ("load factor", "condition")
    # the unit of people: values are in SI
    assert (second["unit"], second["display_unit"]) == ("rad", "deg")
    y = store_of(client).datasets.get(info["id"]).safe
    assert np.abs(y[..., 1]).max() < 1.0


def test_unnamed_channels_and_a_missing_interval_are_given_with_the_files(
    client: TestClient,
) -> None:
    file = io.BytesIO()
    np.savez(file, y=flights(200))
    sent = ("y.npz", file.getvalue())
    text, form = json.dumps(DICTIONARY.to_plain()), [("file", sent)]
    for said, words in (({}, "does not name its 4 channels"), ({"dictionary": text}, "has no dt")):
        answer = client.post(PATH, files=form, data=LIMIT | said)
        assert words in problem(answer, 422)
    job = add(client, sent, dictionary=text, dt="0.05", **LIMIT)
    assert job["status"] == "done", job["error"]
    assert client.get(f"{PATH}/{job['result']['dataset']}").json()["dt"] == 0.05


def test_findings_are_kept_with_the_dataset(client: TestClient) -> None:
    y = flights(100)
    fail = np.where(LIMITS.envelope.exceeds(y).any(axis=1), 80, -1)
    y[fail < 0] = np.concatenate([y[fail < 0][:1], y[fail < 0][:-1]])
    job = add(client, ("a.npz", npz(y, fail_index=fail)), **LIMIT)
    findings = client.get(f"{PATH}/{job['result']['dataset']}").json()["findings"]
    assert findings == job["result"]["findings"]
    assert any("duplicate flights left out: 1" in text for text in findings)
    assert any("before their label" in text for text in findings)
    assert any("which needs 58" in text for text in findings)


@pytest.mark.parametrize(
    ("sent", "said", "words"),
    [
        ({"y": np.zeros((3, 5, 4))}, {}, "neither labels nor limits"),
        ({}, {"limit": "Nzz=..2"}, "did you mean Nz"),
        ({}, {"limit": "Nz=..2deg"}, "not a unit of this quantity"),
        ({}, {"limit": "Nz=-20..20"}, "0 of 6 flights fail"),
        ({}, {"limit": "Nz=-90..90"}, "values beyond 30 g"),
        (
            {"channels": ("vane", "q", "Nz", "e"), "units": ("degg", "x", "g", "x")},
            LIMIT,
            "did you mean deg",
        ),
        ({"channels": ("a", "b")}, LIMIT, "names 2 channels, and y has 4"),
        ({"channels": ("a", "b", "a", "c")}, LIMIT, "two channels have the name 'a'"),
        ({"theta": np.zeros(3)}, LIMIT, "one row for each of 6"),
        ({"fail_index": np.zeros(3)}, {}, "3 labels were given for 6 flights"),
        ({"y": np.zeros((3, 5))}, LIMIT, "no array y of flights, samples and channels"),
        ({"y": np.zeros((1, 3, 5, 4))}, LIMIT, "y has shape (1, 3, 5, 4)"),
        ({"y": flights().astype(str)}, LIMIT, "y holds text"),
        ({"y": flights().astype(object)}, LIMIT, "y holds objects"),
        ({"y": flights() + 1j}, LIMIT, "y holds complex numbers"),
        ({"y": np.full((6, 5, 4), np.nan)}, LIMIT, "no number that is finite"),
        (
            {"y": np.where(flights() == flights()[1, 3, 0], np.inf, flights())},
            LIMIT,
            "infinite values in 1 flight, the first in alpha of flight 2",
        ),
        ({"dt": -0.05}, LIMIT, "dt is -0.05"),
        ({"dt": [0.05] * 5 + [0.1]}, LIMIT, "dt is 0.05, 0.1"),
        ({"dt": "0.05"}, LIMIT, "dt holds text"),
        ({"fail_index": np.array([-1, 40.5, -1, -1, 50, -1])}, {}, "the value 40.5"),
        ({"fail_index": np.array([-1, np.nan, -1, -1, 50, -1])}, {}, "the value nan"),
        ({"fail_index": np.full(6, 500)}, {}, "a flight has 81 samples"),
        ({"unsafe": np.array(["yes", "no"] * 3)}, {}, "unsafe holds text"),
        ({"unsafe": np.array([0, 1, 2, 0, 1, 1])}, {}, "unsafe has the value 2"),
    ],
)
def test_files_that_cannot_be_used_are_refused_at_once_with_one_sentence(
    sent: dict[str, Any], said: dict[str, str], words: str, client: TestClient
) -> None:
    jobs = client.get("/api/v1/jobs").json()
    form = [("file", ("own.npz", npz(flights(), **sent)))]
    said_of_it = problem(client.post(PATH, files=form, data=said), 422)
    assert words in said_of_it
    assert str(client.app.state.settings.data_dir) not in said_of_it  # pyright: ignore
    assert "/incoming/" not in said_of_it
    assert client.get("/api/v1/jobs").json() == jobs
    assert incoming(client) == []


def test_files_too_large_to_check_at_once_are_refused_by_the_job(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flown_flights, "MOST_CHECKED", 0)
    before = client.get(PATH).json()
    job = add(client, ("own.npz", npz(flights())), limit="Nzz=..2")
    assert job["status"] == "failed"
    assert "did you mean Nz" in job["error"]
    assert client.get(PATH).json() == before
    assert incoming(client) == []


def test_a_field_in_the_address_and_a_body_of_no_form_are_refused(client: TestClient) -> None:
    form = [("file", ("own.npz", npz(flights())))]
    answer = client.post(f"{PATH}?limit=Nz=..2", files=form)
    assert "limit=: give it in the body" in problem(answer, 422)
    for path in (PATH, f"{PATH}/preview"):
        octets = {"content-type": "application/octet-stream"}
        answer = client.post(path, content=npz(flights()), headers=octets)
        assert "octet-stream" in problem(answer, 415)


@pytest.mark.parametrize(
    ("form", "said", "words"),
    [
        ([], {}, "there is no file"),
        ([("a.csv", b"t\n0\n")], {"limits": "Nz=..2"}, "did you mean limit"),
        ([("a.csv", b"")], {}, "a.csv is empty"),
        ([("a.npz", b"no archive" * 50)], LIMIT, "no row of numbers"),
        ([("a.npz", b"PK\x03\x04" + bytes(500))], LIMIT, "damaged or cut short"),
        ([("a.csv", b"t\n0\n"), ("a.csv", b"t\n0\n")], {}, "two files have the name a.csv"),
        ([("a.csv", b"t\n0\n")], {"dt": "-1"}, "dt is '-1'"),
        ([("a.csv", b"t\n0\n")], {"dictionary": "key\nalpha\n"}, "give key and unit"),
        ([("a.csv", b"t\n0\n")], {"dictionary": "[{]"}, "not a dictionary"),
        ([("é" * 140 + ".npz", b"t\n0\n")], {}, "more than 255 bytes: shorten it"),
        (
            [("a.csv", b"t\n0\n")],
            {"dictionary": '[{"key": "a", "unit": "rad", "role": "outputs"}]'},
            "choose output, control, condition",
        ),
    ],
)
def test_a_request_that_cannot_be_used_is_refused_at_once(
    form: list[tuple[str, bytes]], said: dict[str, str], words: str, client: TestClient
) -> None:
    sent = [("file", each) for each in form] or [("name", (None, b"1"))]
    answer = client.post(PATH, files=sent, data=said)  # pyright: ignore[reportArgumentType]
    assert words in problem(answer, 422)
    assert incoming(client) == []


def test_a_file_under_another_name_than_file_is_refused(client: TestClient) -> None:
    form = [("data", ("a.npz", npz(flights())))]
    assert "send files as file" in problem(client.post(PATH, files=form, data=LIMIT), 422)


def test_files_of_a_cancelled_job_are_removed(tmp_path: Path) -> None:
    with api(tmp_path, max_jobs=0) as client:
        answer = client.post(PATH, files=[("file", ("a.npz", npz(flights(200))))], data=LIMIT)
        assert answer.status_code == 202
        assert len(incoming(client)) == 1
        assert client.post(f"/api/v1/jobs/{answer.json()['id']}/cancel").status_code == 202
        assert incoming(client) == []


def test_flights_larger_than_the_server_allows_are_refused(tmp_path: Path) -> None:
    with api(tmp_path, max_array_bytes=10_000) as client:
        form = [("file", ("a.npz", npz(flights())))]
        answer = client.post(f"{PATH}/preview", files=form)
        assert "6 flights of up to 81 samples and 4 channels need" in problem(answer, 422)


def test_a_monitor_of_own_rollouts_tries_the_methods(client: TestClient) -> None:
    job = add(client, ("pitch.npz", npz(flights(1600))), **LIMIT)
    order = {"dataset": job["result"]["dataset"], "t_early": 0.5, "guarantee": "average"}
    trained = finished(client, client.post("/api/v1/monitors", json=order))
    assert trained["status"] == "done", trained
    methods = trained["result"]["methods"]
    assert [tried["name"] for tried in methods][-1] == "threshold on today's value"
    assert sum(tried["chosen"] for tried in methods) == 1
    path = f"/api/v1/monitors/{trained['result']['monitor']}"
    evaluation = client.get(f"{path}/evaluation").json()
    assert evaluation["methods"] == methods
    assert sum(evaluation["flights"].values()) == 1600
    assert client.get(path).json()["dataset_id"] == order["dataset"]
    assert "Methods tried" in client.get(f"{path}/certificate").text
    named = order | {"predictor": {"kind": "linear"}, "score": {"kind": "nearest_neighbor"}}
    trained = finished(client, client.post("/api/v1/monitors", json=named))
    assert "methods" not in trained["result"]


def test_other_work_on_own_rollouts_says_that_it_needs_a_recipe(
    client: TestClient, pitch: dict[str, Any]
) -> None:
    for path in ("studies", "sweeps"):
        answer = client.post(f"/api/v1/{path}", json={"dataset": pitch["id"]})
        assert "was not simulated here" in problem(answer, 422)


def test_parameters_and_labels_of_the_files_are_kept(client: TestClient) -> None:
    theta = np.arange(2.0 * N).reshape(N, 2)
    more = {"theta": theta, "theta_names": ("mass", "inertia"), "unsafe": [0, 1, 0, 0, 1, 0]}
    job = add(client, ("a.npz", npz(flights(), **more)))
    stored = store_of(client).datasets.get(job["result"]["dataset"])
    assert stored.theta_names == ("mass", "inertia")
    np.testing.assert_array_equal(stored.theta_unsafe, theta[[1, 4]])
    path = f"{PATH}/{job['result']['dataset']}/rollouts/1"
    assert client.get(path).json()["theta"] == {"mass": 8.0, "inertia": 9.0}


def test_a_computed_channel_is_limited(client: TestClient) -> None:
    said = {"channel": "load [kN] = 12*Nz", "limit": "load=..34"}
    job = add(client, ("a.npz", npz(flights(200))), **said)
    info = client.get(f"{PATH}/{job['result']['dataset']}").json()
    assert info["dictionary"]["channels"][-1]["formula"] == "12*Nz"
    assert [peaks["channel"] for peaks in info["peaks"]] == ["load"]
    rollout = client.get(f"{PATH}/{info['id']}/rollouts/0").json()["telemetry"]
    np.testing.assert_allclose(rollout["load"], 12 * np.array(rollout["Nz"]), rtol=1e-12)


def test_units_of_the_file_are_converted(client: TestClient, pitch: dict[str, Any]) -> None:
    stored = store_of(client).datasets.get(pitch["id"])
    in_file = stored.safe[0] * TO_FILE
    assert np.abs(in_file[:, 0]).max() > 2.0 > np.abs(stored.safe[0, :, 0]).max()


def test_what_is_said_of_files_is_refused_beside_a_recipe(client: TestClient) -> None:
    answer = client.post(f"{PATH}?limit=Nz=..3", json={"n_unsafe": 20})
    assert answer.status_code == 422
    assert "limit=: give it in the body" in answer.text
