"""Identify one aircraft from recorded segments: theta with its full covariance, and its fit.

Unknown noise is estimated from the residuals. They are not white: the model is incomplete, and its
errors last as long as the motion. Cramer-Rao bounds are then several times too small; identified
derivatives scatter five to ten times more between repeated manoeuvres (Maine and Iliff, NASA
RP-1168, section 5.3). So the coloured part of a channel's residuals counts as one independent
sample per swing of the Dutch roll. Contradictory segments leave such residuals in the joint fit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.channels import KEYS, N_CHANNELS
from core.clearance.joint_model import N_OUTPUTS, Law
from core.clearance.posterior import (
    STEPS,
    RecordedStep,
    RecordFit,
    prior_of,
    settle,
)
from core.planned_test.planned_test import DatasetRecipe
from core.simulation.aircraft import Aircraft, IdentifiedAircraft
from core.simulation.control_law import ControlLaw
from core.simulation.imperfections import channel_array
from core.simulation.uncertain_plant import UncertainPlant
from core.types import Array, Flags

FIRST_NOISE = 0.02
"""First guess of an output's noise, as a share of its motion."""
LEAST_SURFACE_NOISE = 0.001
"""Share of the surface's motion; with zero noise the fit stops far from the aircraft."""
ROUNDS, CLOSE = 12, 0.02
"""Largest number of alternations between noise and posterior; relative change that ends them."""
FIRST_STEPS, STEPS_A_ROUND = 5, 1
LEAST_FREE = 0.25
"""Smallest share of degrees of freedom that remains after the fit."""
SHORTEST = 20
"""Fewest samples of a segment."""
LONGEST_SWING_S = 20.0
UNDETERMINED = 0.9
"""A derivative is undetermined if more than this share of the prior's sigma remains."""


@dataclass(frozen=True, eq=False)
class FlownSegment:
    """A segment without gaps, from trim: y (n_samples, 6) each dt [s], SI units, N_y in g.

    An output that was not recorded is NaN throughout.
    ValueError for other shapes and for missing samples.
    """

    y: Array
    dt: float
    name: str = ""

    def __post_init__(self) -> None:
        if self.y.ndim != 2 or self.y.shape[1] != N_CHANNELS or len(self.y) < SHORTEST:
            raise ValueError(
                f"a segment has shape {self.y.shape}: it needs (n_samples, 6) with {SHORTEST} "
                "samples or more"
            )
        if not self.dt > 0.0:
            raise ValueError(f"a segment's samples are {self.dt} s apart: give a positive interval")
        finite = np.isfinite(self.y)
        absent: Flags = ~np.any(finite, axis=0)
        if absent[N_OUTPUTS:].any() or absent[:N_OUTPUTS].all():
            missing = ", ".join(key for key, none in zip(KEYS, absent, strict=True) if none)
            raise ValueError(f"a segment lacks {missing}: both surfaces and one output are needed")
        whole: Flags = np.all(finite | absent, axis=0)
        if not whole.all():
            raise ValueError(
                f"a segment lacks samples of {KEYS[int(whole.argmin())]}: choose one without gaps"
            )
        if not np.ptp(self.y[:, N_OUTPUTS:], axis=0).any():
            raise ValueError("neither surface moves in a segment: choose one with an input")

    @property
    def recorded(self) -> Flags:
        """(6,) recorded channels."""
        return np.isfinite(self.y[0])


@dataclass(frozen=True, eq=False)
class Identification:
    """An aircraft identified from segments.

    names, prior_mean, prior_sigma, mean: (n_params,).   covariance: (n_params, n_params).
    distance: mean square of the posterior deviates of D_theta; about 1 or less if that is right.
    noise: (6,) assumed or estimated, SI units, N_y in g.
    residual_rms: (4,) of the outputs.
    r2: (n_segments, 4) share of each output's variance explained, NaN where not recorded.
    """

    aircraft: Aircraft
    sources: tuple[str, ...]
    names: tuple[str, ...]
    prior_mean: Array
    prior_sigma: Array
    mean: Array
    covariance: Array
    distance: float
    noise: Array
    residual_rms: Array
    r2: Array

    @property
    def sigma(self) -> Array:
        """(n_params,) posterior standard deviation of each parameter."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Uncertain parameters that are barely better known than before."""
        left = self.sigma > UNDETERMINED * self.prior_sigma
        uncertain = self.prior_sigma > 0.0
        return tuple(np.array(self.names)[left & uncertain].tolist())

    @property
    def identified(self) -> IdentifiedAircraft:
        """The identified aircraft, for simulation and for training monitors."""
        return IdentifiedAircraft.of(self.aircraft, self.mean, self.covariance, self.sources)


def identify_test(test: DatasetRecipe, segments: Sequence[FlownSegment]) -> Identification:
    """Identify the aircraft of a planned test from its flown points.

    If the test has imperfections besides noise, the residuals give the uncertainty of the
    derivatives, since they contain them.
    """
    noise = channel_array(test.noise) if test.imperfections.are_none else None
    return identify(test.aircraft, test.control_law, segments, noise)


