"""The support of a monitor's training: how far fresh flights deviate, by conformal rank."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from core.channels import LATERAL, Dictionary
from core.kernels.deviation import NO_INNOVATION, Innovation, Reference, largest_so_far
from core.kernels.lanes import WIDTH
from core.monitor.calibration import p_values
from core.monitor.file.portable import Section
from core.monitor.file.values import MOST_SAMPLES, check_array, check_count
from core.monitor.validity.input_shape import InputShape
from core.types import Array, Indices

LEVEL = 0.02
"""Accepted share of safe, and of failing, flights wrongly called invalid."""
WORST_LEVEL = 0.1
"""Largest accepted level if fresh flights of one kind are too few for LEVEL."""
LEAST, MOST = 1_000, 5_000
"""Fresh flights to calibrate on; maximum of one kind."""
KINDS, FIELDS = ("safe", "unsafe"), ("n_samples", "level")
INNOVATION_ARRAYS = ("matrix", "offset", "sigma")
INNOVATION_FIELDS = ("n_past", "spacing", "window")
"""Content of the section of a monitor's file."""
NOT_CALIBRATED = (
    "validity is not calibrated: this monitor cannot tell whether a flight resembles its training; "
    "train it again"
)


class SupportError(ValueError):
    """Too few fresh flights to calibrate validity, or for the level."""


@dataclass(frozen=True, eq=False)
class Support:
    """How far fresh simulated flights deviate.

    sigma: (n_channels,) deviation of the monitor's forecast error on safe training rollouts, in the
    channels' units, used by older files; else NaN.
    safe, unsafe: (n, 2) largest forecast error [sigma] and distance [scaled units] of fresh flights
    that stayed safe, and of failing ones up to the failure; each column sorted.
    n_samples: samples per flight.
    level: largest share of safe, and of failing, flights wrongly called invalid.
    innovation: forecast of the responses, whose innovations newer monitors judge.
    """

    sigma: Array
    safe: Array
    unsafe: Array
    n_samples: int
    level: float = LEVEL
    innovation: Innovation = NO_INNOVATION

    def to_section(self) -> Section:
        """Section of a monitor's file; version 1 has residuals, 2 innovations."""
        header = {name: getattr(self, name) for name in FIELDS}
        arrays = {name: getattr(self, name) for name in KINDS}
        if np.isfinite(self.sigma).all():
            return Section("validity", 1, True, header, arrays | {"sigma": self.sigma})
        innovation = self.innovation._asdict()
        header |= {name: innovation.pop(name) for name in INNOVATION_FIELDS}
        return Section("validity", 2, True, header, arrays | innovation)

    @classmethod
    def from_section(
        cls, section: Section, forecasts: bool, dictionary: Dictionary = LATERAL
    ) -> Self:
        """Rebuild it from its section.

        forecasts: whether the predictor of the monitor forecasts outputs.   dictionary: of its
        channels.   ValueError for values that are impossible or that kernels cannot read.
        """
        header, arrays, sigma = section.header, section.arrays, np.full(len(dictionary), np.nan)
        for name in KINDS:
            shape = max(len(arrays[name]), 1), 2
            check_array(f"support {name}", arrays[name], shape, finite=False, ascending=True)
        check_count("support n_samples", header["n_samples"], 1, 2**53)
        if section.version == 1 and forecasts:
            check_array("support sigma", sigma := arrays["sigma"], (len(dictionary),), above=0)
        innovation = NO_INNOVATION if section.version == 1 else _innovation_of(section, dictionary)
        known: dict[str, Any] = {name: header[name] for name in FIELDS}
        known |= {name: arrays[name] for name in KINDS}
        support = cls(sigma=sigma, innovation=innovation, **known)
        support.check_level()
        return support

    @property
    def statistics(self) -> tuple[int, ...]:
        """Columns to test: forecast errors only if there are forecasts."""
        has_forecasts = self.innovation.window > 0 or np.isfinite(self.sigma).all()
        return (0, 1) if has_forecasts else (1,)

    def check_level(self) -> None:
        """SupportError if flights are too few for the level."""
        n_safe, n_unsafe = len(self.safe), len(self.unsafe)
        least = _smallest_level(len(self.statistics), min(n_safe, n_unsafe))
        if not least - 1e-12 <= self.level < 1:
            raise SupportError(
                f"level={self.level} was given: {n_safe} safe and {n_unsafe} failing fresh flights "
                f"support {least:.4g} or more, below 1"
            )

    def p_values(self, largest: Array) -> Array:
        """p-value of each statistic: the larger of the ones among safe and failing flights.

        largest: (n, 2) forecast error and distance.   Returns (n, 2), NaN if not tested.
        """
        p = np.full(largest.shape, np.nan)
        for k in self.statistics:
            p[:, k] = np.maximum(
                p_values(largest[:, k], self.safe[:, k]), p_values(largest[:, k], self.unsafe[:, k])
            )
        return p

    def combined(self, p: Array) -> Array:
        """One p-value for all statistics, by Bonferroni's rule. p: (n, 2).   Returns (n,)."""
        return np.minimum(1.0, len(self.statistics) * np.nanmin(p, axis=1))

    def bounds(self) -> Array:
        """(2,) bounds above which a statistic is invalid: combined p <= level."""
        bounds = np.full(2, np.inf)
        for k in self.statistics:
            bounds[k] = max(
                kind[_rank(self.level, len(self.statistics), len(kind)), k]
                for kind in (self.safe, self.unsafe)
            )
        return bounds


