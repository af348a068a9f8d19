"""Recordings of flown flights as rollouts: alone, and beside simulated ones."""

import json
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient

from app.assessment.recorded import RecordedFlight
from app.cli import main
from app.recordings.flown_flights import RolloutSources, recorded_files
from app.store.store import open_store
from core.channels import LATERAL
from core.collection import collect
from core.dataset import Dataset
from core.monitor import MonitorRecipe, load, train
from core.monitor.training import halves_of
from core.planned_test.collection import DatasetRecipe
from core.rollouts import UNLABELLED, FlownManoeuvre, LabelledFlights, RolloutsError
from core.types import Array
from tests.any_test.test_rollouts_by_rest import LIMIT
from tests.support.api import api, finished, problem, store_of
from tests.support.flown import doublets, fails, flown
from tests.support.recorded import RECORDINGS, csv_of, uploaded
from tests.support.rollout_files import npz
from tests.support.short_period import DICTIONARY, DT, LIMITS

DATASETS, MONITORS = "/api/v1/datasets", "/api/v1/monitors"
TEXT = json.dumps(DICTIONARY.to_plain())
N_FLIGHTS, N_EACH = 30, 3
FLOWN = doublets(N_FLIGHTS * N_EACH, 50)


def manoeuvre(flight: str, number: int = 1) -> FlownManoeuvre:
    return FlownManoeuvre(flight, flight, f"manoeuvre {number}", 0.0, 4.0)


def mixed(n: int = 200, n_flights: int = 20) -> LabelledFlights:
    """n simulated flights, and three manoeuvres of each flown one."""
    y = np.concatenate([doublets(n, 1), doublets(3 * n_flights, 2)])
    flown = [manoeuvre(f"flight {k}", m) for k in range(n_flights) for m in range(3)]
    about = {"dt": DT, "channels": DICTIONARY, "limits": LIMITS, "flown": [*[None] * n, *flown]}
    return LabelledFlights.of(y, **about)


# --- core -----------------------------------------------------------------------------------------


def test_all_manoeuvres_of_a_flight_are_on_one_side_of_a_split() -> None:
    whole = mixed()
    for seed in range(5):
        parts = whole.split((0.5, 0.15, 0.15, 0.2), seed)
        flights = [{each.digest for each in part.flown if each} for part in parts]
        assert sum(map(len, flights)) == len(set.union(*flights)) == 20
        assert sum(len(part.y) for part in parts) == len(whole.y)
        for part in parts:
            assert [each is not None for each in part.flown] == part.is_flown.tolist()


def test_an_ensemble_trains_and_calibrates_on_whole_flights() -> None:
    dataset = Dataset.from_flights(mixed())
    training, calibrating = halves_of(dataset)
    assert sorted([*training, *calibrating]) == list(range(len(dataset.unsafe)))
    flown = dataset.flights().flown
    flights = [{each.digest for k in half if (each := flown[k])} for half in halves_of(dataset)]
    assert flights[0]
    assert flights[1]
    assert not flights[0] & flights[1]


def test_calibration_leaves_out_all_failures_of_a_flight() -> None:
    """A second, almost equal failure of each flight tells nothing new."""
    y = doublets(120, 4)
    of = [manoeuvre(f"flight {k}") for k in range(len(y))]
    failing = [k for k, each in enumerate(y) if fails(each)]
    again = [manoeuvre(of[k].flight, 2) for k in failing]
    about = {"dt": DT, "channels": DICTIONARY, "limits": LIMITS}
    once = LabelledFlights.of(y, flown=of, **about)
    twice = LabelledFlights.of(np.concatenate([y, y[failing] + 1e-9]), flown=[*of, *again], **about)
    for recipe in (MonitorRecipe(epsilon=0.2), MonitorRecipe(epsilon=0.2, p_value="exact")):
        single, double = (train(Dataset.from_flights(each), recipe) for each in (once, twice))
        assert double.n_unsafe == 2 * single.n_unsafe
        np.testing.assert_allclose(double.alphas, np.repeat(single.alphas, 2), rtol=1e-4)


