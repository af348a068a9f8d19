"""How samples of an MQTT broker are read, and when its messages are acknowledged."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.client.mqtt_messages import Unacknowledged, read_batch


@pytest.mark.parametrize(
    ("sent", "read"),
    [
        ({"t": 0.5, "p": None, "sequence": 9}, {"t": 0.5, "p": None}),
        ({"t": [0.5, 1], "air": {"p": [1, 2]}}, {"t": [0.5, 1], "air": {"p": [1, 2]}}),
        ([{"t": 0.5, "p": 1}, {"t": 1, "r": 2}], {"t": [0.5, 1], "p": [1, None], "r": [None, 2]}),
    ],
)
def test_a_message_is_a_sample_or_lists_of_values_or_a_list_of_samples(sent: Any, read: Any):
    assert read_batch(json.dumps(sent).encode()) == read


@pytest.mark.parametrize("text", [b"", b"{", b"\xff", b"3", b"[]", b"[1]", b'{"t": NaN}'])
def test_another_message_is_refused_with_what_to_send(text: bytes):
    with pytest.raises(ValueError, match=r'send \{"t"'):
        read_batch(text)


@given(st.permutations(range(6)))
def test_messages_are_acknowledged_in_the_order_received_and_not_before_they_are_settled(
    order: list[int],
):
    acknowledged: list[int] = []
    waiting = Unacknowledged(acknowledged.append)
    for sequence in range(6):
        waiting.add(sequence, 10 + sequence, b"")
    for n, sequence in enumerate(order, start=1):
        waiting.settle(sequence)
        settled = {*order[:n]}
        first = min({*range(7)} - settled)
        assert acknowledged == [10 + k for k in range(first)]


def test_a_message_of_a_broken_connection_is_acknowledged_only_when_it_is_repeated():
    acknowledged: list[int] = []
    waiting = Unacknowledged(acknowledged.append)
    waiting.add(0, 7, b"one")
    waiting.add(1, 8, b"two")
    waiting.disconnected()
    assert not waiting.is_repeated(7, b"another that has the number now")
    assert waiting.is_repeated(8, b"two")
    assert not waiting.is_repeated(8, b"two")
    waiting.settle(0)
    assert acknowledged == []
    waiting.settle(1)
    assert acknowledged == [8]


def test_a_message_without_a_guarantee_is_never_acknowledged():
    waiting = Unacknowledged(lambda mid: pytest.fail(f"{mid}"))
    waiting.add(0, None, b"text")
    assert waiting.settle(0) == b"text"
