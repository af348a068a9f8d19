"""Imperfections of real flights: gust, instrument errors, inexact inputs."""

from dataclasses import dataclass, replace
from functools import cached_property
from math import exp, radians
from typing import Annotated, ClassVar

import numpy as np

from core.bounds import NOT_NEGATIVE, check_bounds
from core.channels import KEYS, LATERAL, Dictionary
from core.kernels.compiled import in_chunks
from core.kernels.imperfections import (
    IWORK,
    QUANTILES,
    InexactInputs,
    Instruments,
    commands_work,
    fill_commands,
    means_at_rest,
    record,
    record_work,
)
from core.kernels.lanes import aligned
from core.simulation.turbulence import (
    LateralGust,
    Turbulence,
    intensity,
    scale_length,
)
from core.types import Array, Flags, Indices

RUN_UP_S = 3.0
"""[s] Gust and trim error act this long before a rollout's first sample, so that the aircraft
already moves, as in flight."""
UNSTEADY_S = 1.0
"""[s] Time constant of a pilot's small movements: white noise through a first-order lag."""
CHUNK = 128
"""Rollouts that a thread records at a time."""


def channel_array(by_channel: object, keys: tuple[str, ...] = KEYS) -> Array:
    """Numbers of an object with an attribute for each channel key; 0 for those it does not have."""
    return np.array([getattr(by_channel, key, 0.0) for key in keys], dtype=np.float64)


NotNegative = Annotated[float, NOT_NEGATIVE]


@dataclass(frozen=True)
class ByChannel:
    """One number of each channel, in its SI unit (N_y in g)."""

    called: ClassVar[str]
    beta: NotNegative = 0.0
    p: NotNegative = 0.0
    r: NotNegative = 0.0
    Ny: NotNegative = 0.0
    delta_a: NotNegative = 0.0
    delta_r: NotNegative = 0.0

    def __post_init__(self) -> None:
        check_bounds(self, f"{self.called} ")


@dataclass(frozen=True)
class Quantisation(ByChannel):
    """Step between recorded values, by channel, in its SI unit (N_y in g); 0 for none.

    The trim may lie anywhere between two values.
    """

    called: ClassVar[str] = "quantisation"

    @classmethod
    def of_words(cls, bits: int) -> "Quantisation":
        """Steps of words with this many bits over +-30 deg, +-120 deg/s, +-60 deg/s and +-1 g."""
        part = 2.0 ** (1 - bits)
        angle = radians(30.0) * part
        return cls(angle, radians(120.0) * part, radians(60.0) * part, part, angle, angle)


