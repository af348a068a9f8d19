"""A recording on the monitor's time grid, without inventing what was not measured.

Offline there is a future to look at, and both methods use a little of it: interpolation the next
recorded sample, averaging half a step and the sample after that. A live monitor at the same
instant would know less; the notes of the result say by how much.
"""

from dataclasses import replace

import numpy as np

from app.telemetry.recording import ATTITUDE, Array, Recording, TelemetryError

RATE_RATIO = 1.5
"""Steps this much longer than the grid's are refused, this much shorter are averaged."""
GAP_RATIO = 1.5
"""Neighbours further apart than this many steps, the longer of the two, have a gap between them."""
MAX_ROWS = 10_000_000
"""More rows than any flight has; a clock that jumps would ask for them."""


def resample(recording: Recording, dt: float) -> Recording:
    """The recording at t[0] + k dt [s], for every k up to its end.

    From a recording more than RATE_RATIO faster than the grid: the mean over t_k - dt/2 to
    t_k + dt/2 of the straight lines between samples, against aliasing. It keeps lines, and scales
    a sine of f [Hz] by sinc(f dt). The first and last row lack half a window and are not averaged.

    From any other: the straight line between the two neighbouring samples, in error by at most
    (2 pi f step)^2 / 8 of a sine's amplitude. A row on a recorded sample (within 1e-6 dt) is that
    sample bit for bit, and a recording that is on the grid altogether is returned as it is.

    A row in a gap, or that needs a missing sample, is NaN. Attitude loses its jumps of a turn.

    Raises TelemetryError for a recording more than RATE_RATIO slower than the grid.
    """
    t = recording.t
    step = float(np.median(np.diff(t)))
    # a clock with a large origin (seconds since 1970) cannot tell times apart any better
    tolerance = max(1e-6 * dt, 2.0 * float(np.spacing(np.abs(t).max())))
    if step > RATE_RATIO * dt + tolerance:
        raise TelemetryError(
            f"the recording has a sample every {step:.4g} s; a monitor with a step of {dt:.4g} s "
            f"needs one at least every {RATE_RATIO * dt:.4g} s: record faster or train a monitor "
            f"with dt={step:.4g}"
        )
    grid = _grid(t, dt, tolerance)
    if len(grid) == len(t) and np.abs(grid - t).max() <= tolerance:
        return recording
    gap = GAP_RATIO * max(dt, step) + tolerance
    attitude = [key for key in ATTITUDE if key in recording.attitude]
    signals = np.column_stack([recording.y, *(_unwrap(recording.attitude[k]) for k in attitude)])
    averaged = RATE_RATIO * step < dt - tolerance
    method = _average if averaged else _interpolate
    rows = method(t, signals, grid, gap, tolerance)
    n = recording.y.shape[1]
    return replace(
        recording,
        t=grid,
        y=np.ascontiguousarray(rows[:, :n]),
        attitude={key: rows[:, n + i].copy() for i, key in enumerate(attitude)},
        notes=(*recording.notes, *_notes(t, step, dt, gap, averaged)),
    )


def _grid(t: Array, dt: float, tolerance: float) -> Array:
    """Times t[0] + k dt up to the last recorded one."""
    steps = (t[-1] - t[0] + tolerance) // dt
    if steps >= MAX_ROWS:
        i = int(np.diff(t).argmax())
        raise TelemetryError(
            f"the recording spans {t[-1] - t[0]:.6g} s, {steps:.3g} steps of {dt:.4g} s where "
            f"{MAX_ROWS:.3g} are the most; its largest step is {t[i + 1] - t[i]:.6g} s after "
            f"t={t[i]:.10g} s: split the file where its clock jumps"
        )
    return t[0] + dt * np.arange(int(steps) + 1)


def _interpolate(t: Array, y: Array, at: Array, gap: float, tolerance: float) -> Array:
    """Straight lines between neighbouring samples; NaN inside a gap; samples themselves exact."""
    after = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    before = after - 1
    step = t[after] - t[before]
    fraction = (at - t[before]) / step
    rows = y[before] + fraction[:, None] * (y[after] - y[before])
    rows[step > gap] = np.nan
    for sample in (before, after):
        on = np.abs(at - t[sample]) <= tolerance
        rows[on] = y[sample[on]]
    return rows


def _average(t: Array, y: Array, grid: Array, gap: float, tolerance: float) -> Array:
    """The mean over one grid step around each row; _interpolate where that leaves the recording.

    The windows' edges join the samples as corners of the polygon, so that each trapezium between
    two corners belongs to one window, and a NaN corner spoils only the windows that it touches.
    """
    rows = _interpolate(t, y, grid, gap, tolerance)
    edges = 0.5 * (grid[1:] + grid[:-1])  # rows 1 to -2 have one on either side
    if len(edges) < 2:
        return rows
    corners = np.union1d(t, edges)
    height = _interpolate(t, y, corners, gap, tolerance)
    area = 0.5 * (height[1:] + height[:-1]) * np.diff(corners)[:, None]
    start = np.searchsorted(corners, edges)
    areas = np.add.reduceat(area[: start[-1]], start[:-1], axis=0)
    rows[1:-1] = areas / np.diff(edges)[:, None]
    return rows


def _unwrap(angle: Array) -> Array:
    """The angle without its jumps of a turn [rad]; NaN stays where it is."""
    known = np.isfinite(angle)
    unwrapped = angle.copy()
    unwrapped[known] = np.unwrap(angle[known])
    return unwrapped


def _notes(t: Array, step: float, dt: float, gap: float, averaged: bool) -> list[str]:
    """What was done, how far a row looks ahead, and how many gaps stayed gaps."""
    steps = np.diff(t)
    ahead = steps[steps <= gap].max()
    if averaged:
        how = f"averages over one step, which look up to {0.5 * dt + ahead:.4g} s ahead"
    else:
        how = f"straight lines between samples, which look up to {ahead:.4g} s ahead"
    notes = [f"Resampled from {1.0 / step:.4g} Hz to {1.0 / dt:.4g} Hz by {how}."]
    holes = steps[steps > gap]
    if len(holes):
        notes.append(
            f"Gaps of more than {gap:.4g} s, left open: {len(holes)}, the longest "
            f"{holes.max():.4g} s."
        )
    return notes
