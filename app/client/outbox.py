"""Samples on their way to a server, in batches that are kept until acknowledged."""

import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import msgspec

MOST_WAITING = 200_000
"""Most samples that are not durable yet; beyond it `send` waits."""
MOST_IN_BATCH = 500
"""Most samples per batch; the server accepts 1000."""
MOST_BYTES = 262_144
"""Largest message that the server accepts."""
MOST_VALUES = 8_000
"""Per batch: at most 200 kB."""


class PushFailed(OSError):
    """Samples that cannot be pushed."""


class OutgoingBatch(NamedTuple):
    """A batch to send. sequence: its number.   n: samples in it."""

    sequence: int
    n: int
    text: bytes


OnSettled = Callable[[int, str], object]
"""Called with the number of a batch, and why it was refused; empty if it is durable."""


class Outbox:
    """Samples that are not durable: waiting, then in unacknowledged batches.

    `put`, `put_batch` and `wait` are for the caller's thread, the other methods for the sending
    thread, which calls `on_settled`.
    """

    def __init__(self, on_settled: OnSettled | None = None) -> None:
        self._on_settled = on_settled
        self._changed = threading.Condition()
        self._waiting: deque[dict[str, float | None]] = deque()
        self._open: dict[int, OutgoingBatch] = {}
        self._unsent: deque[OutgoingBatch] = deque()
        self._sequence = 0
        self.n_put = self.n_durable = self.n_refused = 0
        self.refusal = self.failure = ""

    @property
    def _n_open(self) -> int:
        return self.n_put - self.n_durable - self.n_refused

    @property
    def is_full(self) -> bool:
        return self._n_open >= MOST_WAITING

    @property
    def is_empty(self) -> bool:
        return self._n_open == 0

    def begin_after(self, last: int | None) -> None:
        """Number batches from the one after `last`."""
        self._sequence = 0 if last is None else last + 1

    def put(self, sample: dict[str, float | None]) -> None:
        """Add a sample, as soon as there is room. PushFailed."""
        with self._changed:
            self._changed.wait_for(lambda: self.failure or not self.is_full)
            self._check()
            self._waiting.append(sample)
            self.n_put += 1

    def put_batch(self, values: dict[str, Any]) -> int:
        """Add a separate batch without waiting for room. Returns its number.

        values: a number, None or a list of them by name. PushFailed; ValueError if it is too large.
        """
        with self._changed:
            self._check()
            n = max((len(x) for x in values.values() if isinstance(x, list)), default=1)
            text = msgspec.json.encode(values | {"sequence": self._sequence})
            if len(text) > MOST_BYTES:
                raise ValueError(f"{len(text)} bytes in one batch: send at most {MOST_BYTES}")
            self._unsent.append(self._opened(n, text))
            self.n_put += n
            return self._unsent[-1].sequence

    def wait(self, patience: float) -> bool:
        """Wait until all is acknowledged. False after `patience` [s] without news. PushFailed."""
        with self._changed:
            while not self.is_empty:
                self._check()
                n_open = self._n_open
                if not self._changed.wait(patience) and n_open == self._n_open:
                    return False
            self._check()
            return self.n_refused == 0

    def take(self) -> OutgoingBatch | None:
        """The next batch to send; None if there is none."""
        with self._changed:
            if not self._unsent and self._waiting:
                self._unsent.append(self._made())
            return self._unsent.popleft() if self._unsent else None

    def rewind(self) -> None:
        """Send the unacknowledged batches again, in order."""
        with self._changed:
            self._unsent = deque(self._open.values())

    def acknowledge(self, sequence: int | None) -> None:
        if sequence is not None:
            self._settle(sequence, "")

    def refuse(self, sequence: int, reason: str) -> None:
        self._settle(sequence, reason)

    def _settle(self, sequence: int, refusal: str) -> None:
        with self._changed:
            if (batch := self._open.pop(sequence, None)) is None:
                return
            if refusal:
                self.n_refused += batch.n
                self.refusal = refusal
            else:
                self.n_durable += batch.n
            self._changed.notify_all()
        if self._on_settled is not None:
            self._on_settled(sequence, refusal)

    def fail(self, reason: str) -> None:
        """Sending has failed: raise in `put` and `wait`."""
        with self._changed:
            self.failure = reason
            self._changed.notify_all()

    def _check(self) -> None:
        if self.failure:
            raise PushFailed(self.failure)

    def _made(self) -> OutgoingBatch:
        """A batch of waiting samples, as large as allowed."""
        most = max(1, MOST_VALUES // max(1, len(self._waiting[0])))
        most = min(most, MOST_IN_BATCH, len(self._waiting))
        columns = columns_of([self._waiting.popleft() for _ in range(most)])
        text = msgspec.json.encode(columns | {"sequence": self._sequence})
        return self._opened(most, text)

    def _opened(self, n: int, text: bytes) -> OutgoingBatch:
        batch = OutgoingBatch(self._sequence, n, text)
        self._open[batch.sequence] = batch
        self._sequence += 1
        return batch


def columns_of(samples: Sequence[dict[str, Any]]) -> dict[str, list[Any]]:
    """A list of values under each name; None for names that a sample lacks."""
    names = dict.fromkeys(name for sample in samples for name in sample)
    return {name: [sample.get(name) for sample in samples] for name in names}
