"""Rows of recordings, mappings, scorings and markers; nothing of them outlives its recording."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from app.store.entries import Marker, RecordingInfo, RememberedMapping
from app.store.repository import InUse, NotFound
from app.store.store import Store
from app.store.tables import channel_maps, markers, recordings, scorings
from core.dataset import Dataset
from core.monitor import Monitor, train
from tests.support.stored import MAPPED, count, keep_recording, opened, scoring


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    with opened(tmp_path / "forewarn.db") as store:
        yield store


@pytest.fixture(scope="module")
def trained(dataset: Dataset) -> Monitor:
    return train(dataset)


def test_a_recording_is_seen_once_its_folder_is_in_its_place(store: Store) -> None:
    store.begin_recording("a", "flight.csv", 3, "d", "csv", None, MAPPED)
    assert store.recordings() == []
    assert store.unseen_recordings() == ["a"]
    with pytest.raises(NotFound):
        store.recording_info("a")
    store.complete_recording("a")
    info = store.recording_info("a")
    assert store.recordings() == [info]
    assert info == RecordingInfo(
        "a", "flight.csv", info.created, 3, "d", "csv", None, 12.5, "proposed", 0
    )
    assert store.mapped_columns("a") == replace(MAPPED, statistics=[[3, 1, 0.0, None, None]])


def test_a_recording_goes_out_of_sight_before_it_goes(store: Store, trained: Monitor) -> None:
    monitor = store.add_monitor(trained, "m").id
    keep_recording(store, "a")
    store.add_scoring(scoring(store, "a", monitor))
    store.add_marker("a", Marker("k", "now", "note", 1.0, None, "gust"))
    store.forget_recording("a")
    assert [info.id for info in store.recordings()] == ["a"]
    store.withdraw_recording("a")
    assert store.recordings() == []
    assert store.unseen_recordings() == ["a"]
    store.delete_monitor(monitor)
    store.forget_recording("a")
    assert [count(store, table) for table in (recordings, scorings, markers)] == [0, 0, 0]


def test_a_recording_that_is_flown_stays(store: Store, trained: Monitor) -> None:
    monitor = store.add_monitor(trained, "m").id
    keep_recording(store, "a")
    kept = store.add_scoring(scoring(store, "a", monitor))
    source = {"kind": "recording", "recording": "a", "scoring": kept.id}
    flight = store.add_flight(source, monitor, 0.1)
    with pytest.raises(InUse, match=f"recording flight.csv is used by running flight.*{flight}"):
        store.withdraw_recording("a")
    with pytest.raises(InUse, match=flight):
        store.delete_scoring("a", kept.id)
    store.end_flight(flight)
    store.delete_scoring("a", kept.id)
    store.withdraw_recording("a")


def test_the_first_of_the_same_bytes_is_named(store: Store) -> None:
    for identity, digest in (("c", "same"), ("b", "other"), ("a", "same")):
        keep_recording(store, identity, digest)
    assert [store.earlier_recording(identity) for identity in "cba"] == [None, None, "c"]


def test_a_mapping_is_remembered_by_aircraft_alone(store: Store) -> None:
    assert store.remembered_mapping("PH-LAB", "new") is None
    for order, (aircraft, signals) in enumerate(
        [("PH-LAB", "old"), ("PH-LAB", "new"), ("D-IFSA", "new")]
    ):
        store.remember_mapping(aircraft, signals, {"channels": {"n": order}})

    def number(aircraft: str | None, signals: str) -> int | None:
        kept = store.remembered_mapping(aircraft, signals)
        return None if kept is None else kept.mapping["channels"]["n"]

    assert number("PH-LAB", "old") == 0
    assert number("PH-LAB", "new") == 1
    assert number("PH-LAB", "never seen") == 1, "the newest of the aircraft"
    assert number("OO-XYZ", "new") is None, "another aircraft may be reversed"
    assert number(None, "new") is None
    assert store.remembered_mapping("D-IFSA", "new") == RememberedMapping(
        "D-IFSA", {"channels": {"n": 2}}
    )
    store.remember_mapping("PH-LAB", "new", {"channels": {"n": 9}})
    assert number("PH-LAB", "new") == 9
    assert count(store, channel_maps) == 3


def test_confirming_a_mapping_keeps_what_was_measured_of_the_file(store: Store) -> None:
    keep_recording(store, "a")
    confirmed = replace(
        MAPPED, mapping={"channels": {}}, mapping_state="confirmed", duration=None, problem="no t"
    )
    store.confirm_mapping("a", confirmed, "D-IFSA")
    assert store.recording_info("a").aircraft == "D-IFSA"
    mapped = store.mapped_columns("a")
    assert mapped.statistics == [[3, 1, 0.0, None, None]]
    assert (mapped.mapping_state, mapped.problem, mapped.duration) == ("confirmed", "no t", None)
    store.confirm_mapping("a", confirmed)
    assert store.recording_info("a").aircraft == "D-IFSA"


def test_an_order_is_kept_once(store: Store, trained: Monitor) -> None:
    monitor = store.add_monitor(trained, "m").id
    keep_recording(store, "a")
    first = scoring(store, "a", monitor)
    assert store.same_scoring("a", "o") is None
    assert store.add_scoring(first) == first
    assert store.add_scoring(replace(first, id="another")) == first
    assert store.same_scoring("a", "o") == store.scoring("a", first.id) == first
    other = store.add_scoring(scoring(store, "a", monitor, "p"))
    assert {one.id for one in store.scorings("a")} == {first.id, other.id} == store.scoring_ids()
    assert store.recording_info("a").n_scorings == 2


def test_a_scoring_is_of_its_recording_alone(store: Store, trained: Monitor) -> None:
    monitor = store.add_monitor(trained, "m").id
    keep_recording(store, "a")
    keep_recording(store, "b")
    kept = store.add_scoring(scoring(store, "a", monitor))
    marker = store.add_marker("a", Marker("k", "now", "note", 1.0, None, "gust"))
    for refused in (
        lambda: store.scoring("b", kept.id),
        lambda: store.delete_scoring("b", kept.id),
        lambda: store.change_marker("b", marker),
        lambda: store.delete_marker("b", marker.id),
        lambda: store.scorings("c"),
        lambda: store.markers("c"),
        lambda: store.add_scoring(scoring(store, "c", monitor)),
        lambda: store.add_scoring(replace(kept, monitor_id="c", order_digest="p")),
    ):
        with pytest.raises(NotFound):
            refused()


def test_a_monitor_that_scored_a_recording_stays(store: Store, trained: Monitor) -> None:
    monitor = store.add_monitor(trained, "m").id
    keep_recording(store, "a")
    kept = store.add_scoring(scoring(store, "a", monitor))
    flight = store.add_flight({}, monitor, 0.1)
    with pytest.raises(InUse, match=r"scoring of flight\.csv") as refused:
        store.delete_monitor(monitor)
    assert refused.value.users == (
        ("running flight", flight),
        ("scoring of flight.csv", kept.id),
    )
    store.delete_scoring("a", kept.id)
    store.delete_flight(flight)
    store.delete_monitor(monitor)


def test_markers_are_in_the_order_of_their_times(store: Store) -> None:
    keep_recording(store, "a")
    for identity, t in (("x", 5.0), ("y", 1.0)):
        store.add_marker("a", Marker(identity, "now", "marker", t, t + 1, identity))
    changed = store.change_marker("a", Marker("y", "", "note", 9.0, None, "later"))
    assert changed == Marker("y", "now", "note", 9.0, None, "later")
    assert [marker.id for marker in store.markers("a")] == ["x", "y"]
    store.delete_marker("a", "x")
    assert store.markers("a") == [changed]
