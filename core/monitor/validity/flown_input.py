"""The flown input compared with the planned one: size, symmetry and duration of deflections.

Measured by conformal rank among fresh flights, on both sides. A difference does not withdraw the
monitor: a doublet of half the amplitude is flown by the same aircraft, it only shows less of the
limit. An input that begins in the other direction, lasts longer or is softer does withdraw: see
`InputShape`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from core.channels import LATERAL, Channel, Dictionary
from core.monitor.file.portable import Section
from core.monitor.file.values import check_array
from core.monitor.validity.input_shape import BEGUN, FreshShapes, InputShape, deflections
from core.monitor.validity.support import LEVEL, WORST_LEVEL
from core.types import Array, Flags, Indices

SURFACES = LATERAL.of_role("control")
ARRAYS = {"surfaces": "surfaces", "planned": "usual", "safe": "safe", "unsafe": "unsafe"}
"""Arrays in the section of a monitor's file, and their fields of InputSupport."""
SHAPE = "begun", "flights", "longest_s", "softest"
"""Its arrays of `InputShape`; older files lack the last ones, or all."""
MEASURES = PEAK, OTHER_SIDE, LASTING = range(3)
WORDS = (
    "largest deflection",
    "deflection to the other side, as a share of the largest,",
    "time beyond half the largest deflection",
)
LEAST_WORTH = (0.0, 0.05, 0.1)
"""Minimum distance from the fresh flights for a remark, per measure: simulated pilots may be more
regular than any person."""
MAIN = 0.5
"""The manoeuvre moves a surface if its usual peak is at least this share of the largest one;
surfaces that move less follow a control law or are held."""


@dataclass(frozen=True)
class FlownInput:
    """How a surface was moved. channel: key of the surface.

    peak: largest magnitude [rad].   planned: planned amplitude [rad], None if unknown or if the
    manoeuvre does not command it.   remarks: differences from fresh flights; empty if similar.
    """

    channel: str
    peak: float
    planned: float | None
    remarks: tuple[str, ...] = ()

    @property
    def share(self) -> float | None:
        """Flown share of the planned amplitude."""
        return self.peak / self.planned if self.planned else None


@dataclass(frozen=True, eq=False)
class InputSupport:
    """How surfaces moved in fresh simulated flights.

    surfaces: (k,) channel numbers of the surfaces that the manoeuvre moves.
    usual: (k,) median peak over all flights [rad].
    safe, unsafe: (n, k, 3) of fresh flights that stayed safe, and of failing ones up to the
    failure, each measure sorted: peak [rad], largest deflection to the other side as a share of the
    peak, time beyond half the peak [s].
    shape: first direction, duration of holds and sharpness; None in older files.
    dictionary: of the channels.
    """

    surfaces: Indices
    usual: Array
    safe: Array
    unsafe: Array
    shape: InputShape | None = None
    dictionary: Dictionary = LATERAL

    def check(self) -> None:
        k = len(self.surfaces)
        check_array("input surfaces", self.surfaces, (k,), np.int64)
        if not set(self.surfaces.tolist()) <= set(self.dictionary.of_role("control")):
            raise ValueError(f"input surfaces are {self.surfaces}")
        for name, array in (("safe", self.safe), ("unsafe", self.unsafe)):
            shape = len(array), k, len(MEASURES)
            check_array(f"input {name}", array, shape, least=0, ascending=True)
        check_array("input planned", self.usual, (k,), above=0)
        if self.shape is not None:
            self.shape.check()

    def to_section(self) -> Section:
        """Section of a monitor's file; programs that do not support it may ignore it."""
        arrays: dict[str, Any] = {name: getattr(self, field) for name, field in ARRAYS.items()}
        if self.shape is not None:
            known = SHAPE if self.shape.softest.any() else SHAPE[:-1]
            arrays |= {name: getattr(self.shape, name) for name in known}
        return Section("input", 1, False, {}, arrays)

    @classmethod
    def from_section(cls, section: Section, dictionary: Dictionary = LATERAL) -> Self:
        """Rebuild it from its section. ValueError."""
        arrays: dict[str, Any] = {field: section.arrays[name] for name, field in ARRAYS.items()}
        if "begun" in section.arrays:
            k = len(arrays["surfaces"])
            older: dict[str, Any] = {"longest_s": np.empty((k, 0)), "softest": np.zeros(k)}
            known = {name: section.arrays[name] for name in SHAPE if name in section.arrays}
            arrays["shape"] = InputShape(
                arrays["surfaces"], **(older | known), dictionary=dictionary
            )
        support = cls(**arrays, dictionary=dictionary)
        support.check()
        return support

    def judge(
        self, y: Array, dt: float, exceeded: bool, planned: Array | None = None
    ) -> tuple[FlownInput, ...]:
        """Compare a flight with fresh ones; one entry per recorded surface.

        y: (n, 6) from trim, up to the first exceedance if any; NaN if unknown.
        dt: [s].   exceeded: whether there is one.   planned: (2,) planned amplitude of each of
        SURFACES [rad]; None if unknown.
        """
        recorded = np.isfinite(y[:, self.surfaces]).any(axis=0)
        values = measures(y[None], np.array([len(y) - 1]), dt, self.surfaces)[0]
        amplitudes = dict(zip(SURFACES, [] if planned is None else planned.tolist(), strict=False))
        return tuple(
            self._judged(k, values[k], exceeded, amplitudes.get(int(self.surfaces[k])) or None)
            for k in np.flatnonzero(recorded).tolist()
        )

    def _judged(self, k: int, values: Array, exceeded: bool, planned: float | None) -> FlownInput:
        channel = self.dictionary.channels[self.surfaces[k]]
        peers = (self.unsafe if exceeded else self.safe)[:, k]
        kind = "that exceed a limit" if exceeded else "without an exceedance"
        levels = [self._level(measure, len(peers)) for measure in MEASURES]
        remarks = []
        for measure, level in zip(MEASURES, levels, strict=True):
            if level is None:
                continue
            least, most = _bounds(peers[:, measure], level / 2)
            worth = LEAST_WORTH[measure]
            if least - worth <= (value := float(values[measure])) <= most + worth:
                continue
            share = ""
            if measure == PEAK:
                reference = "planned amplitude" if planned else "median of fresh flights"
                share = f", {100 * value / (planned or self.usual[k]):.0f} % of the {reference}"
            remarks.append(
                f"{channel.label}: {WORDS[measure]} {_read(channel, measure, value)}{share}; "
                f"{100 * (1 - level):.4g} % of fresh flights {kind} are between "
                f"{_read(channel, measure, least)} and {_read(channel, measure, most)}"
            )
        return FlownInput(channel.key, float(values[PEAK]), planned, tuple(remarks))

    def _level(self, measure: int, n: int) -> float | None:
        """Share of fresh flights that a measure flags; None if n flights are too few.

        The two measures of shape share one level.
        """
        parts = len(self.surfaces) * (1 if measure == PEAK else len(MEASURES) - 1)
        level = max(LEVEL / parts, 2 / (n + 1))
        return level if level <= WORST_LEVEL / parts else None