def test_one_flight_alone_promises_nothing() -> None:
    y = doublets(60, 4)
    of = [manoeuvre("one" if fails(each) else f"safe {k}", k) for k, each in enumerate(y)]
    about = {"dt": DT, "channels": DICTIONARY, "limits": LIMITS}
    monitor = train(Dataset.from_flights(LabelledFlights.of(y, flown=of, **about)))
    assert np.isposinf(monitor.alphas).all()


def test_copies_of_a_recording_are_one_flight() -> None:
    sizes = (20.0, 0.3, 1.0, 0.2, 2.0)
    copies = [
        FlownManoeuvre("a", "a", "manoeuvre 1", 0.0, 4.0, sizes=each)
        for each in (sizes, (20.0, 0.300001, 1.0, 0.2, 2.0), (20.0, 0.3, 1.0, 0.3, 2.0), ())
    ]
    flown = tuple(replace(each, digest=str(k)) for k, each in enumerate(copies))
    whole = mixed().some(np.arange(len(flown)))
    first, same, other, unknown = replace(whole, flown=flown).settings()
    assert first == same
    assert len({first, other, unknown}) == 3


def test_a_dataset_names_its_flown_rollouts() -> None:
    whole = mixed()
    dataset = Dataset.from_flights(whole)
    back = dataset.flights()
    pairs = {(y.tobytes(), each) for y, each in zip(whole.y, whole.flown, strict=True)}
    assert {(y.tobytes(), each) for y, each in zip(back.y, back.flown, strict=True)} == pairs
    rollouts = np.concatenate([dataset.unsafe, dataset.safe])
    for each in dataset.recipe["flown"]:
        about = FlownManoeuvre(*(each[key] for key in FlownManoeuvre.__annotations__))
        assert (rollouts[each["rollout"]].tobytes(), about) in pairs


def test_unlabelled_flights_fail_by_the_limits_and_a_label_wins() -> None:
    y = doublets(100, 3)
    by_limits = LabelledFlights.of(y, dt=DT, channels=DICTIONARY, limits=LIMITS)
    label = np.full(100, UNLABELLED)
    label[:2] = [30, -1]
    checked = LabelledFlights.of(y, dt=DT, channels=DICTIONARY, limits=LIMITS, fail_index=label)
    assert checked.fail_index[0] == 30
    assert checked.fail_index[1] == 81
    assert checked.fail_index[2:].tolist() == by_limits.fail_index[2:].tolist()
    with pytest.raises(RolloutsError, match="for 98 of 100 flights"):
        LabelledFlights.of(y, dt=DT, channels=DICTIONARY, fail_index=label)


def test_failures_of_few_flights_and_those_that_come_too_late_are_found() -> None:
    assert any("flown failures are of" in text for text in mixed().findings)
    y, label = doublets(100, 3), np.full(100, -1)
    label[:10] = 75
    y[10:, 70:] = np.nan
    label[10:20] = 30
    checked = LabelledFlights.of(y, dt=DT, channels=DICTIONARY, fail_index=label)
    assert any("10 flights" in text and "after 3.45 s" in text for text in checked.findings)


# --- REST -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with api(tmp_path_factory.mktemp("data")) as client:
        yield client


def add(client: TestClient, *fields: tuple[str, Any]) -> dict[str, Any]:
    """The ended job that adds these rollouts: texts, and files by name and content."""
    form = [(name, (None, value) if isinstance(value, str) else value) for name, value in fields]
    return finished(client, client.post(DATASETS, files=form))


@pytest.fixture(scope="module")
def recordings(client: TestClient) -> list[str]:
    """Ids of flights with three doublets each; they map as soon as a dataset has their channels."""
    files = [flown(*FLOWN[k : k + N_EACH]) for k in range(0, len(FLOWN), N_EACH)]
    return [uploaded(client, file, name=f"flight {k}.csv")["id"] for k, file in enumerate(files)]


