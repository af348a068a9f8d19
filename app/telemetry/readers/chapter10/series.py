"""Series of samples collected from the packets of a Chapter 10 recording."""

from abc import ABC, abstractmethod
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from app.telemetry.readers.chapter10.packets import TICKS
from app.telemetry.readers.signal_tables import Column, Pieces, SignalTable
from core.types import Array

MOST_WORDS = 32
"""Data words of a MIL-STD-1553 message."""
GAP = 1.5
"""A longer distance between analog packets, in usual lengths, is a gap."""


class Series(ABC):
    """Samples of one origin, with times in ticks after the first data of the file."""

    @abstractmethod
    def table(self, name: str) -> SignalTable:
        pass


@dataclass(eq=False)
class Words(Series):
    """Messages of up to MOST_WORDS words of 16 bits in two's complement."""

    times: array = field(default_factory=lambda: array("d"))
    counts: array = field(default_factory=lambda: array("B"))
    words: array = field(default_factory=lambda: array("h"))

    def add(self, time: int, words: bytes) -> None:
        """Add a message; its words are in the byte order of the file."""
        self.times.append(time)
        self.counts.append(len(words) // 2)
        self.words.frombytes(np.frombuffer(words.ljust(2 * MOST_WORDS, b"\0"), "<i2").tobytes())

    def table(self, name: str) -> SignalTable:
        """One column per word, NaN if a message is shorter."""
        counts = np.asarray(self.counts)
        width = int(counts.max())
        labels = [f"{name}/word {k + 1:02d}" for k in range(width)]

        def pieces() -> Pieces:
            yield 0, np.asarray(self.times) / TICKS
            table = np.asarray(self.words).reshape(-1, MOST_WORDS)
            for k in range(width):
                yield k + 1, np.where(k < counts, table[:, k], np.nan)

        return SignalTable((name,), _columns(name, labels), len(counts), pieces)


@dataclass(eq=False)
class Values(Series):
    """Samples of a few values each. labels: of the values."""

    labels: tuple[str, ...]
    times: array = field(default_factory=lambda: array("d"))
    values: array = field(default_factory=lambda: array("q"))

    def add(self, time: int, values: tuple[int, ...]) -> None:
        self.times.append(time)
        self.values.extend(values)

    def table(self, name: str) -> SignalTable:
        labels = [f"{name}/{label}" for label in self.labels]

        def pieces() -> Pieces:
            yield 0, np.asarray(self.times) / TICKS
            yield from enumerate(np.asarray(self.values).reshape(-1, len(labels)).T, start=1)

        return SignalTable((name,), _columns(name, labels), len(self.times), pieces)


@dataclass(eq=False)
class Sampled(Series):
    """Analog samples (n, n_subchannels); only the first sample of each packet has a time."""

    width: int
    times: list[int] = field(default_factory=list)
    blocks: list[npt.NDArray[np.integer]] = field(default_factory=list)

    def add(self, time: int, block: npt.NDArray[np.integer]) -> None:
        self.times.append(time)
        self.blocks.append(block)

    def table(self, name: str) -> SignalTable:
        labels = [f"{name}/analog {k + 1}" for k in range(self.width)]

        def pieces() -> Pieces:
            for times, block in zip(self._times(), self.blocks, strict=True):
                yield 0, times / TICKS
                yield from enumerate(block.T, start=1)

        n_rows = sum(map(len, self.blocks))
        return SignalTable((name,), _columns(name, labels), n_rows, pieces)

    def _times(self) -> Iterator[Array]:
        """Ticks of the samples, spread evenly up to the next packet unless there is a gap."""
        lengths = np.array([len(block) for block in self.blocks], dtype=np.float64)
        steps = np.append(np.diff(self.times), np.nan) / lengths
        usual = float(np.nanmedian(steps)) if len(steps) > 1 else 0.0
        steps[~((steps > 0) & (steps < GAP * usual))] = usual
        for first, step, block in zip(self.times, steps, self.blocks, strict=True):
            yield first + step * np.arange(len(block))


def _columns(name: str, labels: list[str]) -> tuple[Column, ...]:
    time = Column(f"{name}/time", "s", "the recorder's relative time counter", time=True)
    return (time, *(Column(label, "", "raw, as on the bus") for label in labels))