def _innovation_of(section: Section, dictionary: Dictionary) -> Innovation:
    """ValueError for a forecast that is impossible or that kernels cannot read."""
    counts: dict[str, Any] = {name: section.header[name] for name in INNOVATION_FIELDS}
    for name, number in counts.items():
        check_count(f"innovation {name}", number)
    n_known = len(dictionary) * (counts["n_past"] + 1) if counts["n_past"] else 0
    n_outputs, n_controls = (len(dictionary.of_role(role)) for role in ("output", "control"))
    n = n_outputs if n_known else WIDTH // 2
    if n_known and len(section.arrays["sigma"]) > n:
        n += n_controls
    width = -(-2 * n // WIDTH) * WIDTH
    shapes = (n_known, width), (width,), (n,)
    arrays: list[Any] = [np.ascontiguousarray(section.arrays[k]) for k in INNOVATION_ARRAYS]
    for name, array, shape in zip(INNOVATION_ARRAYS, arrays, shapes, strict=True):
        check_array(f"innovation {name}", array, shape, above=0 if name == "sigma" else None)
    innovation = Innovation(*arrays, *counts.values())
    if len({number > 0 for number in counts.values()}) > 1 or innovation.history > MOST_SAMPLES:
        raise ValueError(f"innovation counts {counts} do not match")
    return innovation


@dataclass(frozen=True, eq=False)
class ValidityBasis:
    """Basis for judging a flight: a monitor's memory of its training.

    training_max_abs: (n_channels,) largest magnitude of each channel.   safe_points: (n, d) mapped.
    input_shape: first direction and holds of inputs; None if unknown.
    dictionary: of the channels.
    """

    support: Support
    reference: Reference
    training_max_abs: Array
    safe_points: Array
    input_shape: InputShape | None = None
    dictionary: Dictionary = LATERAL

    @property
    def responses(self) -> tuple[int, ...]:
        """Channels whose innovations are judged: outputs, and surfaces if a pilot moves them."""
        known = *self.dictionary.of_role("output"), *self.dictionary.of_role("control")
        return known[: len(self.reference.innovation.sigma)]


def calibrate(
    reference: Reference, n_samples: int, flights: Iterable[tuple[Array, Indices, *tuple[Any, ...]]]
) -> Support:
    """Calibrate validity on fresh flights, in batches, until both kinds support LEVEL.

    n_samples: per rollout.
    flights: batches of y (n, n_samples, 6) and fail_index (n,), n_samples for a safe flight, that
    neither trained nor tested the monitor. Reads only as many as needed, which depends only on
    their labels, so flights of one kind stay exchangeable.
    SupportError if they are too few for WORST_LEVEL.
    """
    n_statistics = 2 if reference.has_forecasts else 1
    kinds: tuple[list[Array], list[Array]] = [], []
    counts, n_flights, level = [0, 0], 0, math.inf
    for y, fail_index, *_ in flights:
        n_flights += len(y)
        is_unsafe = fail_index < y.shape[1]
        for kind, is_kind in enumerate((~is_unsafe, is_unsafe)):
            chosen = np.flatnonzero(is_kind)[: MOST - counts[kind]]
            last = np.minimum(fail_index[chosen], y.shape[1] - 1)
            largest = largest_so_far(reference, y[chosen], last)
            kinds[kind].append(largest[np.arange(len(chosen)), last])
            counts[kind] += len(chosen)
        level = max(LEVEL, _smallest_level(n_statistics, min(counts)))
        if n_flights >= LEAST and level <= LEVEL:
            break
    if level > WORST_LEVEL:
        needed = math.ceil(n_statistics / WORST_LEVEL - 1 - 1e-9)
        raise SupportError(
            f"validity is not calibrated: of {n_flights} fresh flights {counts[0]} stayed safe and "
            f"{counts[1]} failed, {needed} of each are needed; give more flights, "
            "or change the amplitude or the limit"
        )
    safe, unsafe = (np.sort(np.concatenate(kind), axis=0) for kind in kinds)
    return Support(reference.sigma, safe, unsafe, n_samples, level, reference.innovation)


def _smallest_level(n_statistics: int, n: int) -> float:
    return n_statistics / (n + 1)


def _rank(level: float, n_statistics: int, n: int) -> int:
    """Position, among n sorted values, of the largest valid one."""
    return n - math.floor(level / n_statistics * (n + 1) + 1e-9)