def identify(
    aircraft: Aircraft,
    law: ControlLaw,
    segments: Sequence[FlownSegment],
    noise: Array | None = None,
) -> Identification:
    """Identify an aircraft with its D_theta as the prior.

    noise: (6,) 1 sigma of each channel if known and white, SI units, N_y in g; None: estimated.
    ValueError without segments, and for an aircraft without uncertainty.
    """
    plant = aircraft.uncertain_plant()
    if not segments:
        raise ValueError("no segment was given: identification needs at least one")
    if not (n_deviates := plant.root.shape[1]):
        raise ValueError("no derivative of the aircraft is uncertain: give it a spread")
    control = Law(law.controller(plant), law.actuator)
    assumed = _first_noise(segments) if noise is None else noise
    fits = [RecordFit(plant, control, _record(segment, assumed)) for segment in segments]
    prior = prior_of(plant, 1)
    mean, information = settle(fits, prior, prior.mean, STEPS if noise is not None else FIRST_STEPS)
    for _ in range(ROUNDS if noise is None else 0):
        n_free = sum(part.n_offsets for part in fits) + n_deviates
        fitted = n_free - float(np.trace(np.linalg.inv(information[0])))
        residuals = [part.innovations(mean)[0] for part in fits]
        before, assumed = assumed, _noise(segments, residuals, swing_s(plant), fitted)
        for part in fits:
            part.noise = np.where(part.measured, assumed, np.inf)
        mean, information = settle(fits, prior, mean, STEPS_A_ROUND)
        measured = np.isfinite(before)
        if np.abs(np.log(assumed[measured] / before[measured])).max() < CLOSE:
            mean, information = settle(fits, prior, mean)
            break
    root, known = plant.root, np.asarray(np.linalg.inv(information), np.float64)
    return Identification(
        aircraft=aircraft,
        sources=tuple(segment.name for segment in segments),
        names=plant.names,
        prior_mean=plant.nominal,
        prior_sigma=np.sqrt(np.square(root).sum(axis=1)),
        mean=plant.theta_of(mean)[0],
        covariance=root @ known[0] @ root.T,
        distance=float(np.square(mean).sum() / n_deviates),
        noise=assumed,
        residual_rms=_rms([part.innovations(mean)[0] for part in fits]),
        r2=np.array(
            [
                _r2(s.y, part.output_residuals(mean)[0])
                for s, part in zip(segments, fits, strict=True)
            ]
        ),
    )


def swing_s(plant: UncertainPlant) -> float:
    """Period of the nominal plant's slowest oscillation [s], at most LONGEST_SWING_S."""
    frequency = np.abs(np.linalg.eigvals(plant.nominal_plant().a[0]).imag)
    slowest = frequency[frequency > 1e-6].min(initial=np.inf)
    return float(min(2 * np.pi / slowest, LONGEST_SWING_S)) if slowest < np.inf else LONGEST_SWING_S


def _record(segment: FlownSegment, noise: Array) -> RecordedStep:
    return RecordedStep(
        segment.y[np.newaxis], segment.dt, np.where(segment.recorded, noise, np.inf)
    )


def _first_noise(segments: Sequence[FlownSegment]) -> Array:
    """(6,) share of the motion of outputs, roughness of surfaces; infinite if not recorded."""
    motion = _rms([segment.y - segment.y.mean(axis=0) for segment in segments])
    rough = _rms([roughness(segment.y)[np.newaxis] for segment in segments])
    rough = np.maximum(rough, LEAST_SURFACE_NOISE * motion)
    noise = np.where(np.arange(N_CHANNELS) < N_OUTPUTS, FIRST_NOISE * motion, rough)
    return np.where(np.isnan(noise), np.inf, noise)


def _noise(
    segments: Sequence[FlownSegment], residuals: list[Array], swing: float, fitted: float
) -> Array:
    """(6,) estimated noise: the white part of the residuals, and the rest once per swing.

    The rest is enlarged equally in all outputs, because a model error in one output acts on the
    others.   fitted: effective number of fitted parameters.
    """
    noise = _first_noise(segments)
    white = np.square(_rms([np.diff(left, 3, axis=0) for left in residuals])) / 20.0
    total = np.square(_rms(residuals))
    n = sum(len(left) for left in residuals)
    coloured = np.maximum(total - (1.0 + 3.0 * np.sqrt(3.0 / n)) * white, 0.0)
    swings = [max(1.0, len(s.y) * s.dt / swing) for s in segments]
    available = sum(
        k * np.count_nonzero(s.recorded[:N_OUTPUTS]) for k, s in zip(swings, segments, strict=True)
    )
    lasting = n / sum(swings) * available / max(available - fitted, LEAST_FREE * available)
    inflation = np.nanmax(np.minimum(white, total) / total + lasting * coloured / total)
    noise[:N_OUTPUTS] = np.where(np.isnan(total), np.inf, np.sqrt(inflation * total))
    return noise


def roughness(y: Array) -> Array:
    """(m,) white noise of slow signals (n_samples, m), from their third differences."""
    return 1.4826 * np.median(np.abs(np.diff(y, 3, axis=0)), axis=0) / np.sqrt(20.0)


def _rms(parts: Sequence[Array]) -> Array:
    """(m,) root mean square by channel over all parts (n_samples, m); NaN if never recorded."""
    squares = np.concatenate([np.square(part) for part in parts])
    count = np.isfinite(squares).sum(axis=0)
    return np.sqrt(np.nansum(squares, axis=0) / np.where(count, count, np.nan))


def _r2(y: Array, residuals: Array) -> Array:
    """(4,) explained share of each output's variance."""
    outputs = y[:, :N_OUTPUTS]
    motion = np.square(outputs - outputs.mean(axis=0)).sum(axis=0)
    return 1.0 - np.square(residuals).sum(axis=0) / np.where(motion > 0.0, motion, np.nan)