@pytest.fixture(scope="module")
def simulated(client: TestClient) -> dict[str, Any]:
    job = add(client, ("file", ("pitch.npz", npz(doublets(1200, 1)))), *LIMIT.items())
    assert job["status"] == "done", job["error"]
    return client.get(f"{DATASETS}/{job['result']['dataset']}").json()


@pytest.fixture(scope="module")
def mixture(client: TestClient, recordings: list[str], simulated: dict[str, Any]) -> dict[str, Any]:
    given = [("recording", each) for each in recordings]
    job = add(client, *given, ("dataset", simulated["id"]), ("name", "mixture"))
    assert job["status"] == "done", job["error"]
    return client.get(f"{DATASETS}/{job['result']['dataset']}").json() | {"job": job}


@pytest.fixture(scope="module")
def monitor(client: TestClient, mixture: dict[str, Any]) -> dict[str, Any]:
    order = {"dataset": mixture["id"], "t_early": 0.25, "epsilon": 0.1, "guarantee": "average"}
    method = {"predictor": {"kind": "linear"}, "score": {"kind": "nearest_neighbor"}}
    job = finished(client, client.post(MONITORS, json=order | method))
    assert job["status"] == "done", job["error"]
    return client.get(f"{MONITORS}/{job['result']['monitor']}").json()


def flown_rollouts(
    client: TestClient, dataset: dict[str, Any]
) -> list[tuple[dict[str, Any], Array]]:
    stored = store_of(client).datasets.get(dataset["id"])
    rollouts = np.concatenate([stored.unsafe, stored.safe])
    return [(each, rollouts[each["rollout"]]) for each in dataset["recipe"]["flown"]]


def test_recordings_join_a_dataset_with_its_channels_limits_and_length(
    client: TestClient, mixture: dict[str, Any], simulated: dict[str, Any]
) -> None:
    rows = flown_rollouts(client, mixture)
    assert len(rows) == len(FLOWN)
    failing = sum(map(fails, FLOWN))
    assert mixture["n_unsafe"] - simulated["n_unsafe"] == pytest.approx(failing, abs=2)
    assert mixture["n_unsafe"] + mixture["n_safe"] == len(rows) + 1200
    for key in ("dt", "n_samples", "limits", "dictionary"):
        assert mixture[key] == simulated[key]
    assert mixture["findings"] == mixture["job"]["result"]["findings"]
    assert not any("disagree" in text for text in mixture["findings"])


def test_each_flown_rollout_names_its_recording_and_interval(
    client: TestClient, mixture: dict[str, Any], recordings: list[str]
) -> None:
    for each, y in flown_rollouts(client, mixture):
        info = client.get(f"{RECORDINGS}/{each['recording']}").json()
        assert info["id"] in recordings
        assert (each["flight"], each["digest"]) == (info["name"], info["digest"])
        number = int(each["manoeuvre"].split()[-1]) - 1
        k = N_EACH * recordings.index(info["id"]) + number
        begin = 3.0 + number * (3.0 + 81 * DT)  # of the doublet in the recording
        assert begin - 0.6 < each["start"] < begin + 0.7
        shift = round((each["start"] - begin) / DT)
        known = np.isfinite(y[:, 2])
        expected = FLOWN[k][max(shift, 0) :][: known.sum() - max(-shift, 0)]
        shown = y[known][max(-shift, 0) :][: len(expected)]
        absolute = list(DICTIONARY.absolute)
        np.testing.assert_allclose(
            shown[:, absolute], expected[: len(shown)][:, absolute], atol=1e-9
        )


