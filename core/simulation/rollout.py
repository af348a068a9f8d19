"""Batches of closed-loop rollouts: the telemetry of each random aircraft."""

from functools import partial
from math import ceil, exp, inf, isfinite, radians

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
    linear_work,
    roll_out_linear,
)
from core.kernels.saturation import (
    Surfaces,
    TimeSteps,
    limited_work,
    roll_out_limited,
)
from core.simulation.control_law import FEEDBACK, PHI_STATE, SURFACES, Actuator, Controller
from core.simulation.uncertain_plant import Plants
from core.types import Array

CHUNK = 64 * WIDTH
"""Rollouts that a thread processes at a time."""
LONGEST_STEP = 0.002
"""[s] Runge-Kutta step where surfaces have limits, and at most a fifth of the fastest time constant
of actuators and law; plants with modes beyond 500 rad/s need smaller steps (substeps)."""
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
    out: Array | None = None,
) -> Array:
    """Simulate every plant in closed loop from trim; exact if surfaces have no limits.

    pilot: (1 or n, n_samples, 2) commands [rad] of aileron and rudder; that of sample k acts from
        t_k to t_(k+1) (zero-order hold), through a first-order lag of pedal_lag_s if that is not 0.
    substeps: output samples per step.   out: written and returned if given.
    skip: first output samples that are not needed; up to SAMPLES - 1 of them are returned.
    gust: (n, (n_samples - 1) substeps + 1) sideslip [rad] added by the air at each output sample,
        linear in between; it acts on the aircraft and on the vane. Only changes from the first
        sample on count: the aircraft is in trim with that one.
    in_loop: who changes the commands by the outputs FEEDBACK; its `gave_up` is written.
    Returns y (n, (n_samples - 1) substeps + 1, 6) in the order of core.channels; without `skip`
    sample k is y(t_k), before command k has acted. An unstable rollout may grow to inf and NaN;
    non-finite samples exceed every limit. A rollout depends, bit for bit, only on its own plant and
    commands.
    Raises ValueError for wrong shapes and non-finite numbers.
    """
    n, n_states, pilot = _checked(plants, controller, pilot, dt, pedal_lag_s, substeps)
    n_out = (pilot.shape[1] - 1) * substeps + 1
    shape = (n, n_out - skip // SAMPLES * SAMPLES, N_CHANNELS)
    out = np.empty(shape) if out is None else _checked_out(out, shape)
    plants = Plants(*(np.ascontiguousarray(matrix, dtype=np.float64) for matrix in plants))
    law = tuple(np.ascontiguousarray(matrix, dtype=np.float64) for matrix in controller)
    m, step = len(controller.a), dt / substeps
    if len(in_loop.axes):
        pilot = np.ascontiguousarray(np.broadcast_to(pilot, (n, *pilot.shape[1:])))
    gusts = NO_GUSTS if gust is None else _gusts(plants, gust, (n, n_out))
    if actuator.rate_limit_deg_s is None and actuator.position_limit_deg is None:
        series, decays = input_series(step, pedal_lag_s)
        hold = Hold(step, substeps, series, decays)
        about = actuator.bandwidth_rad_s, pilot, hold, gusts, in_loop
        kernel = partial(roll_out_linear, plants, law, *about)
        work = linear_work(n_states, m, pilot.shape[1], n_out, in_loop)
    else:
        steps = _runge_kutta(step, actuator, controller, pedal_lag_s, substeps)
        about = _surfaces(actuator), pilot, steps, gusts, in_loop
        kernel = partial(roll_out_limited, plants, law, *about)
        work = limited_work(n_states, m, pilot.shape[1], n_out, in_loop)

    def simulate(start: int, stop: int) -> None:
        failed = kernel(aligned(work), np.empty(LANES_IWORK, np.int64), out, start, stop)
        if failed >= 0:
            raise ValueError(_failure(plants, failed, step))

    in_chunks(n, CHUNK, simulate)
    return out


def _checked(
    plants: Plants,
    controller: Controller,
    pilot: Array,
    dt: float,
    pedal_lag_s: float,
    substeps: int,
) -> tuple[int, int, Array]:
    """Check the input of the kernels; return n, nx and the pilot's commands."""
    if plants.a.ndim != 3 or 0 in plants.a.shape:
        raise ValueError(f"plants.a has shape {plants.a.shape}; it needs (n, nx, nx), n, nx >= 1")
    n, nx, m = len(plants.a), plants.a.shape[1], len(controller.a)
    inputs = len(FEEDBACK)
    needed = {
        "plants.a": (plants.a, (n, nx, nx)),
        "plants.b": (plants.b, (n, nx, 2)),
        "plants.c": (plants.c, (n, N_CHANNELS, nx)),
        "plants.d": (plants.d, (n, N_CHANNELS, 2)),
        "controller.a": (controller.a, (m, m)),
        "controller.b": (controller.b, (m, inputs)),
        "controller.c": (controller.c, (2, m)),
        "controller.d": (controller.d, (2, inputs)),
    }
    for name, (matrix, shape) in needed.items():
        if matrix.shape != shape:
            raise ValueError(f"{name} has shape {matrix.shape}; it needs {shape}")
        if name.startswith("controller") and not np.isfinite(matrix).all():
            raise ValueError(f"{name} holds numbers that are not finite; check the control law")
    if nx <= PHI_STATE and (controller.b[:, -1].any() or controller.d[:, -1].any()):
        raise ValueError(
            f"the control law feeds back phi, but the plant has {nx} states; choose a plant with "
            "phi as its fourth state, or a law without phi"
        )
    pilot = np.ascontiguousarray(pilot, dtype=np.float64)
    if pilot.ndim != 3 or pilot.shape[0] not in (1, n) or pilot.shape[1] < 1 or pilot.shape[2] != 2:
        raise ValueError(
            f"pilot has shape {pilot.shape}; it needs (1 or {n}, n_samples, {len(SURFACES)})"
        )
    if not isfinite(pilot.sum()):
        raise ValueError("pilot holds commands that are not finite; check the manoeuvre")
    if not (isfinite(dt) and dt > 0):
        raise ValueError(f"dt is {dt} s; give a finite step above zero")
    if not (isfinite(pedal_lag_s) and pedal_lag_s >= 0):
        raise ValueError(f"pedal_lag_s is {pedal_lag_s} s; give a finite time, 0 for no lag")
    if substeps < 1:
        raise ValueError(f"substeps is {substeps}; give a whole number, 1 or more")
    return n, nx, pilot


def _gusts(plants: Plants, gust: Array, shape: tuple[int, int]) -> Gusts:
    if gust.shape != shape:
        raise ValueError(f"gust has shape {gust.shape}; it needs {shape}")
    if not isfinite(gust.sum()):
        raise ValueError("gust holds numbers that are not finite; check its intensity and scale")
    return Gusts(np.ascontiguousarray(gust, dtype=np.float64), sideslip_state(plants))


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


def _checked_out(out: Array, shape: tuple[int, int, int]) -> Array:
    if out.shape != shape or out.dtype != np.float64 or not out.flags.c_contiguous:
        raise ValueError(
            f"out has shape {out.shape}, {out.dtype}; it needs {shape}, float64, C-contiguous"
        )
    if not out.flags.writeable:
        raise ValueError("out is read-only; give an array that may be written")
    return out


def _surfaces(actuator: Actuator) -> Surfaces:
    limits = actuator.rate_limit_deg_s, actuator.position_limit_deg
    rate, position = (inf if limit is None else radians(limit) for limit in limits)
    return Surfaces(actuator.bandwidth_rad_s, rate, position)


def _runge_kutta(
    step: float, actuator: Actuator, controller: Controller, lag_s: float, substeps: int
) -> TimeSteps:
    """Divide each output step into parts short enough for actuators and law."""
    law_poles = np.abs(np.linalg.eigvals(controller.a)) if len(controller.a) else np.zeros(1)
    fastest = max(actuator.bandwidth_rad_s, law_poles.max())
    parts = ceil(step / min(LONGEST_STEP, 0.2 / fastest) - 1e-9)
    half_fade = exp(-0.5 * step / parts / lag_s) if lag_s > 0 else 0.0
    return TimeSteps(step, substeps, parts, half_fade)


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
