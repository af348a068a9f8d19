"""The flown input against the planned one: how far, how evenly and how long surfaces moved.

Compared by conformal rank with what fresh flights did, from below as from above. That withdraws
nothing: a doublet of half the amplitude is flown by the same aircraft, and tells less of its limit.
An input that begins in the other direction, or holds for longer, does: see `InputShape`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from core.channels import CHANNELS, KEYS, Channel
from core.monitor.file.portable import Section
from core.monitor.validity.input_shape import BEGUN, FreshShapes, InputShape, deflections
from core.monitor.validity.support import LEVEL, WORST_LEVEL
from core.types import Array, Flags, Indices

SURFACES = (KEYS.index("delta_a"), KEYS.index("delta_r"))
ARRAYS = {"surfaces": "surfaces", "planned": "usual", "safe": "safe", "unsafe": "unsafe"}
"""What a section of a monitor's file holds, and the field of InputSupport that it is."""
SHAPE = "begun", "flights", "longest_s"
"""What it holds of `InputShape`; older files have no `longest_s`, or none of them."""
MEASURES = PEAK, OTHER_SIDE, LASTING = range(3)
WORDS = (
    "largest deflection",
    "deflection to the other side, as a share of the largest,",
    "time beyond half the largest deflection",
)
LEAST_WORTH = (0.0, 0.05, 0.1)
"""Of each measure, what a flight must lie beyond the others to be remarked on: simulated pilots may
be more even than any hand."""
MAIN = 0.5
"""Share of the largest usual peak from which on a surface is one that the manoeuvre moves; one that
moves less follows a control law, or is held."""


@dataclass(frozen=True)
class FlownInput:
    """How a surface was moved. channel: its key.

    peak: largest magnitude [rad].   planned: amplitude of the planned manoeuvre [rad], None where
    the manoeuvre is not known or does not command it.
    remarks: what sets it apart from fresh flights; nothing for an input like theirs.
    """

    channel: str
    peak: float
    planned: float | None
    remarks: tuple[str, ...] = ()

    @property
    def share(self) -> float | None:
        """Of the planned amplitude."""
        return self.peak / self.planned if self.planned else None


@dataclass(frozen=True, eq=False)
class InputSupport:
    """How surfaces moved in flights that are drawn like the simulated ones.

    surfaces: (k,) numbers of the channels that the manoeuvre moves.
    usual: (k,) median peak of all of them [rad].
    safe, unsafe: (n, k, 3) of fresh flights that stayed safe, and of those that failed up to their
    failure, each measure sorted: peak [rad], largest deflection to the other side as a share of the
    peak, time beyond half the peak [s].
    shape: which way they began to move, and how long they held; None in older files.
    """

    surfaces: Indices
    usual: Array
    safe: Array
    unsafe: Array
    shape: InputShape | None = None

    def check(self) -> None:
        """Refuse arrays that do not fit together; ValueError."""
        k = len(self.surfaces)
        if self.surfaces.dtype != np.int64 or not set(self.surfaces.tolist()) <= set(SURFACES):
            raise ValueError(f"input surfaces are {self.surfaces}")
        for name, array in (("safe", self.safe), ("unsafe", self.unsafe)):
            if array.dtype != np.float64 or array.shape != (len(array), k, len(MEASURES)):
                raise ValueError(f"input {name} is {array.dtype} {array.shape}")
            if not np.isfinite(array).all() or (array[1:] < array[:-1]).any() or (array < 0).any():
                raise ValueError(f"input {name} is not sorted, or holds what is no measure")
        if self.usual.dtype != np.float64 or self.usual.shape != (k,):
            raise ValueError(f"input planned is {self.usual.dtype} {self.usual.shape}")
        if not (np.isfinite(self.usual).all() and (self.usual > 0).all()):
            raise ValueError("input planned holds what is no peak")
        if self.shape is not None:
            self.shape.check()

    def to_section(self) -> Section:
        """Return the section of a monitor's file; a program that does not know it may ignore it."""
        arrays: dict[str, Any] = {name: getattr(self, field) for name, field in ARRAYS.items()}
        if self.shape is not None:
            arrays |= {name: getattr(self.shape, name) for name in SHAPE}
        return Section("input", 1, False, {}, arrays)

    @classmethod
    def of_section(cls, section: Section) -> Self:
        """Rebuild it; ValueError where it makes no sense."""
        arrays: dict[str, Any] = {field: section.arrays[name] for name, field in ARRAYS.items()}
        if "begun" in section.arrays:
            no_holds: dict[str, Any] = {"longest_s": np.empty((len(arrays["surfaces"]), 0))}
            known = {name: section.arrays[name] for name in SHAPE if name in section.arrays}
            arrays["shape"] = InputShape(arrays["surfaces"], **(no_holds | known))
        support = cls(**arrays)
        support.check()
        return support

    def judge(
        self, y: Array, dt: float, exceeded: bool, planned: Array | None = None
    ) -> tuple[FlownInput, ...]:
        """Compare a flight with fresh ones of its kind; one entry each surface that was recorded.

        y: (n, 6) from trim, up to the first exceedance where there is one; NaN where unknown.
        dt: [s].   exceeded: whether there is one.   planned: (2,) amplitude of each of SURFACES in
        the planned manoeuvre [rad]; None where that is not known.
        """
        there = np.isfinite(y[:, self.surfaces]).any(axis=0)
        found = measures(y[None], np.array([len(y) - 1]), dt, self.surfaces)[0]
        amplitudes = dict(zip(SURFACES, [] if planned is None else planned.tolist(), strict=False))
        return tuple(
            self._judged(k, found[k], exceeded, amplitudes.get(int(self.surfaces[k])) or None)
            for k in np.flatnonzero(there).tolist()
        )

    def _judged(self, k: int, found: Array, exceeded: bool, planned: float | None) -> FlownInput:
        channel = CHANNELS[self.surfaces[k]]
        peers = (self.unsafe if exceeded else self.safe)[:, k]
        kind = "exceed a limit lie, until they do," if exceeded else "exceed no limit lie"
        levels = [self._level(measure, len(peers)) for measure in MEASURES]
        remarks = []
        for measure, level in zip(MEASURES, levels, strict=True):
            if level is None:
                continue
            least, most = _bounds(peers[:, measure], level / 2)
            worth = LEAST_WORTH[measure]
            if least - worth <= (value := float(found[measure])) <= most + worth:
                continue
            of = ""
            if measure == PEAK:
                what = "planned amplitude" if planned else "median of fresh flights"
                of = f", {100 * value / (planned or self.usual[k]):.0f} % of the {what}"
            remarks.append(
                f"{channel.label}: {WORDS[measure]} {_read(channel, measure, value)}{of}; "
                f"{100 * (1 - level):.4g} % of fresh flights that {kind} between "
                f"{_read(channel, measure, least)} and {_read(channel, measure, most)}"
            )
        return FlownInput(channel.key, float(found[PEAK]), planned, tuple(remarks))

    def _level(self, measure: int, n: int) -> float | None:
        """Share of fresh flights that a measure sets apart; None where n are too few for any.

        The two measures of shape share one level.
        """
        parts = len(self.surfaces) * (1 if measure == PEAK else len(MEASURES) - 1)
        level = max(LEVEL / parts, 2 / (n + 1))
        return level if level <= WORST_LEVEL / parts else None