def test_its_samples_are_those_that_scoring_sees(
    client: TestClient, mixture: dict[str, Any], monitor: dict[str, Any]
) -> None:
    flight = mixture["recipe"]["flown"][0]
    store, recordings = store_of(client), client.app.state.recordings  # pyright: ignore
    recorded = recordings.mapped(flight["recording"], None)
    plain = recordings.proposed_for(flight["recording"], DICTIONARY).mapping
    from app.telemetry.mapping.mapping import Mapping

    recorded = recordings.mapped(flight["recording"], Mapping.from_plain(plain)).scorable()
    seen = RecordedFlight.of(store.monitors.get(monitor["id"]), recorded)
    (begin, stop, trim) = seen.manoeuvres[int(flight["manoeuvre"].split()[-1]) - 1]
    (y,) = [y for each, y in flown_rollouts(client, mixture) if each == flight]
    t = seen.recording.t
    first = int(np.searchsorted(t, flight["start"] - 1e-6))
    known = int(np.isfinite(y).all(axis=1).sum())
    trim = np.where([c in DICTIONARY.absolute for c in range(4)], 0.0, trim)
    np.testing.assert_array_equal(y[:known], seen.recording.y[first : first + known] - trim)
    assert first < begin < stop


def test_recordings_alone_are_a_dataset(client: TestClient, recordings: list[str]) -> None:
    given = [("recording", "\n".join(recordings)), ("dictionary", TEXT), *LIMIT.items()]
    preview = client.post(f"{DATASETS}/preview", files=[(k, (None, v)) for k, v in given]).json()
    assert (preview["n_flights"], preview["n_flown"], preview["n_failing"]) == (90, 90, None)
    job = add(client, *given)
    assert job["status"] == "done", job["error"]
    info = client.get(f"{DATASETS}/{job['result']['dataset']}").json()
    assert len(info["recipe"]["flown"]) == info["n_unsafe"] + info["n_safe"] == len(FLOWN)
    assert info["n_unsafe"] == pytest.approx(sum(map(fails, FLOWN)), abs=2)
    assert any("too few for epsilon" in text for text in info["findings"])


def test_recordings_join_files(client: TestClient, recordings: list[str]) -> None:
    given = [("recording", each) for each in recordings[:4]]
    job = add(client, ("file", ("a.npz", npz(doublets(200, 1)))), *given, *LIMIT.items())
    assert job["status"] == "done", job["error"]
    info = client.get(f"{DATASETS}/{job['result']['dataset']}").json()
    assert len(info["recipe"]["flown"]) == 4 * N_EACH
    assert info["n_unsafe"] + info["n_safe"] == 200 + 4 * N_EACH


def test_a_label_wins_over_the_limits_and_disagreements_are_counted(
    client: TestClient, simulated: dict[str, Any]
) -> None:
    calm = [y for y in doublets(60, 70) if not fails(y)][:3]
    wild = [y for y in doublets(60, 71) if fails(y)][:1]
    one = uploaded(client, flown(*calm), name="stalled.csv")["id"]
    other = uploaded(client, flown(*wild), name="calm.csv")["id"]
    at = 3.0 + 81 * DT + 3.0 + 2.0  # in the second doublet
    labels = [("label", f"{one}={at}"), ("label", f"{other}=safe")]
    given = [("recording", one), ("recording", other), ("dataset", simulated["id"])]
    job = add(client, *given, *labels)
    assert job["status"] == "done", job["error"]
    info = client.get(f"{DATASETS}/{job['result']['dataset']}").json()
    assert any("disagree in 2 of 4 flights" in text for text in info["findings"])
    failing = [each for each in info["recipe"]["flown"] if each["rollout"] < info["n_unsafe"]]
    assert [(each["recording"], each["manoeuvre"]) for each in failing] == [(one, "manoeuvre 2")]
    rollout = client.get(f"{DATASETS}/{info['id']}/rollouts/{failing[0]['rollout']}").json()
    assert failing[0]["start"] + rollout["fail_index"] * DT == pytest.approx(at, abs=DT)
    answer = add(client, *given, ("label", f"{one}=1.0"))
    assert "in none of its manoeuvres" in answer["error"]


