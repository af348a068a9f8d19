"""A recording is scored by a monitor set as the flight was shown: by the monitor in use."""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.cli import main
from app.store.monitors import MonitorInfo
from core.channels import BY_KEY, KEYS
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.monitor_set import MonitorCase, MonitorSet
from core.planned_test.collection import collect
from tests.app.flights.test_flight_recordings import DT, FLIGHTS, RECORDINGS, Range
from tests.app.flights.test_flights import RECIPE, monitor
from tests.app.flights.test_one_verdict import calm, with_ny
from tests.support.api import api
from tests.support.oscillator import Array
from tests.support.recorded import HEAD, csv_of, uploaded

Y = np.concatenate([calm(), with_ny((70, 0.7))])
N = len(Y)
T = DT * np.arange(N)
Sent = dict[int, float | None]


@cache
def fast_monitor() -> Monitor:
    return train(collect(replace(RECIPE, seed=4)), MonitorRecipe(epsilon=0.2))


class Sets(Range):
    """A server with a set of two monitors."""

    def __init__(self, *about: Any) -> None:
        super().__init__(*about)
        ids = [self.store.monitors.add(each, name).id for each, name in self.known]
        info = self.store.monitors.info
        cases: tuple[MonitorCase[MonitorInfo], ...] = (
            MonitorCase("slow", {"mach": (None, 0.8)}, info(ids[0])),
            MonitorCase("fast", {"mach": (0.8, 1.2)}, info(ids[1])),
        )
        self.set_id = self.store.monitor_sets.add("doublet", MonitorSet(cases), "Ann").id

    @property
    def known(self) -> list[tuple[Any, str]]:
        return [(monitor(), "slow one"), (fast_monitor(), "fast one")]

    def flown_by_set(self, y: Array, sent: Sent, trim: str) -> str:
        body = {
            "source": {"kind": "live", "trim": trim},
            "monitor_set": self.set_id,
            "name": "by set",
        }
        flight = self.client.post(FLIGHTS, json=body).raise_for_status().json()["id"]
        # ten at a time, all with or all without the condition
        for (_, has_mach), batch in groupby(range(len(y)), lambda k: (k // 10, k in sent)):
            ks = [*batch]
            values = dict(zip(KEYS, y[ks].T.tolist(), strict=True))
            mach = {"mach": [sent[k] for k in ks]} if has_mach else {}
            path = f"{FLIGHTS}/{flight}/samples"
            body = {"t": T[ks].tolist(), **values, **mach}
            self.client.post(path, json=body).raise_for_status()
        self.end(flight)
        return flight

    def scored(self, recording: str, **request: Any) -> tuple[dict[str, Any], list[dict[str, Any]]]:
        path = f"{RECORDINGS}/{recording}/scorings"
        answer = self.client.post(path, json={"monitor_set": self.set_id} | request)
        assert answer.status_code == 201, answer.text
        scoring = answer.json()
        path = f"{path}/{scoring['id']}/assessments"
        return scoring, self.client.get(path, params={"last": 999}).json()["frames"]

    def file_of(self, y: Array, sent: Sent) -> str:
        mach = [[np.nan if (m := sent.get(k)) is None else m] for k in range(len(y))]
        file = uploaded(self.client, csv_of(np.hstack([y, mach]), T[1], head=f"{HEAD},mach"))
        signals = {key: each["signal"] for key, each in file["mapping"]["channels"].items()}
        channels = {key: {"signal": signals[key], "unit": BY_KEY[key].unit} for key in KEYS}
        mapping = {"channels": channels, "times": file["mapping"]["times"]}
        path = f"{RECORDINGS}/{file['id']}/mapping"
        self.client.put(path, json=mapping).raise_for_status()
        return file["id"]


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Sets]:
    root = tmp_path_factory.mktemp("data")
    with api(root) as client:
        yield Sets(client, root)


WAYS: dict[str, Sent] = {
    "with_gaps": {k: 0.6 for k in range(N) if not 50 <= k < 90}
    | dict.fromkeys(range(150, 190), 0.9)
    | {200: 1.3, 205: None},
    "one_condition": dict.fromkeys(range(N), 0.6),
    "a_change": {k: 0.6 if k < 60 else 0.9 for k in range(N)},
}


@pytest.mark.parametrize("trim", ["none", "detected"])
@pytest.mark.parametrize("way", WAYS)
def test_a_scoring_by_the_set_is_what_the_flight_showed(sets: Sets, way: str, trim: str) -> None:
    flight = sets.flown_by_set(Y, WAYS[way], trim)
    path = f"{FLIGHTS}/{flight}/assessments"
    shown = sets.client.get(path, params={"last": 999}).json()["frames"]
    recording = sets.recording_of(flight)["id"]
    scoring, frames = sets.scored(recording)
    assert [each["t"] for each in frames] == [each["t"] for each in shown]
    for was, again in zip(shown, frames, strict=True):
        assert was["p_value"] in (again["p_value"], again["withdrawn"]), was["t"]
        if "condition" not in was["reason"] and was["cause"] == "not_applicable":
            assert again["reason"] == was["reason"], was["t"]
        if again["p_value"] is not None:
            assert was["alert"] == again["alert"], was["t"]
    assert any(each["p_value"] is not None for each in frames)
    names = {"slow": "slow one", "fast": "fast one", "no monitor": ""}
    for manoeuvre in scoring["manoeuvres"]:
        assert manoeuvre["monitor"] == names[manoeuvre["name"].rsplit(", ", 1)[1]]
    assert {each["monitor_name"] for each in scoring["limits_in_force"]} <= {*names.values(), ""}
    assert scoring["monitor_name"] == "monitor set doublet"
    report = f"{RECORDINGS}/{recording}/scorings/{scoring['id']}/report"
    text = sets.client.get(report).raise_for_status().text
    assert all(manoeuvre["monitor"] in text for manoeuvre in scoring["manoeuvres"])


def test_a_scoring_by_the_set_has_the_warnings_of_each_of_its_monitors(
    sets: Sets, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = sets.file_of(Y, WAYS["a_change"])
    scoring, _ = sets.scored(recording)
    told = lambda evaluation, epsilon, **_: [f"at {epsilon:g}"]  # noqa: E731
    monkeypatch.setattr("app.store.monitors.warnings_of", told)
    path = f"{RECORDINGS}/{recording}/scorings/{scoring['id']}"
    assert sets.client.get(path).json()["warnings"] == ["at 0.3", "at 0.2"]


def test_a_file_with_the_condition_is_scored_by_the_set_too(sets: Sets) -> None:
    sent = WAYS["a_change"]
    flight = sets.flown_by_set(Y, sent, "detected")
    _, frames = sets.scored(sets.recording_of(flight)["id"])
    _, of_file = sets.scored(sets.file_of(Y, sent))
    for each, of_flight in zip(
        of_file, frames, strict=True
    ):  # of the file also where not as planned
        assert of_flight["p_value"] in (each["p_value"], each["withdrawn"])


def test_a_condition_that_was_not_recorded_is_declared(sets: Sets) -> None:
    file = sets.file_of(Y, {})
    path = f"{RECORDINGS}/{file}/scorings"
    unknown = sets.client.post(path, json={"monitor_set": sets.set_id})
    made = unknown.raise_for_status().json()
    assert any("Mach number is missing" in note for note in made["notes"])
    assert [each["exceedance"] is not None for each in made["manoeuvres"]] == [False, True]
    assert {each["monitor"] for each in made["manoeuvres"]} == {""}
    scoring, frames = sets.scored(file, condition={"mach": 0.6})
    assert {each["monitor"] for each in scoring["manoeuvres"]} == {"slow one"}
    alone = {"monitor": scoring["monitor"], "epsilon": scoring["epsilon"]}
    alone = sets.client.post(path, json=alone).raise_for_status().json()
    path = f"{path}/{alone['id']}/assessments"
    by_one = sets.client.get(path, params={"last": 999}).json()["frames"]
    assert [each["p_value"] for each in by_one] == [each["p_value"] for each in frames]


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        ({}, "no monitor"),
        ({"monitor": "x", "monitor_set": "y"}, "both a monitor and a monitor_set"),
        ({"monitor_set": "y", "epsilon": 0.1}, "own epsilon"),
        ({"monitor": "x", "condition": {"mach": 0.6}}, "needs a monitor_set"),
    ],
)
def test_a_scoring_is_by_one_monitor_or_by_one_set(
    sets: Sets, request_: dict[str, Any], text: str
) -> None:
    answer = sets.client.post(f"{RECORDINGS}/x/scorings", json=request_)
    assert answer.status_code == 422
    assert text in answer.text


