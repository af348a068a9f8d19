"""Tiles of a scoring: the least and the most of every few samples, made once, drawn at any zoom.

A pyramid over the samples: tiles of FINEST samples, of FACTOR times as many, and so on. Any window
is answered from the level whose tiles are somewhat finer than its bins, so that the work goes with
the bins asked for and not with the length of the recording. A bin's extremes are exact.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from core.channels import N_CHANNELS

Samples = npt.NDArray[np.void]

FINEST = 8
"""Samples of the smallest tile."""
FACTOR = 4
"""Tiles that make a tile of the next level."""
BLOCK = 2**15
"""Samples that are looked at together."""

TILE = np.dtype(
    [
        ("low", "<f8", (N_CHANNELS,)),
        ("high", "<f8", (N_CHANNELS,)),
        ("risk_low", "<f8"),
        ("risk_high", "<f8"),
        ("withdrawn", "<f8"),
        ("state", "u1"),
        ("alert", "?"),
    ]
)
"""Extremes of y and p_value, largest withdrawn, worst state, any alert; NaN where nothing is."""

JOINED: dict[str, Any] = {
    "low": np.fmin,
    "high": np.fmax,
    "risk_low": np.fmin,
    "risk_high": np.fmax,
    "withdrawn": np.fmax,
    "state": np.maximum,
    "alert": np.logical_or,
}
"""What a tile says of several: fmin and fmax pass over what is missing."""
OF_SAMPLE = {"low": "y", "high": "y", "risk_low": "p_value", "risk_high": "p_value"}
"""Fields of a sample that a tile's are made of, where they have another name."""


@dataclass(frozen=True, eq=False)
class Window:
    """Bins of a manoeuvre of samples. first: sample of the first bin.   width: samples a bin.

    The last bin is shorter only where the samples end.
    """

    first: int
    width: int
    bins: Samples


def make_tiles(samples: Samples) -> Samples:
    """All levels of the pyramid over the samples of a scoring, finest first, one after another."""
    blocks = (samples[first : first + BLOCK] for first in range(0, len(samples), BLOCK))
    levels = [np.concatenate([np.empty(0, TILE), *(_joined(b, FINEST) for b in blocks)])]
    while len(levels[-1]) > FACTOR:
        levels.append(_joined(levels[-1], FACTOR))
    return np.concatenate(levels)


def window(samples: Samples, tiles: Samples, first: int, last: int, bins: int) -> Window:
    """Samples first to last in at most `bins` bins, and hardly fewer where there are as many.

    Bins begin where tiles do, so the window may begin and end a little outside of what was asked.
    """
    width = -(-(last - first + 1) // bins)
    size, source = _level(samples, tiles, width)
    begin, end = first // size, last // size + 1
    per_bin = -(-(end - begin) // bins)
    end = begin + -(-(end - begin) // per_bin) * per_bin
    return Window(begin * size, per_bin * size, _joined(source[begin:end], per_bin))


def _level(samples: Samples, tiles: Samples, width: int) -> tuple[int, Samples]:
    """Samples a tile and the tiles: the coarsest with FACTOR or more to a bin, or the samples."""
    size, first, level = 1, 0, samples
    while (larger := size * FACTOR if size > 1 else FINEST) * FACTOR <= width:
        n = -(-len(samples) // larger)
        size, level = larger, tiles[first : first + n]
        first += n
    return size, level


def _joined(source: Samples, n: int) -> Samples:
    """A tile for each n samples, or tiles; the last one may be of fewer."""
    joined = np.empty(-(-len(source) // n), TILE)
    starts = np.arange(0, len(source), n)
    of_samples = source.dtype != TILE
    for name, extreme in JOINED.items():
        values = source[OF_SAMPLE.get(name, name) if of_samples else name]
        joined[name] = values if n == 1 else extreme.reduceat(values, starts, axis=0)
    return joined