def test_the_manoeuvres_of_a_scoring_are_used_as_marked(
    client: TestClient, monitor: dict[str, Any], simulated: dict[str, Any]
) -> None:
    calm = [y for y in doublets(60, 72) if not fails(y)][:2]
    recording = uploaded(client, flown(*calm, start=100.0), name="marked.csv")["id"]
    path = f"{RECORDINGS}/{recording}"
    query = {"monitor": monitor["id"]}
    mapping = client.get(f"{path}/mapping", params=query)
    if mapping.status_code != 200:
        mapping = client.get(path, params=query)
    body = {"mapping": mapping.json()["mapping"]}
    assert client.put(f"{path}/mapping", json=body, params=query).status_code == 200
    marked = [{"start": 102.8, "end": 106.8, "name": "second try"}]
    order = {"monitor": monitor["id"], "manoeuvres": marked}
    scoring = client.post(f"{path}/scorings", json=order).json()
    given = ("recording", f"{recording}/{scoring['id']}"), ("dataset", simulated["id"])
    job = add(client, *given)
    assert job["status"] == "done", job["error"]
    info = client.get(f"{DATASETS}/{job['result']['dataset']}").json()
    (row, y), *more = flown_rollouts(client, info)
    assert not more
    assert (row["manoeuvre"], row["start"]) == ("second try", pytest.approx(102.8))
    trim = scoring["manoeuvres"][0]["trim"]
    frames = client.get(f"{path}/scorings/{scoring['id']}/assessments").json()["frames"]
    k = next(k for k, frame in enumerate(frames) if abs(frame["t"] - 102.8) < 1e-6)
    np.testing.assert_array_equal(y, [frame["y"] for frame in frames[k : k + 81]])
    assert trim[0] == 0.0


def test_a_calibration_says_how_many_of_each_it_holds(
    client: TestClient, mixture: dict[str, Any], monitor: dict[str, Any]
) -> None:
    path = f"{MONITORS}/{monitor['id']}"
    evaluation = client.get(f"{path}/evaluation").json()
    counts = evaluation["calibrated_on"]
    assert counts["simulated"] + counts["flown"] == monitor["n_unsafe"]
    assert 0 < counts["flights"] <= counts["flown"]
    words = f"{counts['simulated']} simulated and {counts['flown']} flown failures"
    assert words in counts["words"]
    assert "not for either kind alone" in counts["words"]
    used = evaluation["flown"]
    assert len(used) == N_FLIGHTS
    assert sum(each["manoeuvres"] for each in used) == len(FLOWN)
    parts = {each["part"] for each in used}
    assert parts == set(evaluation["flights"])
    of = [each for each in used if each["part"] == "train and calibrate"]
    assert sum(each["failures"] for each in of) == counts["flown"]
    origins = {row["name"]: row for row in evaluation["groups"] if row["rule"] == "origin"}
    assert origins["simulated"]["n_unsafe"] + origins["flown"]["n_unsafe"] == evaluation["n_unsafe"]
    page = client.get(f"{path}/certificate").text
    assert words in page
    assert all(each["flight"] in page for each in used)
    assert mixture["recipe"]["flown"]


def copied(client: TestClient, recording: str) -> bytes:
    """The same flight by another clock, rounded, with sideslip in degrees and other separators."""
    file = client.app.state.recordings.files.file(recording)  # pyright: ignore
    head, *lines = file.read_text().splitlines()
    rows = np.array([[float(value) for value in line.split(",")] for line in lines])
    rows[:, 0] += 50.0
    rows[:, 1] = np.rad2deg(rows[:, 1])
    text = "\n".join(";".join(f"{value:.7g}" for value in row) for row in rows)
    return f"{head.replace(',', ';').replace('alpha_rad', 'alpha_deg')}\n{text}\n".encode()