@dataclass(frozen=True)
class Imperfections:
    """Effects of real flights besides noise and jitter, drawn for each rollout; 0 for none.

    Limits are judged on the true outputs from trim, including gust; gain, lag, noise, quantisation
    and bias are added after. With any imperfection, trim is the mean of the trim segment and is
    subtracted, as for a recorded flight.
    """

    turbulence: Turbulence = "none"
    """lateral gust: Dryden's spectrum (MIL-F-8785C, MIL-HDBK-1797), scaled for altitude and true
    airspeed. `smooth` is 0.3 m/s at any altitude; `light`, `moderate` and `severe` depend on
    altitude: below 1000 ft for winds of 15, 30 and 45 kt, above 2000 ft exceeded with probability
    1e-2, 1e-3 and 1e-5; `given` uses the next two numbers."""
    gust_sigma_deg: NotNegative = 0.15
    """gust as sideslip: 1 sigma, for `given`, or where the aircraft's altitude or airspeed is
    unknown."""
    gust_time_s: NotNegative = 4.0
    """time constant of the gust: scale length over airspeed, for a gust given as sideslip; default
    1750 ft at 133 m/s."""
    least_height_m: NotNegative = 305.0
    """least height above ground: models at lower altitudes have the gusts of this height, because
    tests are not flown near the ground [m]."""
    gain: NotNegative = 0.0
    """gain error of each channel: standard deviation, normal, as a fraction of its reading, after
    calibration (Maine and Iliff, NASA RP-1168, on instrumentation)."""
    bias: NotNegative = 0.0
    """bias of each channel: standard deviation, normal, as a multiple of its noise; the drift of a
    sensor since trim (NASA RP-1168)."""
    lag_s: NotNegative = 0.0
    """transport lag of each channel: uniform from 0 to this, independent between channels; from
    filters, sampling and transmission (NASA RP-1168, on time skews)."""
    trim_deg: NotNegative = 0.0
    """trim error of each surface: standard deviation, normal, of a constant command added to the
    one that holds trim."""
    unsteadiness_deg: NotNegative = 0.0
    """unsteadiness of each control: standard deviation, normal, of the pilot's unintended small
    movements, on both controls, lasting about a second (remnant of the human pilot,
    AGARD-AG-188)."""
    asymmetry: NotNegative = 0.0
    """asymmetry of the inputs: standard deviation, normal, of the fraction by which commands to one
    side are larger than planned and those to the other side smaller."""
    softness_s: NotNegative = 0.0
    """softness of the inputs: largest additional lag of stick and pedals [s], first order; uniform
    from 0 to this, one for each rollout."""
    quantisation: Quantisation = Quantisation()
    """quantisation of each channel: step between recorded values; 0 for none. Usual: words of 12
    bits (IRIG 106) over +-30 deg, +-120 deg/s in roll, +-60 deg/s in yaw and +-1 g."""

    def __post_init__(self) -> None:
        check_bounds(self)
        if self.turbulence != "none" and self.gust_time_s == 0:
            raise ValueError("gust_time_s=0 was given: give a time above zero")

    @cached_property
    def are_none(self) -> bool:
        """Whether rollouts have no effects besides noise and jitter."""
        none = Imperfections()
        same = replace(
            self,
            gust_sigma_deg=none.gust_sigma_deg,
            gust_time_s=none.gust_time_s,
            least_height_m=none.least_height_m,
        )
        return same == none

    def gust(self, altitude: float | None, airspeed: float | None) -> LateralGust | None:
        """The gust as sideslip [rad] at an altitude [m] and true airspeed [m/s]; None without."""
        if self.turbulence == "none":
            return None
        if self.turbulence == "given" or altitude is None or airspeed is None:
            return LateralGust(radians(self.gust_sigma_deg), self.gust_time_s)
        height = max(altitude, self.least_height_m)
        return LateralGust(
            intensity(self.turbulence, height) / airspeed, scale_length(height) / airspeed
        )

    def run_up(self, dt: float) -> int:
        """Samples before a rollout's first one."""
        lasting = self.turbulence != "none" or self.trim_deg or self.unsteadiness_deg
        return round(RUN_UP_S / dt) if lasting else 0

    def unused(self, dt: float, substeps: int) -> int:
        """Steps at the beginning of the run-up that no record reads."""
        return max(self.run_up(dt) * substeps - 1 - int(self.lag_s / (dt / substeps)), 0)

    def fly(
        self, planned: Array, n: int, dt: float, most: int, seed: np.uint64, number: int = 0
    ) -> tuple[Array, Indices]:
        """Planned commands (1 or n, n_samples, n_surfaces) [rad] as n pilots fly them.

        Returns the commands, with the run-up before them, and (n,) the samples at rest before the
        first planned input, from 1 to `most`; trim is their mean.   number: as in `record`.
        """
        before = self.run_up(dt)
        planned = np.ascontiguousarray(planned)
        n_samples, n_surfaces = planned.shape[1:]
        out = np.empty((n, before + n_samples, n_surfaces))
        rest = np.empty(n, np.int64)
        most = max(most, 1)
        inexact = InexactInputs(
            self.asymmetry,
            radians(self.trim_deg),
            radians(self.unsteadiness_deg),
            exp(-dt / UNSTEADY_S),
            self.softness_s / dt,
        )
        size = commands_work(before + n_samples, n_samples, n_surfaces)

        def fill(first: int, last: int) -> None:
            work = QUANTILES, aligned(size), np.empty(IWORK, np.int64)
            fill_commands(
                seed, number, planned, before, most, inexact, *work, out, rest, first, last
            )

        in_chunks(n, CHUNK, fill)
        return out, rest

    def record(
        self,
        y: Array,
        trim: Array,
        start: int,
        every: int,
        rest: Indices,
        noise: Array,
        step: float,
        seed: np.uint64,
        dictionary: Dictionary = LATERAL,
        number: int = 0,
        out: Array | None = None,
    ) -> Array:
        """Record true outputs (n, n_samples, n_channels), each rollout with its own errors.

        y: (n, n_steps, n_channels), one row each `step` s; every `every`-th from `start` on is
        recorded.   trim: (n, n_channels), of `trim_of`.   rest: of `fly`.
        noise: (n_channels,) 1 sigma.
        dictionary: its measured channels are those of y; absolute ones keep their trim.
        number: of the first of these rollouts among all of the seed.   out: written if given.
        """
        keys, n_channels = dictionary.measured, y.shape[2]
        if out is None:
            out = np.empty((len(y), (y.shape[1] - start - 1) // every + 1, n_channels))
        instruments = Instruments(
            gain=np.full(n_channels, self.gain),
            bias=self.bias * noise,
            noise=noise,
            lag=np.full(n_channels, self.lag_s / step),
            step=channel_array(self.quantisation, keys),
            from_trim=counts_from_trim(dictionary),
        )
        size = record_work(y.shape[1], *out.shape[1:])

        def fill(first: int, last: int) -> None:
            work = QUANTILES, aligned(size), np.empty(IWORK, np.int64)
            about = y, trim, start, every, rest, instruments
            record(seed, number, *about, *work, out, first, last)

        in_chunks(len(y), CHUNK, fill)
        return out


def counts_from_trim(dictionary: Dictionary) -> Flags:
    """(n_measured,) whether a measured channel counts from trim; else it is absolute."""
    by_key = dictionary.by_key
    return np.array([by_key[key].reference == "trim" for key in dictionary.measured])


def trim_of(
    y: Array, start: int, every: int, rest: Indices, dictionary: Dictionary = LATERAL
) -> Array:
    """(n, n_channels) mean at rest of the channels that count from trim; 0 for the others.

    Arguments as in `record`.
    """
    return means_at_rest(y, start, every, rest, counts_from_trim(dictionary))


def seed_of(rng: np.random.Generator) -> np.uint64:
    """Draw the seed of the streams of many rollouts."""
    return rng.integers(2**64, dtype=np.uint64)


USUAL_IMPERFECTIONS = Imperfections(
    turbulence="smooth",
    gain=0.02,
    bias=0.5,
    lag_s=0.03,
    trim_deg=0.05,
    unsteadiness_deg=0.1,
    asymmetry=0.05,
    quantisation=Quantisation.of_words(12),
)
"""Smooth air and calibrated instruments, in round numbers.

One record of a rudder doublet is valid with an unsteadiness of 0.05, 0.1 and 0.2 deg; no other
number was fitted to records.
"""
