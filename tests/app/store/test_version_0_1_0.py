"""A database that version 0.1.0 wrote: all of it is there."""

import json
import shutil
import sqlite3
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.recipes.recipes import from_plain
from app.recordings.files import Verified
from app.recordings.samples import digest, open_samples
from app.store.recordings import RememberedMapping
from app.store.store import Store
from core.monitor.assessment import STATES
from core.planned_test.collection import DatasetRecipe, collect
from tests.support.places import DATA
from tests.support.stored import opened

WRITTEN = DATA / "version_0_1_0"
ANSWERS: dict[str, Any] = json.loads((WRITTEN / "answers.json").read_text())
MONITOR, FLIGHT, RECORDING = (
    next(key.split("/")[1] for key in ANSWERS if key.startswith(kind))
    for kind in ("monitors", "flights", "recordings")
)
RENAMED = {
    "recording": "recording_id",
    "monitor": "monitor_id",
    "order": "request",
    "stretches": "manoeuvres",
    "crossing": "exceedance",
    "outside": "outside_exceedances",
    "spans": "faults",
    "offset": "bias",
    "guesses": "rationales",
}
"""Keys, however deep, by the words of today."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return Path(shutil.copy(WRITTEN / "data" / "forewarn.db", tmp_path))


@pytest.fixture
def store(path: Path) -> Iterator[Store]:
    with opened(path) as store:
        yield store


def in_the_words_of_today(plain: Any) -> Any:
    if isinstance(plain, dict):
        named = {RENAMED.get(key, key): in_the_words_of_today(v) for key, v in plain.items()}
        named |= {"trim": "trim_segment"} if plain.get("trim") == "lead_in" else {}
        return named | ({"manoeuvres": "entire"} if plain.get("manoeuvres") == "whole" else {})
    return [in_the_words_of_today(v) for v in plain] if isinstance(plain, list) else plain


def stored_fields(answer: dict[str, Any], entry: dict[str, Any]) -> dict[str, Any]:
    """What REST answered, by the names of the entry's fields."""
    named = in_the_words_of_today(answer)
    return {key: named[key] for key in entry if key in named}


def assert_answers(entry: Any, answer: dict[str, Any], *others: str) -> None:
    """The entry is what was answered; others: its fields that no answer had."""
    plain = json.loads(json.dumps(asdict(entry)))
    expected = stored_fields(answer, plain)
    assert plain.keys() - expected.keys() == set(others)
    assert {key: plain[key] for key in expected} == expected


def test_dataset_and_monitor_are_those_that_were_trained(store: Store) -> None:
    answer = ANSWERS[f"monitors/{MONITOR}"]
    info = store.monitors.info(MONITOR)
    assert_answers(info, answer, "specification", "missed", "quiet", "warnings", "dictionary")
    assert info.dictionary is None
    assert info.specification == info.dataset_recipe["specification"]
    assert store.datasets.get(answer["dataset_id"]).digest() == answer["dataset_digest"]
    assert store.monitors.evaluation(MONITOR) == ANSWERS[f"monitors/{MONITOR}/evaluation"]


def test_the_recipe_of_a_dataset_simulates_the_same_bits(store: Store) -> None:
    stored = store.datasets.get(ANSWERS[f"monitors/{MONITOR}"]["dataset_id"])
    assert "imperfections" not in stored.recipe
    again = collect(from_plain(DatasetRecipe(), stored.recipe))
    assert again.digest() == stored.digest()


def test_the_monitor_gives_the_p_values_that_were_flown(store: Store) -> None:
    source = store.flights.info(FLIGHT).source
    y, _, _ = store.datasets.rollout(source["dataset"], source["outcome"], source["rollout"])
    frames = ANSWERS[f"flights/{FLIGHT}/assessments"]["frames"][: len(y)]
    flown = [np.nan if frame["p_value"] is None else frame["p_value"] for frame in frames]
    assert np.isfinite(flown).any()
    np.testing.assert_array_equal(store.monitors.get(MONITOR).p_values(y), flown)


def test_every_sample_and_alarm_of_the_flight_is_there(store: Store) -> None:
    answer = ANSWERS[f"flights/{FLIGHT}"]
    named = answer["source"] | {"name": answer["name"]}
    flown = answer | {"source": named, "lost": 0}
    new = {"exceeded_t", "exceedances", "keep", "limits_held", "recording", "recording_id"}
    new |= {"summary", "journal_digest", "end_reason"}
    assert_answers(store.flights.info(FLIGHT), flown, *new)
    stored = store.flights.assessments(FLIGHT)
    frames = ANSWERS[f"flights/{FLIGHT}/assessments"]["frames"]
    assert len(stored) == len(frames) == 121
    for name in ("seq", "t", "y", "p_value", "y_hat"):
        expected = np.array([frame[name] for frame in frames], float)
        np.testing.assert_array_equal(getattr(stored, name), expected)
    assert [STATES[code].value for code in stored.state] == [frame["state"] for frame in frames]
    assert stored.alert.tolist() == [bool(frame["alert"]) for frame in frames]
    assert list(stored.reasons) == [frame["reason"] for frame in frames]
    alarms = ANSWERS[f"flights/{FLIGHT}/alarms"]
    for alarm, answered in zip(store.alarms.of(FLIGHT), alarms, strict=True):
        of_its_own = "kind", "level", "exceedance", "reason", "stored", "cause"
        of_its_own += "channels", "arrived", "manoeuvre"
        assert_answers(alarm, answered | {"id": alarm.id}, *of_its_own)
        assert (alarm.kind, alarm.level, alarm.exceedance) == ("risk", "warning", None)


def test_recording_scoring_and_markers_are_there(store: Store) -> None:
    answer = ANSWERS[f"recordings/{RECORDING}"]
    assert_answers(store.recordings.info(RECORDING), answer, "confirmed_over", "keep", "flight_id")
    assert store.recordings.mapped_columns(RECORDING).mapping == in_the_words_of_today(
        answer["mapping"]
    )
    of_its_own = "limits_in_force", "specification", "request_digest", "row_digest"
    scorings = ANSWERS[f"recordings/{RECORDING}/scorings"]
    for info, scored in zip(store.scorings.of(RECORDING), scorings, strict=True):
        assert_answers(info, scored, *of_its_own)
        assert store.scorings.find(RECORDING, info.request_digest) == info
    markers = ANSWERS[f"recordings/{RECORDING}/markers"]
    for marker, answered in zip(store.markers.of(RECORDING), markers, strict=True):
        assert_answers(marker, answered)


def test_the_samples_of_a_scoring_are_those_of_its_digest(store: Store) -> None:
    (info,) = store.scorings.of(RECORDING)
    samples = open_samples(
        WRITTEN / "data" / "recordings" / RECORDING / "scorings", info.id, info.digest, Verified()
    )
    assert digest(samples) == info.digest
    assert (samples["manoeuvre"] == 0).all()


def test_a_remembered_mapping_is_there(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute(
            "INSERT INTO channel_maps VALUES ('a', 'PH-LAB', 'signals', '2026-01-01T00:00:00Z', "
            """'{"channels": {"beta": {"offset": 0.1}}}')"""
        )
    connection.close()
    with opened(path) as store:
        mapping = store.mappings.find("PH-LAB", "signals")
    assert mapping == RememberedMapping("PH-LAB", {"channels": {"beta": {"bias": 0.1}}})
