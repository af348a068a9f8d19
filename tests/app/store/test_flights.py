"""Stored flights: every sample once, in chunks; alarms acknowledged once."""

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.store import flights as stored_flights
from app.store.assessments import DISPLAY, StoredDisplay
from app.store.database import Damaged
from app.store.store import Store
from app.store.tables import assessment_chunks
from core.monitor import Monitor
from core.monitor.assessment import REASONS, STATES
from tests.support.repetition import examples
from tests.support.stored import alarm, append, assert_says_its_number, count, flown, opened


def test_reasons_survive_chunks_and_default_to_the_states_reason(
    store: Store, trained: Monitor
) -> None:
    flight, n = flown(store, trained), 2500
    state = np.where(np.arange(n) % 5 == 0, 1, 3)
    reasons = [REASONS[1] if code == 1 else f"off by {k // 700}" for k, code in enumerate(state)]
    for part in (slice(0, 1300), slice(1300, n)):
        t = np.arange(n)[part] * 0.02
        nothing = np.full(len(t), np.nan), np.zeros(len(t), bool), state[part]
        store.flights.append(
            flight, part.start, t, np.ones((len(t), 6)), *nothing, reasons=reasons[part]
        )
    assert store.flights.assessments(flight).reasons == tuple(reasons)
    assert store.flights.assessments(flight, 690, 1310).reasons == tuple(reasons[690:1311])
    append(store, flight, n, 4)
    assert store.flights.assessments(flight, n).reasons == REASONS


def test_a_resumed_flight_drops_samples_beyond_its_durable_head(
    store: Store, trained: Monitor
) -> None:
    flight = flown(store, trained)
    for first in (0, 40, 80):
        append(store, flight, first, 40)
    before = store.flights.assessments(flight, 0, 49)
    store.flights.recover()
    store.flights.resume(flight, 49)
    after = store.flights.assessments(flight)
    assert (after.seq.tolist(), after.reasons) == (before.seq.tolist(), before.reasons)
    assert np.array_equal(after.y, before.y)
    append(store, flight, 50, 5)
    assert store.flights.info(flight).head == 54
    store.flights.resume(flight, 10)
    assert store.flights.info(flight).head == 54


def test_state_codes_match_those_of_stored_flights() -> None:
    assert [state.value for state in STATES[:4]] == ["ok", "warming_up", "stale", "invalid"]


@pytest.fixture(scope="module")
def long_lived(
    tmp_path_factory: pytest.TempPathFactory, trained: Monitor
) -> Iterator[tuple[Store, str]]:
    """A store and a monitor in it."""
    with opened(tmp_path_factory.mktemp("store") / "forewarn.db") as store:
        yield store, store.monitors.add(trained, "m").id


@settings(max_examples=examples(40))
@given(
    parts=st.lists(st.tuples(st.integers(0, 3), st.integers(0, 25)), max_size=5),
    first=st.integers(-5, 50),
    length=st.none() | st.integers(0, 30),
)
def test_samples_are_read_back_unchanged(
    long_lived: tuple[Store, str],
    parts: list[tuple[int, int]],
    first: int,
    length: int | None,
) -> None:
    store, monitor_id = long_lived
    flight = store.flights.add({}, monitor_id, 0.1)
    there, seq = [], 0
    for gap, n in parts:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(stored_flights, "CHUNK", 10)
            append(store, flight, seq + gap, n)
        there.extend(range(seq + gap, seq + gap + n))
        seq += gap + n
    last = None if length is None else first + length
    asked = [i for i in there if i >= first and (last is None or i <= last)]
    assert_says_its_number(store.flights.assessments(flight, first, last), np.array(asked, int))
    assert store.flights.info(flight).head == (there[-1] if there else None)


def test_a_blob_holds_at_most_a_thousand_samples(store: Store, trained: Monitor) -> None:
    append(store, flown(store, trained), 1, 2500)
    assert count(store, assessment_chunks) == 3


