"""What unsafe means: the first exceedance of each trajectory of a batch."""

from dataclasses import asdict, dataclass
from typing import Annotated

import numpy as np

from core.bounds import Bounds, check_bounds
from core.channels import KEYS
from core.kernels.exceedance import first_exceedance
from core.types import Array, Indices

Magnitude = Annotated[
    float | None, Bounds(above=0, words="a limit is a positive, finite magnitude")
]


@dataclass(frozen=True)
class Limits:
    """Unsafe as soon as the magnitude of one channel exceeds its limit; the limit itself is unsafe.

    One optional limit a channel, in the channel's SI unit (N_y in g). The default is the paper's.
    """

    beta: Magnitude = None
    p: Magnitude = None
    r: Magnitude = None
    Ny: Magnitude = 0.5
    delta_a: Magnitude = None
    delta_r: Magnitude = None

    def __post_init__(self) -> None:
        """Refuse limits that every flight exceeds, or none."""
        if all(limit is None for limit in asdict(self).values()):
            raise ValueError("no limit was given: set at least one channel's, for example Ny=0.5")
        check_bounds(self, "limit ")

    @property
    def magnitudes(self) -> Array:
        """(6,) limit of each channel in channel order; infinite where there is none."""
        limits = [getattr(self, key) for key in KEYS]
        return np.array([np.inf if limit is None else limit for limit in limits])

    def first_exceedance(self, y: Array) -> Indices:
        """First sample of each trajectory that exceeds a limit.

        y: (n, n_samples, 6). A limited channel that is not finite exceeds: it has diverged.
        Returns (n,) sample indices; n_samples where the limits hold throughout.
        """
        return first_exceedance(y, self.magnitudes)


SPECIFICATIONS = {"limits": Limits()}

Specification = Limits | str | None
"""What unsafe means for a monitor: limits, the label of what is known by its verdicts alone, or
None where it is not known. Only limits can be judged from telemetry."""
PlainSpecification = dict[str, float | None] | str | None
"""A specification as JSON: limits by channel, the label, or null."""


def magnitudes_of(specification: Specification) -> Array | None:
    """(6,) magnitudes that must not be exceeded; None where there are no limits to judge by."""
    return specification.magnitudes if isinstance(specification, Limits) else None


def specification_to_plain(specification: Specification) -> PlainSpecification:
    """Return JSON's types."""
    return asdict(specification) if isinstance(specification, Limits) else specification


def specification_from_plain(plain: PlainSpecification) -> Specification:
    """Rebuild a specification; a channel that is not named has no limit. ValueError."""
    if plain is None or isinstance(plain, str):
        return plain
    if unknown := [key for key in plain if key not in KEYS]:
        raise ValueError(f"limits name the channel {unknown[0]!r}: choose {', '.join(KEYS)}")
    return Limits(**{key: plain.get(key) for key in KEYS})
