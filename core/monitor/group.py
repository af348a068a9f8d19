"""Groups of failing flights: a promise kept over all of them may be broken in each of a few."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from core.channels import CHANNELS
from core.monitor.validity.flown_input import SURFACES
from core.monitor.validity.input_direction import deflections
from core.specification import Specification, magnitudes_of
from core.types import Array, Flags, Indices


@dataclass(frozen=True)
class Grouping(ABC):
    """A rule that sorts failing flights into groups, each flight into one."""

    @abstractmethod
    def groups(
        self, y: Array, fail_index: Indices, specification: Specification
    ) -> dict[str, Flags]:
        """Which flights belong to each group, by its name; empty where there are not two groups.

        y: (n, n_samples, 6).   fail_index: (n,) first sample that exceeds a limit, of each flight.
        """


@dataclass(frozen=True)
class FirstLimit(Grouping):
    """By the limit that a flight exceeds first, which is known only once it is exceeded.

    Of several at one sample, the one exceeded farthest in proportion.
    """

    def groups(
        self, y: Array, fail_index: Indices, specification: Specification
    ) -> dict[str, Flags]:
        """One group for each limit that some flight exceeds first."""
        limits = magnitudes_of(specification)
        if limits is None:
            return {}
        share = np.abs(y[np.arange(len(y)), fail_index]) / limits
        first = np.where(np.isnan(share) & np.isfinite(limits), np.inf, share)
        first = np.nan_to_num(first, nan=-1.0, posinf=np.inf).argmax(axis=1)
        found = {
            f"{channel.label} limit first": first == k
            for k, channel in enumerate(CHANNELS)
            if (first == k).any()
        }
        return found if len(found) > 1 else {}


@dataclass(frozen=True)
class LargestDeflection(Grouping):
    """By thirds of the largest deflection before the failure, of the surface that moves farthest.

    The largest of a flight that fails early may be less than the pilot would have gone on to.
    """

    def groups(
        self, y: Array, fail_index: Indices, specification: Specification
    ) -> dict[str, Flags]:
        """Three groups; none where the deflections scatter by less than .01 deg."""
        if len(y) < len(THIRDS):
            return {}
        peaks = np.abs(deflections(y, fail_index, SURFACES)).max(axis=1)
        peak = np.rad2deg(peaks[:, np.median(peaks, axis=0).argmax()])
        low, high = np.quantile(peak, [1 / 3, 2 / 3]).round(2)
        if not peak.min() < low < high < peak.max():
            return {}
        third = np.searchsorted([low, high], peak, side="right")
        bounds = f"below {low:.2f} deg", f"{low:.2f} to {high:.2f} deg", f"from {high:.2f} deg"
        return {f"{THIRDS[k]} third, {bounds[k]}": third == k for k in range(len(THIRDS))}


THIRDS = "lowest", "middle", "highest"
GROUPINGS: dict[str, Grouping] = {
    "first_limit": FirstLimit(),
    "largest_deflection": LargestDeflection(),
}
