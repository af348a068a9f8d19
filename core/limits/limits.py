"""The limits of a test, and the first exceedance of each trajectory."""

from dataclasses import asdict, dataclass
from typing import Annotated

import numpy as np

from core.bounds import Bounds, check_bounds
from core.channels import KEYS
from core.kernels.reductions import first_exceedance
from core.types import Array, Indices

Magnitude = Annotated[
    float | None, Bounds(above=0, words="a limit is a positive, finite magnitude")
]


@dataclass(frozen=True)
class Limits:
    """Unsafe as soon as the magnitude of one channel reaches its limit: the limit itself is unsafe.

    One optional limit for each channel, in SI units (N_y in g). The default is the paper's.
    """

    beta: Magnitude = None
    p: Magnitude = None
    r: Magnitude = None
    Ny: Magnitude = 0.5
    delta_a: Magnitude = None
    delta_r: Magnitude = None

    def __post_init__(self) -> None:
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

        y: (n, n_samples, 6). A limited channel that is not finite has diverged and exceeds.
        Returns (n,) sample indices; n_samples without an exceedance.
        """
        return first_exceedance(y, self.magnitudes)


SPECIFICATIONS = {"limits": Limits()}

Specification = Limits | str | None
"""What is unsafe for a monitor: limits, a label where only verdicts are known, or None where
unknown. Only limits can be judged from telemetry."""
PlainSpecification = dict[str, float | None] | str | None
"""A specification as JSON: limits by channel, the label, or null."""


def magnitudes_of(specification: Specification) -> Array | None:
    """(6,) largest permitted magnitudes; None without limits."""
    return specification.magnitudes if isinstance(specification, Limits) else None


def specification_to_plain(specification: Specification) -> PlainSpecification:
    return asdict(specification) if isinstance(specification, Limits) else specification


def specification_from_plain(plain: PlainSpecification) -> Specification:
    """Rebuild a specification; channels that are not named have no limit. Raises ValueError."""
    if plain is None or isinstance(plain, str):
        return plain
    if unknown := [key for key in plain if key not in KEYS]:
        raise ValueError(f"limits name the channel {unknown[0]!r}: choose {', '.join(KEYS)}")
    return Limits(**{key: plain.get(key) for key in KEYS})
