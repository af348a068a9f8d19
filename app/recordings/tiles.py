"""Tiles of a scoring: extremes of consecutive samples, computed once and drawn at any zoom.

A pyramid over the samples: tiles of FINEST samples, of FACTOR times as many, and so on. A window
uses the level with tiles slightly finer than its bins, so the work depends on the number of bins
and not on the length of the recording. The extremes of a bin are exact.
"""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Samples = npt.NDArray[np.void]

FINEST = 8
"""Samples of the smallest tile."""
FACTOR = 4
"""Tiles per tile of the next level."""
BLOCK = 2**15
"""Samples that are processed at once."""


def tile_type(n_channels: int) -> np.dtype:
    """Extremes of y and p_value, largest withdrawn, worst state, any alert; NaN if missing."""
    return np.dtype(
        [
            ("low", "<f8", (n_channels,)),
            ("high", "<f8", (n_channels,)),
            ("risk_low", "<f8"),
            ("risk_high", "<f8"),
            ("withdrawn", "<f8"),
            ("state", "u1"),
            ("alert", "?"),
        ]
    )


JOINED: dict[str, Any] = {
    "low": np.fmin,
    "high": np.fmax,
    "risk_low": np.fmin,
    "risk_high": np.fmax,
    "withdrawn": np.fmax,
    "state": np.maximum,
    "alert": np.logical_or,
}
"""How the fields of several samples or tiles are joined; fmin and fmax skip missing values."""
OF_SAMPLE = {"low": "y", "high": "y", "risk_low": "p_value", "risk_high": "p_value"}
"""Fields of a tile whose source in a sample has another name."""


@dataclass(frozen=True, eq=False)
class Window:
    """Bins of consecutive samples. first: first sample.   width: samples per bin.

    Only the last bin may be shorter, at the end of the samples.
    """

    first: int
    width: int
    bins: Samples


def make_tiles(samples: Samples) -> Samples:
    """All levels of the pyramid over the samples of a scoring, finest level first."""
    blocks = (samples[first : first + BLOCK] for first in range(0, len(samples), BLOCK))
    none = _joined(samples[:0], FINEST)
    levels = [np.concatenate([none, *(_joined(b, FINEST) for b in blocks)])]
    while len(levels[-1]) > FACTOR:
        levels.append(_joined(levels[-1], FACTOR))
    return np.concatenate(levels)


def window(samples: Samples, tiles: Samples, first: int, last: int, bins: int) -> Window:
    """Samples first to last in at most `bins` bins.

    Bins start at tiles, so the window may start and end slightly outside the given range.
    """
    width = -(-(last - first + 1) // bins)
    size, source = _level(samples, tiles, width)
    begin, end = first // size, last // size + 1
    per_bin = -(-(end - begin) // bins)
    end = begin + -(-(end - begin) // per_bin) * per_bin
    return Window(begin * size, per_bin * size, _joined(source[begin:end], per_bin))


def window_between(samples: Samples, tiles: Samples, start: float, end: float, bins: int) -> Window:
    """Samples from start to end [s] in at most `bins` bins; none if there are none."""
    t = samples["t"]
    first = bisect_left(t, start)
    last = bisect_right(t, end) - 1
    if last < first:
        return Window(first, 1, tiles[:0])
    return window(samples, tiles, first, last, bins)


def _level(samples: Samples, tiles: Samples, width: int) -> tuple[int, Samples]:
    """Size and tiles of the coarsest level with FACTOR or more per bin, or the samples."""
    size, first, level = 1, 0, samples
    while (larger := size * FACTOR if size > 1 else FINEST) * FACTOR <= width:
        n = -(-len(samples) // larger)
        size, level = larger, tiles[first : first + n]
        first += n
    return size, level


def _joined(source: Samples, n: int) -> Samples:
    """A tile for each n samples or tiles; the last one may have fewer."""
    of_samples = "y" in (source.dtype.names or ())
    n_channels = source["y" if of_samples else "low"].shape[1]
    joined = np.empty(-(-len(source) // n), tile_type(n_channels))
    starts = np.arange(0, len(source), n)
    for name, extreme in JOINED.items():
        values = source[OF_SAMPLE.get(name, name) if of_samples else name]
        joined[name] = values if n == 1 else extreme.reduceat(values, starts, axis=0)
    return joined