@pytest.fixture
def on_command_line(
    sets: Sets, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """Runs a command on a file of the flight, changing Mach number; returns what it prints."""
    monkeypatch.setenv("FOREWARN_DATA_DIR", str(sets.root))
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str, sent: Sent | None = None, code: int = 0) -> str:
        mach = [[np.nan if (m := (sent or {}).get(k)) is None else m] for k in range(N)]
        Path("flight.csv").write_bytes(csv_of(np.hstack([Y, mach]), T[1], head=f"{HEAD},mach"))
        names = HEAD.split(",")[1:]
        channels = {
            key: {"signal": name, "unit": BY_KEY[key].unit}
            for key, name in zip(KEYS, names, strict=True)
        }
        mapping = {"channels": channels, "times": {"": {"signal": HEAD.split(",")[0], "unit": "s"}}}
        Path("mapping.json").write_text(json.dumps(mapping))
        assert main([*arguments, "--mapping", "mapping.json"]) == code
        printed = capsys.readouterr()
        return printed.err if code else printed.out

    return run


def file_of_set(sets: Sets) -> str:
    """A set as a file, with its monitors beside it."""
    for each, name in sets.known:
        each.save(Path(f"{name}.fwm"))
    cases = [
        {"name": "slow", "ranges": {"mach": [None, 0.8]}, "monitor": "slow one.fwm"},
        {"name": "fast", "ranges": {"mach": [0.8, 1.2]}, "monitor": "fast one.fwm"},
    ]
    Path("set.json").write_text(json.dumps({"name": "doublet", "cases": cases}))
    return "set.json"