def amplitude(inputs: Sequence[FlownInput]) -> float | None:
    """Share of the planned amplitude that was flown, on the surface that is to move farthest."""
    main = max(inputs, key=lambda flown: flown.planned or 0.0, default=None)
    return None if main is None else main.share


def amplitude_in_words(shares: Sequence[float]) -> str:
    """Of manoeuvres without an exceedance: how far they went to seek one; "" for none."""
    if not shares:
        return ""
    least, most = (f"{100 * share:.0f}" for share in (min(shares), max(shares)))
    of = least if least == most else f"{least} to {most}"
    what = "a manoeuvre" if len(shares) == 1 else "manoeuvres"
    return f", on {what} of {of} % of the planned amplitude"


def measures(y: Array, last: Indices, dt: float, surfaces: Indices | Sequence[int]) -> Array:
    """Measures of each flight's surfaces over samples 0..last; NaN counts as no deflection.

    y: (n, n_samples, 6) from trim.   last: (n,).   dt: [s].   Returns (n, k, 3).
    """
    deflection = deflections(y, last, surfaces)
    left, right = np.maximum(-deflection, 0).max(axis=1), np.maximum(deflection, 0).max(axis=1)
    peak, other = np.maximum(left, right), np.minimum(left, right)
    moved = peak > 0
    beyond = (np.abs(deflection) >= 0.5 * peak[:, None]).sum(axis=1)
    share = np.divide(other, peak, out=np.zeros_like(peak), where=moved)
    return np.stack([peak, share, np.where(moved, dt * beyond, 0.0)], axis=-1)


class FreshInputs:
    """Gathers what surfaces did in fresh flights, batch by batch."""

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self._measures: list[Array] = []
        self._fails: list[Flags] = []
        self._shapes: FreshShapes | None = None

    def take(self, y: Array, fail_index: Indices) -> None:
        """y: (n, n_samples, 6).   fail_index: (n,), n_samples for a safe flight."""
        last = np.minimum(fail_index, y.shape[1] - 1)
        found = measures(y, last, self.dt, SURFACES)
        if self._shapes is None:
            begun = BEGUN * np.median(found[..., PEAK], axis=0)
            self._shapes = FreshShapes(SURFACES, begun, self.dt)
        self._shapes.take(y, last)
        self._measures.append(found)
        self._fails.append(fail_index < y.shape[1])

    @property
    def support(self) -> InputSupport | None:
        """Of all flights taken; None where none stayed safe, or no surface moved."""
        found, fails = np.concatenate(self._measures), np.concatenate(self._fails)
        usual = np.median(found[..., PEAK], axis=0)
        if fails.all() or not usual.any() or self._shapes is None:
            return None
        main = np.flatnonzero(usual >= MAIN * usual.max())
        safe, unsafe = (np.sort(found[kind][:, main], axis=0) for kind in (~fails, fails))
        return InputSupport(
            np.array(SURFACES)[main], usual[main], safe, unsafe, self._shapes.shape(main)
        )


def _bounds(peers: Array, tail: float) -> tuple[float, float]:
    """Least and most that are not set apart: each side leaves a share `tail` of fresh flights.

    peers: (n,) sorted.
    """
    m = max(1, math.floor(tail * (len(peers) + 1) + 1e-9))
    return float(peers[m - 1]), float(peers[len(peers) - m])


def _read(channel: Channel, measure: int, value: float) -> str:
    return (channel.read(value), f"{100 * value:.0f} %", f"{value:.2f} s")[measure]
