"""Messages of an MQTT broker: how samples are read, and when each is acknowledged."""

from collections.abc import Callable
from typing import Any

import msgspec

from app.client.outbox import columns_of


def read_batch(text: bytes) -> dict[str, Any]:
    """The values by name of a message: a sample, lists of values, or a list of samples. ValueError.

    A `sequence` is left out: it is the source's own.
    """
    needed = (
        'send {"t": 0.02, "beta": 0.01, "p": null, ...}, with null, not NaN, for unknown values; a '
        "list of values under each name; or a list of such objects"
    )
    try:
        plain = msgspec.json.decode(text)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise ValueError(f"the message is not JSON ({error}): {needed}") from None
    if isinstance(plain, list) and plain and all(isinstance(sample, dict) for sample in plain):
        plain = columns_of(plain)
    if not isinstance(plain, dict):
        raise ValueError(f"the message is not a JSON object: {needed}")
    plain.pop("sequence", None)
    return plain


class _Received:
    """A message of the broker whose samples are not settled yet.

    mid: its number on the present connection; None if it arrived on an earlier one or without a
    guarantee.
    """

    def __init__(self, mid: int | None, text: bytes) -> None:
        self.mid, self.lost_mid, self.text, self.is_settled = mid, mid, text, False


class Unacknowledged:
    """The messages of a broker that are not acknowledged yet, by the number of their batch.

    acknowledge: called with the number of a message, in the order received, as MQTT demands.
    The caller holds a lock.
    """

    def __init__(self, acknowledge: Callable[[int], object]) -> None:
        self._acknowledge = acknowledge
        self._received: dict[int, _Received] = {}

    def add(self, sequence: int, mid: int | None, text: bytes) -> None:
        self._received[sequence] = _Received(mid, text)

    def settle(self, sequence: int) -> bytes:
        """Acknowledge what can be; returns the text of this message."""
        received = self._received[sequence]
        received.is_settled = True
        while self._received:
            first = next(iter(self._received))
            if not self._received[first].is_settled:
                break
            mid = self._received.pop(first).mid
            if mid is not None:
                self._acknowledge(mid)
        return received.text

    def disconnected(self) -> None:
        """Numbers of messages are of one connection."""
        for received in self._received.values():
            received.mid = None

    def is_repeated(self, mid: int, text: bytes) -> bool:
        """Whether a message that the broker repeats still waits; its number then holds again."""
        for sequence, received in self._received.items():
            if received.mid is None and received.lost_mid == mid and received.text == text:
                received.mid = mid
                self._received[sequence] = self._received.pop(sequence)
                return True
        return False
