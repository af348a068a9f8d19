"""Whatever comes by uplink or datagram: no flight falls, and what it accepted is in its journal."""

import asyncio
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.assessment.batches import ChannelReader
from app.assessment.scorer import TrimRule
from app.flights.sources.live import LiveFlight, LiveSetup, SequenceConflict
from app.telemetry.journal import Journals, lines_of
from app.telemetry.recording import TelemetryError
from core.channels import KEYS
from tests.app.flights.test_flights import monitor
from tests.app.routes.test_live_samples import Range
from tests.support.api import api
from tests.support.flying import EPSILON, ScriptedClock, Seen, SilentRecorder, plan
from tests.support.live_server import assessed_again
from tests.support.repetition import IS_CAMPAIGN

DT = monitor().dt
EXAMPLES, CONNECTIONS = (2000, 300) if IS_CAMPAIGN else (25, 15)
NAMES = st.sampled_from(("t", "timestamp", "sequence", *KEYS, "phi", "theta", "psi", "other"))
NUMBERS = st.one_of(
    st.floats(),
    st.floats(-10.0, 10.0),
    st.integers(),
    st.sampled_from((0, 1e308, -1e308, 5e-324, 2**53, 2**63, 2**64, -(2**64), 1e15, 1e16)),
)
PLAIN = st.one_of(st.none(), st.booleans(), NUMBERS, st.text(max_size=4))
ANY = st.recursive(
    PLAIN,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(NAMES | st.text(max_size=3), inner),
    max_leaves=12,
)


@st.composite
def near_batches(draw: st.DrawFn) -> Any:
    """A batch of which anything may be odd."""
    n = draw(st.integers(0, 3))
    values = st.lists(NUMBERS | st.none(), min_size=n, max_size=n) | NUMBERS
    batch = {key: draw(values) for key in ("t", *KEYS)}
    batch |= draw(st.dictionaries(NAMES, ANY, max_size=2))
    return batch | {"sequence": draw(st.integers(0, 5) | ANY)}


def good(k: int) -> dict[str, Any]:
    return {"sequence": 1000 + k, "t": DT * k} | dict.fromkeys(KEYS, 0.001 * k)


MESSAGES = st.one_of(
    st.binary(max_size=40),
    (ANY | near_batches()).map(lambda plain: json.dumps(plain).encode()),
    st.integers(0, 5).map(lambda k: json.dumps(good(k)).encode()),
)
MOMENTS = st.tuples(st.sampled_from((0.0, 0.001, DT, 0.3, 5.0)), st.booleans(), MESSAGES)


async def _fly(root: Path, trim: TrimRule, moments: list[tuple[float, bool, bytes]]) -> None:
    clock, journals, recorder = ScriptedClock(), Journals(root), SilentRecorder(ScriptedClock())
    setup = LiveSetup(monitor(), EPSILON, ChannelReader(), journals, 0.0, trim=trim)
    about = setup, recorder, clock, lambda *_: None
    flight = LiveFlight(plan(monitor()), *about)
    seen = Seen(flight.watch())
    flight.start()
    for wait, by_datagram, content in moments:
        clock.advance(wait)
        before = flight.live.batches
        if by_datagram:
            flight._receive_datagram(content.splitlines(), "127.0.0.1")
        else:
            try:
                taken = flight.receive(content, "websocket")
                assert flight.live.batches == before + (not taken.repeated)
            except (TelemetryError, SequenceConflict):
                assert flight.live.batches == before
        seen.take()
    clock.advance(1.0)
    await flight._open_journal.settled()
    lines = [*lines_of(journals.path(flight.id))]
    assert sum("b" in line for line in lines) == flight.live.batches
    killed = LiveFlight(plan(monitor()), *about)
    assert len(killed.restore(lines, -1, [], [])) == flight.head + 1
    await flight.stop("enough")
    journals.close()
    again = [one.assessment for one in assessed_again(setup, flight.id)]
    shown = [sample.assessment for sample in recorder.waiting(0, 10**6)]
    assert [(s.t, s.p_value, s.state, s.reason) for s in shown] == [
        (one.t, one.p_value, one.state, one.reason) for one in again
    ]


@settings(max_examples=EXAMPLES)
@given(st.sampled_from(("none", "detected")), st.lists(MOMENTS, max_size=12))
def test_no_message_fells_a_flight_and_its_journal_shows_the_same(
    trim: TrimRule, moments: list[tuple[float, bool, bytes]]
) -> None:
    with TemporaryDirectory() as place:
        asyncio.run(_fly(Path(place), trim, moments))


@pytest.fixture(scope="module")
def range_(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Range]:
    root = tmp_path_factory.mktemp("data")
    with api(root) as client:
        yield Range(client, root)


@settings(max_examples=CONNECTIONS)
@given(st.lists(st.tuples(MESSAGES, st.booleans()), max_size=12))
def test_every_message_of_an_uplink_is_answered_and_the_flight_goes_on(
    range_: Range, messages: list[tuple[bytes, bool]]
) -> None:
    before, stored, refused = len(batches(range_)), 0, 0
    last = json.dumps(good(len(messages)) | {"sequence": 10**6 + before}).encode()
    with range_.uplink() as socket:
        assert msgspec.json.decode(socket.receive_text())["type"] == "welcome"
        for content, as_text in [*messages, (last, True)]:
            if as_text:
                socket.send_text(content.decode(errors="replace"))
            else:
                socket.send_bytes(content)
        new, acknowledged = [], []
        while stored + refused <= len(messages):
            answer = msgspec.json.decode(socket.receive_text())
            if answer["type"] == "stored":
                stored += answer["count"]
                acknowledged += answer["sequences"]
                new += (Counter(answer["sequences"]) - Counter(answer["repeated"])).elements()
            else:
                assert answer["status"] in (409, 422)
                refused += 1
    assert 10**6 + before in new
    kept = batches(range_)
    assert {*acknowledged} <= {*kept}
    assert sorted(n for n in kept[before:] if n is not None) == sorted(new)


def batches(range_: Range) -> list[int | None]:
    """Numbers of the batches in the journal."""
    return [line["s"] for line in range_.lines() if "b" in line]