def test_a_flight_that_trained_the_monitor_is_no_evidence_when_scored(
    client: TestClient, monitor: dict[str, Any]
) -> None:
    path, query = f"{MONITORS}/{monitor['id']}", {"monitor": monitor["id"]}
    used = client.get(f"{path}/evaluation").json()["flown"]
    by_part = {each["part"]: each for each in used}
    words = {"train and calibrate": "calibrated the monitor", "certify": "certified the monitor"}
    for part, text in words.items():
        recording = f"{RECORDINGS}/{by_part[part]['recording']}"
        shown = client.get(recording, params=query).json()
        body = {"mapping": shown["mapping"]}
        assert client.put(f"{recording}/mapping", json=body, params=query).status_code == 200
        scoring = client.post(f"{recording}/scorings", json=query).json()
        said = f"among those that {text}"
        assert said in scoring["notes"][0]
        assert all(said in each["guarantee"] for each in scoring["manoeuvres"])
        assert said in client.get(f"{recording}/scorings/{scoring['id']}/report").text
        copy = uploaded(client, copied(client, by_part[part]["recording"]), name="copy.csv")["id"]
        path = f"{RECORDINGS}/{copy}"
        body = {"mapping": client.get(path, params=query).json()["mapping"]}
        assert client.put(f"{path}/mapping", json=body, params=query).status_code == 200
        scoring = client.post(f"{path}/scorings", json=query).json()
        assert f"{said}, by its samples" in scoring["notes"][0]
        assert all(said in each["guarantee"] for each in scoring["manoeuvres"])
    fresh = uploaded(client, flown(*doublets(2, 90)), name="fresh.csv")["id"]
    recording = f"{RECORDINGS}/{fresh}"
    body = {"mapping": client.get(recording, params=query).json()["mapping"]}
    client.put(f"{recording}/mapping", json=body, params=query)
    scoring = client.post(f"{recording}/scorings", json=query).json()
    assert not any("among those" in note for note in scoring["notes"])
    assert not any("among those" in each["guarantee"] for each in scoring["manoeuvres"])


def test_other_work_on_a_mixture_says_that_it_needs_a_recipe(
    client: TestClient, mixture: dict[str, Any], monitor: dict[str, Any]
) -> None:
    answer = client.post("/api/v1/studies", json={"dataset": mixture["id"]})
    assert "was not simulated here" in problem(answer, 422)
    answer = client.post(f"{MONITORS}/{monitor['id']}/epsilon", json={"most_missed": 0.1})
    assert "was not simulated here" in problem(answer, 422)


def test_a_recording_can_be_deleted_without_its_rollouts(
    client: TestClient, simulated: dict[str, Any]
) -> None:
    recording = uploaded(client, flown(*doublets(6, 95)), name="gone.csv")["id"]
    job = add(client, ("recording", recording), ("dataset", simulated["id"]))
    path = f"{DATASETS}/{job['result']['dataset']}"
    before = client.get(path).json()
    assert client.delete(f"{RECORDINGS}/{recording}").status_code == 204
    assert client.get(path).json() == before
    assert store_of(client).datasets.get(before["id"]).flights().is_flown.sum() == 6


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ([("dataset", "{dataset}")], "there is no file"),
        ([("recording", "{id}"), ("dataset", "{dataset}"), ("limit", "Nz=..3")], "has its own"),
        ([("recording", "{id}"), ("label", "other=safe"), ("limit", "Nz=..3")], "of no flight"),
        (
            [("recording", "{id}"), ("label", "{id}=late"), ("limit", "Nz=..3")],
            "'late' of flight 0.csv",
        ),
    ],
)
def test_recordings_that_cannot_be_used_are_refused(
    fields: list[tuple[str, str]],
    words: str,
    client: TestClient,
    recordings: list[str],
    simulated: dict[str, Any],
) -> None:
    known = {"id": recordings[0], "dataset": simulated["id"]}
    form = [(name, (None, value.format(**known))) for name, value in fields]
    for path in (DATASETS, f"{DATASETS}/preview"):
        assert words in problem(client.post(path, files=form), 422)


