"""Aircraft, control law and surfaces as one stochastic system, estimated jointly.

The surfaces that drive an aircraft are measured with noise. Input noise does not average out: it
makes derivatives too small, and undetermined ones look well known. So each surface is a state: the
law's part from the outputs, plus the pilot's part, a twice differentiable Gaussian process (Matern,
nu 5/2), as in Hartikainen and Sarkka, Kalman filtering and smoothing solutions to temporal Gaussian
process regression models (2010). If the real law differs from the stated one, the measured surfaces
show it and the process absorbs the difference.
"""

from math import ceil, log2, sqrt
from typing import NamedTuple

import numpy as np
from scipy.fft import dct

from core.channels import N_CHANNELS
from core.simulation.control_law import FEEDBACK, PHI_STATE, Actuator, Controller
from core.simulation.uncertain_plant import Plants
from core.types import Array

N_OUTPUTS, N_SURFACES = 4, 2
"""beta, p, r, N_y; aileron and rudder."""
LENGTHS_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
RATIOS = (0.0, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
"""Candidate lengths [s] of a surface's motion, and candidate sizes as multiples of the noise."""
TERMS, LARGEST_NORM = 9, 0.5
"""Terms of the exponential's series: exact to 1e-9 up to this norm."""
CHAIN = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, -3.0, -3.0]])
"""Dynamics of a surface, its rate and acceleration, in units of its length."""
CHAIN_COVARIANCE = np.array([[1.0, 0.0, -1 / 3], [0.0, 1 / 3, 0.0], [-1 / 3, 0.0, 1.0]])


class SurfaceMotion(NamedTuple):
    """Motion of each surface of n aircraft: length [s] and size [rad], both (n, 2)."""

    length: Array
    size: Array

    @classmethod
    def likeliest(cls, surfaces: Array, noise: Array, dt: float) -> "SurfaceMotion":
        """Maximise Whittle's likelihood of the measured surfaces without the law's part.

        surfaces: (n, n_samples, 2) [rad], each dt [s].   noise: (2,) 1 sigma [rad], positive.
        """
        n, n_samples, _ = surfaces.shape
        waves = np.asarray(dct(surfaces, norm="ortho", axis=1), np.float64)
        power = np.square(waves[:, 1:]) / np.square(noise)
        omega = np.pi * np.arange(1, n_samples) / (n_samples * dt)
        best = np.full((n, N_SURFACES), -np.inf)
        length, ratio = np.ones((2, n, N_SURFACES))
        for tried_length in LENGTHS_S:
            shape = (1.0 + np.square(omega * tried_length) / 5.0) ** -3
            shape /= shape.mean()
            for tried_ratio in RATIOS:
                expected = 1.0 + tried_ratio**2 * shape
                likelihood = -0.5 * (
                    np.log(expected).sum() + (power / expected[:, np.newaxis]).sum(1)
                )
                better = likelihood > best
                best = np.where(better, likelihood, best)
                length, ratio = (
                    np.where(better, tried, best_so_far)
                    for tried, best_so_far in ((tried_length, length), (tried_ratio, ratio))
                )
        return cls(length, ratio * noise)

    @property
    def rate(self) -> Array:
        """(n, 2) decay rate of the process [1/s]."""
        return sqrt(5.0) / self.length

    def times(self, c: int) -> "SurfaceMotion":
        """Repeat each aircraft c times."""
        return SurfaceMotion(np.repeat(self.length, c, axis=0), np.repeat(self.size, c, axis=0))


class Law(NamedTuple):
    """The control law and the actuators."""

    controller: Controller
    actuator: Actuator


class JointModel(NamedTuple):
    """s_k+1 = f s_k + noise of covariance q,  measured y_k = h s_k + noise.

    s: the aircraft's nx states, the law's part of both surfaces, the law's states, then for each
    surface the pilot's part, its rate and acceleration in units of its length.
    f, q: (n, k, k).   h: (n, 6, k).   start: (n, k, k) covariance of s at the first sample, with
    the aircraft's and the law's states known.
    """

    f: Array
    q: Array
    h: Array
    start: Array


def joint_model(plants: Plants, law: Law, motion: SurfaceMotion, dt: float) -> JointModel:
    """Model of n plants, one sample each dt [s]."""
    flow, h = joint_flow(plants, law, motion)
    n, k = flow.shape[:2]
    density, start = np.zeros((n, k)), np.zeros((n, k, k))
    for surface in range(N_SURFACES):
        first = k - 3 * (N_SURFACES - surface)
        variance = np.square(motion.size[:, surface])
        density[:, first + 2] = 16 / 3 * variance * motion.rate[:, surface]
        start[:, first : first + 3, first : first + 3] = (
            variance[:, np.newaxis, np.newaxis] * CHAIN_COVARIANCE
        )
    # Van Loan, Computing integrals involving the matrix exponential, 1978
    block = np.zeros((n, 2 * k, 2 * k))
    block[:, :k, :k] = -flow
    block[:, k:, k:] = np.swapaxes(flow, 1, 2)
    block[:, np.arange(k), k + np.arange(k)] = density
    steps = exponential(dt * block)
    f = np.swapaxes(steps[:, k:, k:], 1, 2)
    return JointModel(f, f @ steps[:, :k, k:], h, start)


