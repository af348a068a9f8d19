"""Scorings over REST: identical requests give identical bits; the inputs are stored."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from app.recordings import files as recording_files
from app.recordings import scored as scored_recordings
from app.recordings.files import Verified
from app.recordings.recordings import Recordings
from app.recordings.samples import open_samples
from core.evaluation.certificate import UNCALIBRATED, UNTESTED
from core.monitor import MonitorRecipe, train
from tests.support.api import api, problem, store_of
from tests.support.oscillator import DT
from tests.support.recorded import RECORDINGS, csv_of, kept_files, uploaded

WHOLE = {"trim": None, "manoeuvres": "entire"}


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory):
    return tmp_path_factory.mktemp("data")


@pytest.fixture(scope="module")
def client(data_dir):
    with api(data_dir) as client:
        yield client


@pytest.fixture(scope="module")
def monitor(client, dataset):
    trained = train(replace(dataset, recipe={}), MonitorRecipe(epsilon=0.2))
    return store_of(client).monitors.add(trained, "oscillator").id


@pytest.fixture(scope="module")
def flight(flights):
    """Twenty flights in a row."""
    return np.concatenate(flights)


@pytest.fixture
def recording(client, flight):
    kept = uploaded(client, csv_of(flight))
    yield kept
    client.delete(f"{RECORDINGS}/{kept['id']}")


def scored(client, recording, monitor, status=201, **order):
    answer = client.post(
        f"{RECORDINGS}/{recording['id']}/scorings", json={"monitor": monitor} | WHOLE | order
    )
    assert answer.status_code == status, answer.text
    return answer.json()


def test_a_recording_is_scored_and_the_scoring_stored(client, recording, monitor, flight):
    path = f"{RECORDINGS}/{recording['id']}/scorings"
    answer = client.post(path, json={"monitor": monitor} | WHOLE)
    assert answer.status_code == 201, answer.text
    scoring = answer.json()
    assert answer.headers["location"] == f"{path}/{scoring['id']}"
    assert client.get(f"{path}/{scoring['id']}").json() == scoring
    assert client.get(path).json() == [scoring]
    assert client.get(f"{RECORDINGS}/{recording['id']}").json()["n_scorings"] == 1
    info = client.get(f"/api/v1/monitors/{monitor}").json()
    assert scoring["monitor_digest"] == info["digest"]
    assert (scoring["monitor_name"], scoring["epsilon"]) == ("oscillator", 0.2)
    assert scoring["warnings"] == [UNTESTED, UNCALIBRATED]
    assert scoring["mapping"] == recording["mapping"]
    assert scoring["request"] == {"epsilon": 0.2} | WHOLE
    assert scoring["n_samples"] == len(flight)
    assert (scoring["dt"], scoring["lead"]) == (DT, info["lead"])
    assert scoring["channels"][3]["limit"] == 0.5
    assert len(scoring["manoeuvres"]) == 1
    assert scoring["quality"]["sentences"]
    words = {check["channel"]: check["unchecked"] for check in scoring["quality"]["compatibility"]}
    assert words.keys() == {"p", "r", "beta", "Ny", "V"}
    assert words["p"] == "without bank angle"


def test_exceedances_outside_the_marked_manoeuvres_are_stored(client, monitor, flight):
    loud = flight.copy()
    loud[-50:-45, 3] = 5.0
    kept = uploaded(client, csv_of(loud))
    span = [{"start": 0.0, "end": 100 * DT, "name": "first"}]
    scoring = scored(client, kept, monitor, trim=None, manoeuvres=span)
    last = scoring["outside_exceedances"][-1]
    assert last["channel"] == "Ny"
    assert last["t"] <= (len(loud) - 46) * DT + 1e-9
    assert all(one["t"] > 100 * DT for one in scoring["outside_exceedances"])
    assert any("outside every manoeuvre" in note for note in scoring["notes"])
    path = f"{RECORDINGS}/{kept['id']}/scorings/{scoring['id']}"
    assert client.get(path).json()["outside_exceedances"] == scoring["outside_exceedances"]
    assert "outside every manoeuvre" in client.get(f"{path}/report").text
    client.delete(f"{RECORDINGS}/{kept['id']}")


def test_an_identical_request_returns_the_stored_scoring(client, data_dir, recording, monitor):
    first = scored(client, recording, monitor)
    files = kept_files(data_dir)
    assert scored(client, recording, monitor, 200) == first
    assert scored(client, recording, monitor, 200, epsilon=0.2) == first
    assert kept_files(data_dir) == files
    other = scored(client, recording, monitor, epsilon=0.4)
    assert other["id"] != first["id"]
    assert other["epsilon"] == 0.4
    client.delete(f"{RECORDINGS}/{recording['id']}/scorings/{first['id']}")
    again = scored(client, recording, monitor)
    assert again["id"] != first["id"]
    assert again["digest"] == first["digest"]


def test_the_same_file_uploaded_again_gives_the_same_bits(client, recording, monitor, flight):
    twin = uploaded(client, csv_of(flight))
    assert twin["same_as"] == recording["id"]
    ours, theirs = (scored(client, one, monitor) for one in (recording, twin))
    assert ours["id"] != theirs["id"]
    assert ours["digest"] == theirs["digest"]
    client.delete(f"{RECORDINGS}/{twin['id']}")


def test_simultaneous_identical_requests_make_one_scoring(client, data_dir, recording, monitor):
    with ThreadPoolExecutor(4) as pool:
        answers = pool.map(
            lambda _: client.post(
                f"{RECORDINGS}/{recording['id']}/scorings", json={"monitor": monitor} | WHOLE
            ),
            range(4),
        )
    assert len({answer.json()["id"] for answer in answers}) == 1
    files = kept_files(data_dir)
    assert len([name for name in files if name.startswith(f"{recording['id']}/scorings/")]) == 2


def test_a_scoring_keeps_its_mapping(client, recording, monitor):
    before = scored(client, recording, monitor)
    mapping = {**recording["mapping"], "channels": dict(recording["mapping"]["channels"])}
    sign = -mapping["channels"]["Ny"]["sign"]
    mapping["channels"]["Ny"] = mapping["channels"]["Ny"] | {"sign": sign}
    path = f"{RECORDINGS}/{recording['id']}"
    order = {"mapping": mapping, "remember": False}
    assert client.put(f"{path}/mapping", json=order).status_code == 200
    after = scored(client, recording, monitor)
    assert after["mapping"]["channels"]["Ny"]["sign"] == sign
    assert after["digest"] != before["digest"]
    assert client.get(f"{path}/scorings/{before['id']}").json() == before


def test_frames_are_the_stored_samples(client, data_dir, recording, monitor, flight):
    scoring = scored(client, recording, monitor, manoeuvres=[{"start": 3.05, "end": 6.0}])
    path = f"{RECORDINGS}/{recording['id']}/scorings/{scoring['id']}/assessments"
    got = client.get(path).json()
    assert (got["first"], got["next"], len(got["frames"])) == (0, None, len(flight))
    folder = data_dir / "recordings" / recording["id"] / "scorings"
    samples = open_samples(folder, scoring["id"], scoring["digest"], Verified())
    for frame, sample in zip(got["frames"], samples, strict=True):
        assert frame["t"] == sample["t"]
        assert frame["y"] == sample["y"].tolist()
        assert frame["manoeuvre"] == sample["manoeuvre"]
        known = np.isfinite(sample["p_value"])
        assert frame["p_value"] == (sample["p_value"] if known else None)
        assert frame["alert"] == (sample["alert"] if known else None)
        assert (frame["state"] == "ok") == known
    assert got["frames"][0]["state"] == "invalid"
    assert got["frames"][0]["reason"] == "between manoeuvres"
    assert scoring["manoeuvres"][0]["start"] == pytest.approx(3.05)
    part = client.get(f"{path}?first=5&last=7").json()
    assert part == {"first": 5, "next": None, "frames": got["frames"][5:8]}
    assert client.get(f"{path}?first=99999").json() == {"first": 99999, "next": None, "frames": []}


def test_long_scorings_are_paged(client, recording, monitor, monkeypatch):
    from app.routes import dependencies

    monkeypatch.setattr(dependencies, "MOST_FRAMES", 500)
    scoring = scored(client, recording, monitor)
    path = f"{RECORDINGS}/{recording['id']}/scorings/{scoring['id']}/assessments"
    first, seen = 0, []
    while first is not None:
        page = client.get(f"{path}?first={first}").json()
        assert len(page["frames"]) <= 500
        seen += [frame["seq"] for frame in page["frames"]]
        first = page["next"]
    assert seen == list(range(scoring["n_samples"]))


@pytest.mark.parametrize(("start", "end", "bins"), [(None, None, 40), (3.0, 9.0, 1000), (5, 5, 1)])
def test_tiles_are_the_extremes_of_frames(client, recording, monitor, start, end, bins):
    scoring = scored(client, recording, monitor)
    path = f"{RECORDINGS}/{recording['id']}/scorings/{scoring['id']}"
    frames = client.get(f"{path}/assessments").json()["frames"]
    asked = {"start": start, "end": end, "bins": bins}
    answer = client.get(
        f"{path}/tiles", params={key: v for key, v in asked.items() if v is not None}
    )
    tiles = answer.json()
    n, width = len(tiles["t"]), tiles["samples"]
    assert 0 < n <= bins
    assert tiles["step"] == pytest.approx(width * DT)
    assert tiles["start"] <= (scoring["start"] if start is None else start)
    assert tiles["end"] >= (scoring["end"] if end is None else end) - DT
    first = round((tiles["t"][0] - scoring["start"]) / DT)
    for k in range(n):
        part = frames[first + k * width : first + (k + 1) * width]
        assert tiles["t"][k] == part[0]["t"]
        assert tiles["channels"]["Ny"]["low"][k] == min(frame["y"][3] for frame in part)
        assert tiles["channels"]["Ny"]["high"][k] == max(frame["y"][3] for frame in part)
        risks = [frame["p_value"] for frame in part if frame["p_value"] is not None]
        assert tiles["risk"]["low"][k] == min(risks, default=None)
        assert tiles["risk"]["high"][k] == max(risks, default=None)
        assert tiles["alert"][k] == any(frame["alert"] for frame in part)
        worst = max(("ok", "warming_up", "stale", "invalid").index(f["state"]) for f in part)
        assert tiles["state"][k] == worst


def test_a_window_without_samples_has_no_tiles(client, recording, monitor):
    scoring = scored(client, recording, monitor)
    path = f"{RECORDINGS}/{recording['id']}/scorings/{scoring['id']}/tiles"
    for query in ("start=1000", "end=-1", "start=5&end=4", "start=0.01&end=0.02"):
        tiles = client.get(f"{path}?{query}").json()
        assert tiles["t"] == tiles["state"] == tiles["risk"]["low"] == []
        assert tiles["start"] is tiles["end"] is None
    for query in ("start=nan", "end=inf", "bins=0", "bins=10001"):
        assert problem(client.get(f"{path}?{query}"), 422)


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ({"epsilon": 0.01}, "99 unsafe rollouts"),
        ({"epsilon": 1.5}, "epsilon"),
        ({"manoeuvres": [{"start": 1.0, "end": 1.0}]}, "no length"),
        ({"manoeuvres": [{"start": 1.0, "end": 1000.0}]}, "not inside the recording"),
        ({"manoeuvres": []}, "manoeuvres"),
        ({"manoeuvres": "some"}, "manoeuvres"),
        ({"trim": 0.0}, "trim"),
        ({"trim": 1000.0}, "trim"),
        ({"monitors": "x"}, "monitors"),
    ],
)
def test_an_impossible_request_leaves_nothing(client, data_dir, recording, monitor, order, words):
    files = kept_files(data_dir)
    path = f"{RECORDINGS}/{recording['id']}/scorings"
    answer = client.post(path, json={"monitor": monitor} | WHOLE | order)
    assert words in problem(answer, 422)
    assert client.get(path).json() == []
    assert kept_files(data_dir) == files


def test_unknown_recordings_monitors_and_scorings_are_not_found(client, recording, monitor):
    path = f"{RECORDINGS}/{recording['id']}/scorings"
    assert "nothing" in problem(client.post(path, json={"monitor": "nothing"}), 404)
    lost = f"{RECORDINGS}/nothing/scorings"
    assert "nothing" in problem(client.post(lost, json={"monitor": monitor}), 404)
    for end in ("", "/assessments", "/tiles"):
        assert "nothing" in problem(client.get(f"{path}/nothing{end}"), 404)
    assert "nothing" in problem(client.delete(f"{path}/nothing"), 404)


def test_a_monitor_that_scored_cannot_be_deleted(client, recording, monitor):
    scoring = scored(client, recording, monitor)
    said = problem(client.delete(f"/api/v1/monitors/{monitor}"), 409)
    assert f"scoring of flight.csv ({scoring['id']})" in said


def test_a_deleted_scoring_leaves_nothing(client, data_dir, recording, monitor):
    files = kept_files(data_dir)
    path = f"{RECORDINGS}/{recording['id']}/scorings/{scored(client, recording, monitor)['id']}"
    assert client.delete(path).status_code == 204
    assert kept_files(data_dir) == files
    assert problem(client.get(path), 404)


def test_manoeuvres_are_those_that_a_scoring_finds(client, recording, monitor):
    scoring = scored(client, recording, monitor, trim="trim_segment", manoeuvres="detected")
    path = f"{RECORDINGS}/{recording['id']}/manoeuvres"
    detected = client.get(path, params={"monitor": monitor}).json()
    keys = ("start", "end", "name")
    if detected:
        assert [{key: s[key] for key in keys} for s in scoring["manoeuvres"]] == detected
    assert problem(client.get(path, params={"monitor": "nothing"}), 404)


@pytest.mark.parametrize("moment", ["before", "after"])
def test_a_recording_deleted_while_it_is_scored_leaves_nothing(
    client, data_dir, flight, monitor, monkeypatch, moment
):
    files = kept_files(data_dir)
    recording = uploaded(client, csv_of(flight))
    name = {"before": "score", "after": "save_samples"}[moment]
    real = getattr(scored_recordings, name)

    def deleting(*arguments):
        done = real(*arguments)
        assert client.delete(f"{RECORDINGS}/{recording['id']}").status_code == 204
        return done

    monkeypatch.setattr(scored_recordings, name, deleting)
    path = f"{RECORDINGS}/{recording['id']}/scorings"
    assert recording["id"] in problem(client.post(path, json={"monitor": monitor} | WHOLE), 404)
    assert kept_files(data_dir) == files


def test_a_full_disk_leaves_no_part_of_a_scoring(client, data_dir, recording, monitor, monkeypatch):
    files = kept_files(data_dir)
    monkeypatch.setattr(recording_files, "SPARE_BYTES", 2**62)
    path = f"{RECORDINGS}/{recording['id']}/scorings"
    assert "available" in problem(client.post(path, json={"monitor": monitor} | WHOLE), 507)
    assert kept_files(data_dir) == files


def test_too_many_scorings_at_once_are_refused(client, recording, monitor, monkeypatch):
    kept: Recordings = client.app.state.recordings
    monkeypatch.setattr(kept.workers, "limit", 0)
    path = f"{RECORDINGS}/{recording['id']}/scorings"
    assert "files are in progress" in problem(client.post(path, json={"monitor": monitor}), 429)


def test_two_scorings_are_compared_sample_by_sample(client, recording, monitor):
    part = [{"start": 0.0, "end": 20.0}]
    first, second = (
        scored(client, recording, monitor, epsilon=epsilon, manoeuvres=manoeuvres)
        for epsilon, manoeuvres in ((0.4, "entire"), (0.2, part))
    )
    base = f"{RECORDINGS}/{recording['id']}/scorings"
    path = f"{base}/{first['id']}/comparison"
    answer = client.get(path, params={"scoring": second["id"]}).json()
    frames = [
        client.get(f"{base}/{each['id']}/assessments").json()["frames"] for each in (first, second)
    ]
    ns = [sum(frame["state"] == "ok" for frame in each) for each in frames]
    assert 0 < ns[1] < ns[0]
    assert [answer["n_first"], answer["n_second"], answer["n_both"]] == [*ns, ns[1]]
    risks = [{f["t"]: f["p_value"] for f in each if f["state"] == "ok"} for each in frames]
    apart = {t: abs(risks[0][t] - risks[1][t]) for t in risks[1]}
    largest = answer["largest"]
    assert abs(largest["second"] - largest["first"]) == apart[largest["t"]] == max(apart.values())
    problem(client.get(path, params={"scoring": "none"}), 404)