def without_ids(manoeuvre: dict[str, Any]) -> dict[str, Any]:
    in_force = [{**each, "monitor": ""} for each in manoeuvre["limits_in_force"]]
    return manoeuvre | {"limits_in_force": in_force}


@pytest.mark.parametrize("way", ["a_change", "one_condition"])
@pytest.mark.parametrize("by", ["name", "file"])
def test_the_command_line_scores_by_a_set_as_the_server_does(
    sets: Sets, on_command_line: Callable[..., str], by: str, way: str
) -> None:
    scoring, _ = sets.scored(sets.file_of(Y, WAYS[way]))
    given = "doublet" if by == "name" else file_of_set(sets)
    arguments = ("score", "flight.csv", "--monitor-set", given, "--accept-useless")
    (result,) = json.loads(on_command_line(*arguments, "--json", sent=WAYS[way]))["scorings"]
    assert len(result["manoeuvres"]) == len(scoring["manoeuvres"])
    for told, known in zip(result["manoeuvres"], scoring["manoeuvres"], strict=True):
        assert without_ids(told) == {key: without_ids(known)[key] for key in told}
    assert result["monitor_set"]["name"] == "doublet"
    text = on_command_line(*arguments, sent=WAYS[way])
    assert "scored by monitor set doublet" in text
    assert all(f"monitor in use     {each['monitor']}" in text for each in scoring["manoeuvres"])


def test_the_command_line_declares_what_was_not_recorded(
    sets: Sets, on_command_line: Callable[..., str]
) -> None:
    arguments = ("--monitor-set", "doublet", "--accept-useless", "--json")
    told = on_command_line("score", *arguments, "--condition", "mach=0.6", "flight.csv")
    (result,) = json.loads(told)["scorings"]
    assert {each["monitor"] for each in result["manoeuvres"]} == {"slow one"}
    told = on_command_line("report", "flight.csv", *arguments, "--condition", "mach=0.9")
    (result,) = json.loads(told)["scorings"]
    assert {each["monitor"] for each in result["manoeuvres"]} == {"fast one"}
    assert "the monitor set doublet" in Path("flight-report.html").read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("score", "m.fwm", "flight.csv", "--monitor-set", "doublet"), "m.fwm were given"),
        (("score", "flight.csv"), "--monitor-set and the file"),
        (("score", "flight.csv", "--monitor-set", "triplet"), "give one of doublet"),
        (("score", "flight.csv", "--monitor-set", "mapping.json"), "it needs a name and cases"),
        (("score", "flight.csv", "--monitor-set", "doublet", "--epsilon", "0.1"), "leave out"),
        (("score", "m.fwm", "flight.csv", "--condition", "mach=0.6"), "give --monitor-set too"),
        (("score-archive", ".", "--monitor-set", "doublet", "-o", "out"), "MONITOR files"),
    ],
)
def test_the_command_line_says_what_a_scoring_by_a_set_needs(
    on_command_line: Callable[..., str], arguments: tuple[str, ...], words: str
) -> None:
    assert words in on_command_line(*arguments, code=1)
