"""The response that an identified aircraft predicts for an unused segment, with intervals."""

from typing import NamedTuple

import numpy as np

from core.clearance.identification import FlownSegment, Identification
from core.clearance.joint_model import N_OUTPUTS, N_SURFACES, Law, driven_response
from core.clearance.posterior import RecordedStep, RecordFit
from core.simulation.control_law import ControlLaw
from core.types import Array

DIFFERENCE = 0.01
"""Finite difference in theta, in standard deviations of D_theta."""


class OutputPrediction(NamedTuple):
    """y: (n_samples, 4) predicted.   sigma: (n_samples, 4) of a measured sample about it.
    r2: (4,) by channel.   covered: (4,) share of samples within the 95 % interval."""

    y: Array
    sigma: Array
    r2: Array
    covered: Array


def predict(found: Identification, law: ControlLaw, segment: FlownSegment) -> OutputPrediction:
    """Outputs from the measured surfaces; initial state and biases are fitted.

    segment: with all outputs.
    """
    plant = found.aircraft.uncertain_plant()
    whole = np.linalg.pinv(plant.root)
    mean = (whole @ (found.mean - plant.nominal))[np.newaxis]
    covariance = whole @ found.covariance @ whole.T
    record = RecordedStep(segment.y[np.newaxis], segment.dt, found.noise)
    fit = RecordFit(plant, Law(law.controller(plant), law.actuator), record)
    fit.filter_of(mean)
    for _ in range(2):
        fit.linearise(mean)
        fit.follow(np.zeros_like(mean), np.ones(1))
    residuals, outputs = fit.output_residuals(mean)[0], segment.y[:, :N_OUTPUTS]

    tried = mean + DIFFERENCE * np.vstack([np.zeros(mean.shape[1]), np.eye(mean.shape[1])])
    nx, surfaces = len(plant.states), segment.y[np.newaxis, :, N_OUTPUTS:]
    plants, begins = plant.plants(plant.theta_of(tried)), np.zeros((len(tried), nx))
    driven = driven_response(plants, np.repeat(surfaces, len(tried), 0), segment.dt, begins)
    slopes = (driven[1:] - driven[0]) / DIFFERENCE
    plants = plant.plants(np.repeat(plant.theta_of(mean), nx, axis=0))
    still = np.zeros((nx, len(segment.y), N_SURFACES))
    biases = np.eye(N_OUTPUTS)[:, np.newaxis] * np.ones((len(segment.y), 1))
    free = np.concatenate([driven_response(plants, still, segment.dt, np.eye(nx)), biases])
    scale = found.noise[:N_OUTPUTS]
    basis, flat = ((x / scale).reshape(len(x), -1).T for x in (free, slopes))
    flat = flat - basis @ np.linalg.lstsq(basis, flat, rcond=None)[0]
    slopes = flat.T.reshape(slopes.shape) * scale
    known = np.einsum("ikc,ij,jkc->kc", slopes, covariance, slopes)
    sigma = np.sqrt(known + np.square(found.residual_rms))
    motion = np.square(outputs - outputs.mean(axis=0)).sum(axis=0)
    return OutputPrediction(
        outputs - residuals,
        sigma,
        1.0 - np.square(residuals).sum(axis=0) / motion,
        (np.abs(residuals) <= 1.96 * sigma).mean(axis=0),
    )
