"""Batches of closed-loop rollouts: the telemetry of each random aircraft."""

from math import ceil, exp, inf, radians

import numpy as np

from core.channels import N_CHANNELS
from core.kernels.closed_loop import input_series
from core.kernels.compiled import in_chunks
from core.kernels.lanes import WIDTH, aligned
from core.kernels.pilot import NOBODY, Pilots
from core.kernels.response import (
    LANES_IWORK,
    SAMPLES,
    Gusts,
    Hold,
    Surfaces,
    roll_out_lanes,
    work,
)
from core.simulation.control_law import FEEDBACK, Actuator, Controller
from core.simulation.uncertain_plant import Plants
from core.types import Array

CHUNK = 64 * WIDTH
"""Rollouts that a thread processes at a time."""
LONGEST_STEP = 0.002
"""[s] Runge-Kutta step where surfaces have limits, and at most a fifth of the fastest time constant
of actuators and law; plants with modes beyond 500 rad/s need smaller steps (substeps)."""
NO_SERIES = np.zeros((2, 1, 1)), np.zeros(1)
NO_GUSTS = Gusts(np.empty((0, 0)), -1)


def roll_out(
    plants: Plants,
    controller: Controller,
    actuator: Actuator,
    pilot: Array,
    dt: float,
    *,
    pedal_lag_s: float = 0.0,
    substeps: int = 1,
    gust: Array | None = None,
    in_loop: Pilots = NOBODY,
    skip: int = 0,
) -> Array:
    """Simulate every plant in closed loop from trim; exact if surfaces have no limits.

    pilot: (1 or n, n_samples, 2) commands [rad] of aileron and rudder; that of sample k acts from
        t_k to t_(k+1) (zero-order hold), through a first-order lag of pedal_lag_s if that is not 0.
    substeps: output samples per step.
    skip: first output samples that are not needed; up to SAMPLES - 1 of them are returned.
    gust: (n, (n_samples - 1) substeps + 1) sideslip [rad] added by the air at each output sample,
        linear in between; it acts on the aircraft and on the vane. Only changes from the first
        sample on count: the aircraft is in trim with that one.
    in_loop: who changes the commands by the outputs FEEDBACK; its `gave_up` is written.
    Returns y (n, (n_samples - 1) substeps + 1, 6) in the order of core.channels; without `skip`
    sample k is y(t_k), before command k has acted. An unstable rollout may grow to inf and NaN;
    non-finite samples exceed every limit. A rollout depends, bit for bit, only on its own plant and
    commands.
    Raises ValueError for shapes that do not match, and for plants that are not finite or too fast.
    """
    n, n_states = plants.a.shape[:2]
    _check_shapes(plants, controller, pilot)
    n_out = (pilot.shape[1] - 1) * substeps + 1
    out = np.empty((n, n_out - skip // SAMPLES * SAMPLES, N_CHANNELS))
    plants = Plants(*(np.ascontiguousarray(matrix, dtype=np.float64) for matrix in plants))
    law = tuple(np.ascontiguousarray(matrix, dtype=np.float64) for matrix in controller)
    step = dt / substeps
    if len(in_loop.axes):
        pilot = np.broadcast_to(pilot, (n, *pilot.shape[1:]))
    pilot = np.ascontiguousarray(pilot, dtype=np.float64)
    gusts = NO_GUSTS
    if gust is not None:
        if gust.shape != (n, n_out):
            raise ValueError(f"gust has shape {gust.shape}: give {(n, n_out)}")
        gusts = Gusts(np.ascontiguousarray(gust, dtype=np.float64), sideslip_state(plants))
    surfaces = _surfaces(step, actuator, controller, pedal_lag_s)
    series, decays = input_series(step, pedal_lag_s) if surfaces is None else NO_SERIES
    hold = Hold(step, substeps, series, decays)
    about = plants, law, actuator.bandwidth_rad_s, surfaces, pilot, hold, gusts, in_loop
    size = work(n_states, len(controller.a), pilot.shape[1], n_out, in_loop)

    def simulate(start: int, stop: int) -> None:
        room = aligned(size), np.empty(LANES_IWORK, np.int64)
        failed = roll_out_lanes(*about, *room, out, start, stop)
        if failed >= 0:
            raise ValueError(_failure(plants, failed, step))

    in_chunks(n, CHUNK, simulate)
    return out


def _check_shapes(plants: Plants, controller: Controller, pilot: Array) -> None:
    """The kernels use addresses, without bounds checks."""
    (n, nx), m, n_inputs = plants.a.shape[:2], len(controller.a), len(FEEDBACK)
    outputs = (n, N_CHANNELS, nx), (n, N_CHANNELS, 2)
    needed = (n, nx, nx), (n, nx, 2), *outputs, (m, m), (m, n_inputs), (2, m), (2, n_inputs)
    given = tuple(matrix.shape for matrix in (*plants, *controller))
    if given != needed or pilot.ndim != 3 or len(pilot) not in (1, n) or pilot.shape[2] != 2:
        raise ValueError(
            f"plants and law have the shapes {given}, commands {pilot.shape}: give {needed} and "
            f"(1 or {n}, n_samples, 2)"
        )


def sideslip_state(plants: Plants) -> int:
    """Number of the state that is sideslip, on which gusts act; ValueError without one."""
    row = plants.c[0, 0]
    is_beta = np.flatnonzero(row)
    same = (plants.c[:, 0] == row).all() and not plants.d[:, 0].any()
    if len(is_beta) != 1 or row[is_beta[0]] != 1.0 or not same:
        raise ValueError(
            "sideslip is not one of the plant's states, so a gust cannot act on it; make beta a "
            "state (in C a row of 0 with one 1), or fly without gust"
        )
    return int(is_beta[0])


def _surfaces(
    step: float, actuator: Actuator, controller: Controller, lag_s: float
) -> Surfaces | None:
    """Limits of the surfaces, None if there are none. Each output step is divided into parts short
    enough for actuators and law."""
    limits = actuator.rate_limit_deg_s, actuator.position_limit_deg
    if limits == (None, None):
        return None
    law_poles = np.abs(np.linalg.eigvals(controller.a)) if len(controller.a) else np.zeros(1)
    fastest = max(actuator.bandwidth_rad_s, law_poles.max())
    parts = ceil(step / min(LONGEST_STEP, 0.2 / fastest) - 1e-9)
    half_fade = exp(-0.5 * step / parts / lag_s) if lag_s > 0 else 0.0
    rate, position = (inf if limit is None else radians(limit) for limit in limits)
    return Surfaces(actuator.bandwidth_rad_s, rate, position, parts, half_fade)


def _failure(plants: Plants, first: int, step: float) -> str:
    """The reason why the block of rollouts starting at `first` failed."""
    last = min(first + WIDTH, len(plants.a)) - 1
    for i in range(first, last + 1):
        if not all(np.isfinite(matrix[i]).all() for matrix in plants):
            return f"plant {i} holds numbers that are not finite; check its uncertainty"
    return (
        f"a plant among {first} to {last} is too fast "
        f"for steps of {step:g} s; check its numbers' size, or give a smaller dt"
    )