@pytest.mark.parametrize(
    "fields",
    [
        [("recording", "nothing")],
        [("recording", "{id}/nothing")],
        [("recording", "{id}"), ("dataset", "nothing")],
    ],
)
def test_unknown_ids_of_rollouts_are_refused_at_once(
    fields: list[tuple[str, str]], client: TestClient, recordings: list[str]
) -> None:
    form = [(name, (None, value.format(id=recordings[0]))) for name, value in fields]
    for path in (DATASETS, f"{DATASETS}/preview"):
        assert "nothing" in problem(client.post(path, files=form), 404)


def test_a_recording_without_a_channel_or_a_manoeuvre_is_named(
    client: TestClient, simulated: dict[str, Any]
) -> None:
    y = doublets(1, 5)[0]
    short = csv_of(y[:, :3], DT, head="t_s,alpha_rad,q (rad/s),Nz_g")
    recording = uploaded(client, short, name="no elevator.csv")["id"]
    job = add(client, ("recording", recording), ("dataset", simulated["id"]))
    assert "no elevator.csv: it has no delta_e" in job["error"]
    still = csv_of(np.resize(y[:8], (200, 4)), DT, head="t_s,alpha_rad,q (rad/s),Nz_g,delta_e_rad")
    recording = uploaded(client, still, name="still.csv")["id"]
    job = add(client, ("recording", recording), ("dataset", simulated["id"]))
    assert "still.csv shows no manoeuvre" in job["error"]


# --- command line ---------------------------------------------------------------------------------


def test_the_command_line_trains_on_recordings_beside_rollouts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "pitch.npz").write_bytes(npz(doublets(600, 1)))
    files = []
    for k in range(0, 60, N_EACH):
        files.append(tmp_path / f"flight {k}.csv")
        files[-1].write_bytes(flown(*FLOWN[k : k + N_EACH]))
    out = tmp_path / "mixed.fwm"
    limits = ("--limit", LIMIT["limit"], "--predictor", "linear", "--score", "nearest_neighbor")
    method = (*limits, "--guarantee", "average", "--epsilon", "0.2", "--json", "--out", str(out))
    source = "--rollouts", str(tmp_path / "pitch.npz"), "--recordings", *map(str, files)
    assert main(["train", *source, *method, "--data-dir", str(tmp_path)]) == 0
    facts = json.loads(capsys.readouterr().out)
    counts = facts["evaluation"]["calibrated_on"]
    assert counts["simulated"] > 0
    assert counts["flown"] > 0
    monitor = load(out)
    with closing(open_store(tmp_path / "forewarn.db", recover=False)) as store:
        assert store.datasets.get(facts["dataset_id"]).digest() == monitor.dataset_digest
    assert len(monitor.alphas) == counts["simulated"] + counts["flown"]
    used = next(each for each in facts["evaluation"]["flown"] if each["part"] != "certify")
    name = str(tmp_path / used["flight"])
    assert main(["score", str(out), name, "--out", str(tmp_path / "scored")]) == 0
    assert "This flight is among those that" in capsys.readouterr().out