def joint_flow(plants: Plants, law: Law, motion: SurfaceMotion) -> tuple[Array, Array]:
    """System matrix of the joint state (n, k, k) [1/s], and its outputs (n, 6, k)."""
    (n, nx), controller = plants.a.shape[:2], law.controller
    of_law, states = slice(nx, nx + N_SURFACES), slice(nx + N_SURFACES, nx + 2 + len(controller.a))
    k = states.stop + 3 * N_SURFACES
    surfaces = np.zeros((N_SURFACES, k))
    surfaces[:, of_law] = surfaces[:, states.stop :: 3] = np.eye(N_SURFACES)
    seen = np.zeros((n, len(FEEDBACK), k))
    seen[:, :N_CHANNELS, :nx] = plants.c
    seen[:, :N_CHANNELS] += plants.d @ surfaces
    if nx > PHI_STATE:
        seen[:, -1, PHI_STATE] = 1.0
    flow = np.zeros((n, k, k))
    flow[:, :nx, :nx] = plants.a
    flow[:, :nx] += plants.b @ surfaces
    bandwidth = law.actuator.bandwidth_rad_s
    flow[:, of_law] = -bandwidth * (controller.d @ seen)
    flow[:, of_law, states] -= bandwidth * controller.c
    flow[:, of_law, of_law] -= bandwidth * np.eye(N_SURFACES)
    flow[:, states] = controller.b @ seen
    flow[:, states, states] += controller.a
    for surface in range(N_SURFACES):
        pilot = slice(states.stop + 3 * surface, states.stop + 3 * surface + 3)
        flow[:, pilot, pilot] = motion.rate[:, surface, np.newaxis, np.newaxis] * CHAIN
    return flow, seen[:, :N_CHANNELS]


def law_part(law: Law, y: Array, dt: float) -> Array:
    """(n, n_samples, 2) the law's part of the surfaces, from outputs y (n, n_samples, 6) [rad].

    Bank angle is not measured; its feedback is left out.
    """
    controller, bandwidth = law.controller, law.actuator.bandwidth_rad_s
    m = len(controller.a)
    flow = np.zeros((m + N_SURFACES + N_CHANNELS,) * 2)
    flow[:m, :m], flow[:m, -N_CHANNELS:] = controller.a, controller.b[:, :N_CHANNELS]
    flow[m:-N_CHANNELS, :m] = -bandwidth * controller.c
    flow[m:-N_CHANNELS, m:-N_CHANNELS] = -bandwidth * np.eye(N_SURFACES)
    flow[m:-N_CHANNELS, -N_CHANNELS:] = -bandwidth * controller.d[:, :N_CHANNELS]
    step = exponential(dt * flow[np.newaxis])[0, :-N_CHANNELS]
    out, state = np.zeros((*y.shape[:2], N_SURFACES)), np.zeros((len(y), m + N_SURFACES))
    middle = np.nan_to_num(0.5 * (y[:, :-1] + y[:, 1:]))
    for k in range(y.shape[1] - 1):
        state = state @ step[:, :-N_CHANNELS].T + middle[:, k] @ step[:, -N_CHANNELS:].T
        out[:, k + 1] = state[:, m:]
    return out


def driven_response(plants: Plants, surfaces: Array, dt: float, start: Array) -> Array:
    """Outputs (n, n_samples, 4) to surfaces (n, n_samples, 2) [rad], linear between samples.

    start: (n, nx) state at the first sample.
    """
    n, nx = plants.a.shape[:2]
    block = np.zeros((n, nx + 2 * N_SURFACES, nx + 2 * N_SURFACES))
    inputs, slopes = slice(nx, nx + N_SURFACES), slice(nx + N_SURFACES, None)
    block[:, :nx, :nx], block[:, :nx, inputs] = dt * plants.a, dt * plants.b
    block[:, inputs, slopes] = np.eye(N_SURFACES)
    step = exponential(block)[:, :nx]
    along = step[:, np.newaxis, :, inputs] @ surfaces[:, :-1, :, np.newaxis]
    along += step[:, np.newaxis, :, slopes] @ np.diff(surfaces, axis=1)[..., np.newaxis]
    states, state = np.empty((n, surfaces.shape[1], nx, 1)), start[..., np.newaxis]
    states[:, 0] = state
    for k in range(surfaces.shape[1] - 1):
        state = step[:, :, :nx] @ state + along[:, k]
        states[:, k + 1] = state
    outputs = plants.c[:, np.newaxis, :N_OUTPUTS] @ states
    outputs += plants.d[:, np.newaxis, :N_OUTPUTS] @ surfaces[..., np.newaxis]
    return outputs[..., 0]


def exponential(x: Array) -> Array:
    """exp(x) of (n, m, m): a power series of x / 2^s, squared s times."""
    norm = float(np.abs(x).sum(axis=2).max(initial=LARGEST_NORM))
    squarings = ceil(log2(norm / LARGEST_NORM))
    x = x / 2.0**squarings
    result = np.eye(x.shape[1])
    for term in range(TERMS, 0, -1):
        result = np.eye(x.shape[1]) + x @ result / term
    for _ in range(squarings):
        result = result @ result
    return result
