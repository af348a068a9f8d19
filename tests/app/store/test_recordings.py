"""Rows of recordings, mappings, scorings and markers; nothing of them outlives its recording."""

from dataclasses import replace

import pytest

from app.store.recordings import Marker, RecordingInfo, RememberedMapping
from app.store.repository import InUse, NotFound
from app.store.store import Store
from app.store.tables import mappings, markers, recordings, scorings
from core.monitor import Monitor
from tests.support.stored import MAPPED, count, keep_recording, scoring


def test_a_recording_is_seen_once_its_folder_is_in_its_place(store: Store) -> None:
    store.recordings.add("a", "flight.csv", 3, "d", "csv", None, MAPPED)
    assert store.recordings.all() == []
    assert store.recordings.incomplete() == ["a"]
    with pytest.raises(NotFound):
        store.recordings.info("a")
    store.recordings.complete("a")
    info = store.recordings.info("a")
    assert store.recordings.all() == [info]
    assert info == RecordingInfo(
        "a",
        "flight.csv",
        info.created,
        3,
        "d",
        "csv",
        None,
        12.5,
        "proposed",
        None,
        0,
        None,
        False,
        None,
    )
    assert store.recordings.mapped_columns("a") == replace(
        MAPPED, statistics=[[3, 1, 0.0, None, None]]
    )


def test_a_recording_goes_out_of_sight_before_it_goes(store: Store, trained: Monitor) -> None:
    monitor = store.monitors.add(trained, "m").id
    keep_recording(store, "a")
    store.scorings.add(scoring(store, "a", monitor))
    store.markers.add("a", Marker("k", "now", "note", 1.0, None, "gust"))
    store.recordings.purge("a")
    assert [info.id for info in store.recordings.all()] == ["a"]
    store.recordings.withdraw("a")
    assert store.recordings.all() == []
    assert store.recordings.incomplete() == ["a"]
    store.monitors.delete(monitor)
    store.recordings.purge("a")
    assert [count(store, table) for table in (recordings, scorings, markers)] == [0, 0, 0]


def test_a_recording_that_is_flown_stays(store: Store, trained: Monitor) -> None:
    monitor = store.monitors.add(trained, "m").id
    keep_recording(store, "a")
    stored = store.scorings.add(scoring(store, "a", monitor))
    source = {"kind": "recording", "recording": "a", "scoring": stored.id}
    flight = store.flights.add(source, monitor, 0.1)
    with pytest.raises(InUse, match=f"recording flight.csv is used by running flight.*{flight}"):
        store.recordings.withdraw("a")
    with pytest.raises(InUse, match=flight):
        store.scorings.delete("a", stored.id)
    store.flights.end(flight)
    store.scorings.delete("a", stored.id)
    store.recordings.withdraw("a")


def test_the_first_of_the_same_bytes_is_named(store: Store) -> None:
    for identity, digest in (("c", "same"), ("b", "other"), ("a", "same")):
        keep_recording(store, identity, digest)
    assert [store.recordings.info(identity).same_as for identity in "cba"] == [None, None, "c"]


def test_a_mapping_is_remembered_by_aircraft_alone(store: Store) -> None:
    assert store.mappings.find("PH-LAB", "new") is None
    for order, (aircraft, signals) in enumerate(
        [("PH-LAB", "old"), ("PH-LAB", "new"), ("D-IFSA", "new")]
    ):
        store.mappings.save(aircraft, signals, {"channels": {"n": order}})

    def number(aircraft: str | None, signals: str) -> int | None:
        stored = store.mappings.find(aircraft, signals)
        return None if stored is None else stored.mapping["channels"]["n"]

    assert number("PH-LAB", "old") == 0
    assert number("PH-LAB", "new") == 1
    assert number("PH-LAB", "never seen") == 1, "the newest of the aircraft"
    assert number("OO-XYZ", "new") is None, "another aircraft may be reversed"
    assert number(None, "new") is None
    assert store.mappings.find("D-IFSA", "new") == RememberedMapping(
        "D-IFSA", {"channels": {"n": 2}}
    )
    store.mappings.save("PH-LAB", "new", {"channels": {"n": 9}})
    assert number("PH-LAB", "new") == 9
    assert count(store, mappings) == 3