def test_the_command_line_trains_on_recordings_beside_simulated_ones(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = []
    for seed in range(8):
        files.append(str(tmp_path / f"{seed}.csv"))
        assert main(["sample-flight", "--seed", str(seed), "--out", files[-1]]) == 0
    out = ["--out", str(tmp_path / "m.fwm")]
    method = ["--predictor", "linear", "--score", "nearest_neighbor", "--guarantee", "average"]
    size = ["--n-unsafe", "60", "--epsilon", "0.2"]
    given = ["--rollouts", "simulated", "--recordings", *files]
    assert main(["train", *given, *method, *size, *out]) == 0
    text = capsys.readouterr().out
    assert "simulated and" in text
    assert "the promise is for flights drawn like this mixture" in text
    assert load(tmp_path / "m.fwm").dataset_recipe["aircraft"]


def sample_flights(folder: Path) -> list[str]:
    """Files of a safe and of a failing sample flight."""
    files = [str(folder / f"{outcome}.csv") for outcome in ("safe", "unsafe")]
    for file in files:
        assert main(["sample-flight", "--outcome", Path(file).stem, "--out", file]) == 0
    return files


def beside_simulated(files: list[str]) -> RolloutSources:
    """Beside the rollouts of the recipe, which last 6 s."""
    base = collect(DatasetRecipe(n_unsafe=10, n_obs=10))
    return RolloutSources.beside(base, recorded_files([*map(Path, files)], None, []))


def test_sample_flights_join_whatever_their_outcome(tmp_path: Path) -> None:
    dataset, findings = beside_simulated(sample_flights(tmp_path)).to_dataset()
    assert sorted(each["flight"] for each in dataset.recipe["flown"]) == ["safe.csv", "unsafe.csv"]
    assert not any("left out" in text for text in findings)


def test_a_flight_left_out_is_named(tmp_path: Path) -> None:
    files = sample_flights(tmp_path)
    safe = Path(files[0])
    rows = safe.read_text().splitlines()
    safe.write_text("\n".join(rows[: round(10.5 / 0.05)]))
    _, findings = beside_simulated(files).to_dataset()
    (left_out,) = (text for text in findings if "left out" in text)
    assert "1 safe flight " in left_out
    assert "manoeuvre 1 of safe.csv" in left_out
    assert "6 s" in left_out


def test_the_command_line_trains_on_recordings_beside_an_own_simulator(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [tmp_path / f"flight {k}.csv" for k in range(10)]
    for k, file in enumerate(files):
        file.write_bytes(flown(*FLOWN[3 * k : 3 * k + 3]))
    source = ["--simulator", "tests.support.own_pitch:pitch", "--n-unsafe", "60"]
    recordings = ["--recordings", *map(str, files), "--label", f"{files[0].name}=safe"]
    out = ["--json", "--out", str(tmp_path / "m.fwm")]
    method = ["--predictor", "linear", "--score", "nearest_neighbor", "--guarantee", "average"]
    limit = ["--limit", LIMIT["limit"], "--epsilon", "0.2"]
    assert main(["train", *source, *recordings, *method, *limit, *out]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["evaluation"]["calibrated_on"]["simulated"] > 0
    used = {each["flight"]: each for each in facts["evaluation"]["flown"]}
    assert len(used) == 10
    assert used[files[0].name]["failures"] == 0


def test_options_of_recordings_need_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", "--label", "a.csv=safe", "--out", str(tmp_path / "m.fwm")]) == 1
    assert "--label was given without" in capsys.readouterr().err


def test_values_that_no_aircraft_reaches_are_told_from_missing_ones(tmp_path: Path, capsys) -> None:
    path, t = tmp_path / "f.csv", 0.05 * np.arange(400)
    y = np.column_stack([np.sin(t), 600 + np.sin(t), *4 * [0.1 * np.sin(2 * t)]])
    path.write_bytes(csv_of(y, 0.05, head=",".join(["t", *LATERAL.keys])))
    channels = {key: {"signal": key, "unit": LATERAL.by_key[key].unit} for key in LATERAL.keys}
    mapping = tmp_path / "mapping.json"
    mapping.write_text(json.dumps({"channels": channels, "times": {"": {"signal": "t"}}}))
    words = ["train", "--recordings", path, "--mapping", mapping, "--limit", "Ny=0.5"]
    assert main([*map(str, words), "--out", str(tmp_path / "a.fwm")]) == 1
    said = capsys.readouterr().err
    assert "it has no" not in said
    assert "p exceeds the plausible 1146 deg/s in 400 rows" in said
    assert "check its unit" in said