def test_a_sample_is_stored_once(store: Store, trained: Monitor) -> None:
    flight = flown(store, trained)
    append(store, flight, 0, 10)
    with pytest.raises(ValueError, match=r"stored up to sample 9: .*continue from 10"):
        append(store, flight, 9, 1)
    assert len(store.flights.assessments(flight)) == 10


def test_samples_without_forecast_or_p_value_stay_so(store: Store, trained: Monitor) -> None:
    flight = flown(store, trained)
    store.flights.append(flight, 0, [0.0], np.ones((1, 6)), [np.nan], [False], [1])
    back = store.flights.assessments(flight)
    assert np.isnan(back.y_hat).all()
    assert np.isnan(back.p_value).all()
    assert back.state.tolist() == [1]


def test_fields_of_other_shapes_are_refused(store: Store, trained: Monitor) -> None:
    flight = flown(store, trained)
    with pytest.raises(ValueError, match=r"y has shape \(6,\): it needs \(2, 6\)"):
        store.flights.append(flight, 0, [0, 1], np.ones(6), [0, 0], [0, 0], [0, 0])
    with pytest.raises(ValueError, match=r"p_value has shape \(\): it needs \(2,\)"):
        store.flights.append(flight, 0, [0, 1], np.ones((2, 6)), 0.5, [0, 0], [0, 0])


def test_a_flight_ends_once(store: Store, trained: Monitor) -> None:
    flight = flown(store, trained)
    assert store.flights.info(flight).status == "running"
    ended = store.flights.end(flight, "failed")
    assert ended.status == "failed"
    assert ended.ended is not None
    assert store.flights.end(flight) == ended
    assert store.flights.all() == [ended]
    with pytest.raises(ValueError, match="cannot end as 'running'"):
        store.flights.end(flight, "running")


def test_alarms_are_numbered_and_acknowledged_once(store: Store, trained: Monitor) -> None:
    flight, other = flown(store, trained), flown(store, trained)
    for number, seq in ((1, 4), (2, 90)):
        store.alarms.add(flight, alarm(number, seq, seq / 50))
    store.alarms.add(other, alarm(1, 7, 0.14))
    first = store.alarms.acknowledge(flight, 1, "conductor")
    assert first.by == "conductor"
    assert first.acknowledged is not None
    assert store.alarms.acknowledge(flight, 1, "pilot") == first == store.alarms.of(flight)[0]
    alarms = store.alarms.of(flight)
    assert [(a.id, a.number, a.seq) for a in alarms] == [("1", 1, 4), ("2", 2, 90)]
    assert alarms[1].acknowledged is alarms[1].by is None
    assert [a.number for a in store.alarms.of(other)] == [1]


@settings(max_examples=examples(200), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_changed_bit_of_a_stored_chunk_is_served(
    long_lived: tuple[Store, str], data: st.DataObject
) -> None:
    store, monitor_id = long_lived
    flight, n = store.flights.add({}, monitor_id, 0.1), 20
    shown = StoredDisplay(np.zeros(n, DISPLAY), tuple("late" for _ in range(n)))
    none = np.zeros((n, 6))
    store.flights.append(
        flight, 0, none[:, 0], none, none[:, 0], none[:, 0] > 0, [3] * n, none,
        ["frozen"] * n, [shown],
    )  # fmt: skip
    name = data.draw(st.sampled_from(["content", "display", "reasons", "display_reasons"]))
    with store.engine.begin() as connection:
        where = f"FROM assessment_chunks WHERE flight_id = '{flight}'"
        value = connection.exec_driver_sql(f"SELECT {name} {where}").scalar_one()
        is_text = isinstance(value, str)
        content = bytearray(value.encode() if is_text else value)
        bit = data.draw(st.integers(0, 8 * len(content) - 1))
        content[bit // 8] ^= 1 << bit % 8
        changed = bytes(content).decode(errors="replace") if is_text else bytes(content)
        change = f"UPDATE assessment_chunks SET {name} = ? WHERE flight_id = '{flight}'"
        connection.exec_driver_sql(change, (changed,))
    for read in (store.flights.assessments, store.flights.check):
        with pytest.raises(Damaged):
            read(flight)