def test_confirming_a_mapping_keeps_what_was_measured_of_the_file(store: Store) -> None:
    keep_recording(store, "a")
    confirmed = replace(
        MAPPED, mapping={"channels": {}}, mapping_state="confirmed", duration=None, problem="no t"
    )
    store.recordings.confirm_mapping("a", confirmed, "D-IFSA")
    assert store.recordings.info("a").aircraft == "D-IFSA"
    mapped = store.recordings.mapped_columns("a")
    assert mapped.statistics == [[3, 1, 0.0, None, None]]
    assert (mapped.mapping_state, mapped.problem, mapped.duration) == ("confirmed", "no t", None)
    store.recordings.confirm_mapping("a", confirmed)
    assert store.recordings.info("a").aircraft == "D-IFSA"


def test_a_request_is_carried_out_once(store: Store, trained: Monitor) -> None:
    monitor = store.monitors.add(trained, "m").id
    keep_recording(store, "a")
    first = scoring(store, "a", monitor).sealed()
    assert store.scorings.find("a", "o") is None
    assert store.scorings.add(first) == first
    assert store.scorings.add(replace(first, id="another")) == first
    assert store.scorings.find("a", "o") == store.scorings.info("a", first.id) == first
    other = store.scorings.add(scoring(store, "a", monitor, "p"))
    assert (
        {one.id for one in store.scorings.of("a")} == {first.id, other.id} == store.scorings.ids()
    )
    assert store.recordings.info("a").n_scorings == 2


def test_a_scoring_is_of_its_recording_alone(store: Store, trained: Monitor) -> None:
    monitor = store.monitors.add(trained, "m").id
    keep_recording(store, "a")
    keep_recording(store, "b")
    stored = store.scorings.add(scoring(store, "a", monitor))
    marker = store.markers.add("a", Marker("k", "now", "note", 1.0, None, "gust"))
    for refused in (
        lambda: store.scorings.info("b", stored.id),
        lambda: store.scorings.delete("b", stored.id),
        lambda: store.markers.update("b", marker),
        lambda: store.markers.delete("b", marker.id),
        lambda: store.scorings.of("c"),
        lambda: store.markers.of("c"),
        lambda: store.scorings.add(scoring(store, "c", monitor)),
        lambda: store.scorings.add(replace(stored, monitor_id="c", request_digest="p")),
    ):
        with pytest.raises(NotFound):
            refused()


def test_a_monitor_that_scored_a_recording_stays(store: Store, trained: Monitor) -> None:
    monitor = store.monitors.add(trained, "m").id
    keep_recording(store, "a")
    stored = store.scorings.add(scoring(store, "a", monitor))
    flight = store.flights.add({}, monitor, 0.1)
    with pytest.raises(InUse, match=r"scoring of flight\.csv") as refused:
        store.monitors.delete(monitor)
    assert refused.value.users == (
        ("running flight", flight),
        ("scoring of flight.csv", stored.id),
    )
    store.scorings.delete("a", stored.id)
    store.flights.end(flight)
    store.flights.delete(flight)
    store.monitors.delete(monitor)


def test_markers_are_in_the_order_of_their_times(store: Store) -> None:
    keep_recording(store, "a")
    for identity, t in (("x", 5.0), ("y", 1.0)):
        store.markers.add("a", Marker(identity, "now", "marker", t, t + 1, identity))
    changed = store.markers.update("a", Marker("y", "", "note", 9.0, None, "later"))
    assert changed == Marker("y", "now", "note", 9.0, None, "later")
    assert [marker.id for marker in store.markers.of("a")] == ["x", "y"]
    store.markers.delete("a", "x")
    assert store.markers.of("a") == [changed]