def amplitude(inputs: Sequence[FlownInput]) -> float | None:
    """Flown share of the planned amplitude, on the surface with the largest planned one."""
    main = max(inputs, key=lambda flown: flown.planned or 0.0, default=None)
    return None if main is None else main.share


def amplitude_in_words(shares: Sequence[float]) -> str:
    """Phrase for the flown amplitude of manoeuvres without an exceedance; "" for none."""
    if not shares:
        return ""
    least, most = (f"{100 * share:.0f}" for share in (min(shares), max(shares)))
    amount = least if least == most else f"{least} to {most}"
    flown = "a manoeuvre" if len(shares) == 1 else "manoeuvres"
    return f", on {flown} of {amount} % of the planned amplitude"


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
    """Gathers the surface movements of fresh flights, batch by batch."""

    def __init__(self, dt: float, dictionary: Dictionary = LATERAL) -> None:
        self.dt, self.dictionary = dt, dictionary
        self._controls = dictionary.of_role("control")
        self._measures: list[Array] = []
        self._fails: list[Flags] = []
        self._shapes: FreshShapes | None = None

    def add(self, y: Array, fail_index: Indices) -> None:
        """Add a batch. y: (n, n_samples, 6).   fail_index: (n,), n_samples for a safe flight."""
        last = np.minimum(fail_index, y.shape[1] - 1)
        values = measures(y, last, self.dt, self._controls)
        if self._shapes is None:
            begun = BEGUN * np.median(values[..., PEAK], axis=0)
            self._shapes = FreshShapes(self._controls, begun, self.dt, self.dictionary)
        self._shapes.add(y, last)
        self._measures.append(values)
        self._fails.append(fail_index < y.shape[1])

    @property
    def support(self) -> InputSupport | None:
        """From all flights added; None if none stayed safe or no surface moved."""
        values, fails = np.concatenate(self._measures), np.concatenate(self._fails)
        usual = np.median(values[..., PEAK], axis=0)
        if fails.all() or not usual.any() or self._shapes is None:
            return None
        main = np.flatnonzero(usual >= MAIN * usual.max())
        safe, unsafe = (np.sort(values[kind][:, main], axis=0) for kind in (~fails, fails))
        return InputSupport(
            np.array(self._controls)[main],
            usual[main],
            safe,
            unsafe,
            self._shapes.shape(main),
            self.dictionary,
        )


def _bounds(peers: Array, tail: float) -> tuple[float, float]:
    """Bounds that leave a share `tail` of fresh flights outside on each side.

    peers: (n,) sorted.
    """
    m = max(1, math.floor(tail * (len(peers) + 1) + 1e-9))
    return float(peers[m - 1]), float(peers[len(peers) - m])


def _read(channel: Channel, measure: int, value: float) -> str:
    return (channel.read(value), f"{100 * value:.0f} %", f"{value:.2f} s")[measure]
