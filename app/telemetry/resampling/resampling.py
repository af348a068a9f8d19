"""Resample channels from their own times onto one grid, without inventing values.

Offline a filter without delay uses some future samples. A live monitor would not have them at the
same instant; the notes of the result state by how much.
"""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from app.telemetry.contents import release
from app.telemetry.recording import ATTITUDE, Recording, TelemetryError
from app.telemetry.resampling.resampling_notes import Treatment, notes_on
from app.telemetry.resampling.segments import Grid, ResamplingPlan, resampling_plan
from app.telemetry.traces import GAP_RATIO, Trace, Traces
from core.channels import KEYS
from core.types import Array, Flags, Indices

CONDITION = ("V", "h")
RATE_RATIO = 1.5
"""Longest step of a needed channel, in steps of the grid."""
BLOCK = 65_536
"""Values that are checked at once."""
MAX_ROWS = 10_000_000
"""More than any flight needs; only a clock that jumps exceeds this."""


def on_grid(traces: Traces, dt: float, needed: Collection[str] = KEYS) -> Recording:
    """The channels at t_0 + k dt [s], while all needed channels were being recorded.

    traces: with increasing times, as after `repair`.
    needed: channels with a step of at most RATE_RATIO dt; others may be slower, for display.
    t_0: the first time of the slowest needed channel at which all needed ones are recorded.

    A channel whose times are all on the grid (within 1e-6 dt) is returned bit for bit, on its own
    times if they are the grid. Any other passes through `low_pass`, where 1/T is the slower of its
    own rate and the grid's: content below 0.4/T stays within 0.1 %, aliases fall below 1/1000, and
    there is no delay. A channel with an uneven clock passes through local cubics first. Attitude is
    unwrapped.

    A missing value counts as a sample that was not taken. Neighbours more than 1.5 steps apart (of
    the channel or the grid, whichever is longer) have a gap between them: its rows are NaN, and no
    row uses a sample from beyond it. Shorter holes are bridged by local cubics. Rows before the
    first and after the last value of a channel are NaN. A channel that is absent or has no value is
    NaN and not in `columns`.

    Raises TelemetryError for a needed channel that is too slow, if the needed channels have fewer
    than two common rows, and for a grid of more than MAX_ROWS rows.
    """
    recorded = {
        key: trace
        for key, trace in traces.channels.items()
        if key in (*KEYS, *ATTITUDE, *CONDITION) and _has_value(trace.values)
    }
    grid = _grid({key: recorded[key].t for key in KEYS if key in needed and key in recorded}, dt)
    clocks = {id(trace.t): _GridClock(trace.t, grid) for trace in recorded.values()}
    rows, treatments = {}, []
    for key, trace in recorded.items():
        rows[key], treatment = clocks[id(trace.t)].rows(key, trace.values, key in needed)
        release(trace.values)
        treatments.append(treatment)
    on_the_grid = [clock.t for clock in clocks.values() if clock.is_grid]
    return _recording(
        np.array(on_the_grid[0]) if on_the_grid else grid.t,
        rows,
        recorded,
        (*traces.notes, *notes_on(grid, treatments)),
        max((each.look_ahead(dt) for each in treatments if each.key in needed), default=0.0),
    )


def _recording(
    t: Array,
    rows: dict[str, Array],
    recorded: dict[str, Trace],
    notes: tuple[str, ...],
    look_ahead: float,
) -> Recording:
    """t: (n,) [s].   rows: (n,) by channel; an absent channel is NaN in y."""
    y = np.full((len(t), len(KEYS)), np.nan)
    for column, key in enumerate(KEYS):
        if key in rows:
            y[:, column] = rows[key]
    return Recording(
        t=t,
        y=y,
        attitude={key: rows[key] for key in ATTITUDE if key in rows},
        condition={key: rows[key] for key in CONDITION if key in rows},
        columns={key: trace.source for key, trace in recorded.items()},
        derived=frozenset(key for key, trace in recorded.items() if trace.derived),
        notes=notes,
        look_ahead=look_ahead,
    )


def _grid(clocks: dict[str, Array], dt: float) -> Grid:
    """The rows common to the needed channels. clocks: their times by channel [s]."""
    if not clocks:
        raise TelemetryError(
            "none of the channels that the monitor needs has values: map them to signals that "
            "were recorded"
        )
    late, early = max(clocks, key=lambda k: clocks[k][0]), min(clocks, key=lambda k: clocks[k][-1])
    begin, end = float(clocks[late][0]), float(clocks[early][-1])
    tolerance = max(1e-6 * dt, 2.0 * float(np.spacing(max(abs(begin), abs(end)))))
    slowest = max(clocks.values(), key=lambda t: (t[-1] - t[0]) / max(1, len(t) - 1))
    anchor = int(np.searchsorted(slowest, begin - tolerance))
    start = float(slowest[anchor]) if anchor < len(slowest) else np.inf
    steps = (end - start + tolerance) // dt
    if not steps >= 1:
        raise TelemetryError(
            f"{late} starts at {begin:.10g} s and {early} ends at {end:.10g} s, so they have less "
            f"than one step of {dt:.4g} s in common: give a recording in which all channels of the "
            "monitor were recorded together, on one clock"
        )
    if steps >= MAX_ROWS:
        i = int(np.diff(slowest).argmax())
        raise TelemetryError(
            f"the recording spans {end - start:.6g} s, which is {steps:.3g} steps of {dt:.4g} s, "
            f"more than {MAX_ROWS:.3g}; its largest step is {slowest[i + 1] - slowest[i]:.6g} s "
            f"after t={slowest[i]:.10g} s: split the file where its clock jumps"
        )
    return Grid(start, dt, int(steps) + 1, tolerance)


def _has_value(values: Array) -> bool:
    """Whether any value is finite; usually the first block shows it."""
    blocks = (values[first : first + BLOCK] for first in range(0, len(values), BLOCK))
    return any(np.isfinite(block).any() for block in blocks)


@dataclass(eq=False)
class _GridClock:
    """Times shared by some channels, relative to a grid."""

    t: Array
    grid: Grid

    def __post_init__(self) -> None:
        if not (np.diff(self.t) > 0.0).all():
            raise ValueError("times that do not increase cannot be resampled: repair them first")

    @cached_property
    def is_grid(self) -> bool:
        t, grid = self.t, self.grid
        return len(t) == grid.n and bool(np.abs(t - grid.t).max() <= grid.tolerance)

    @cached_property
    def nodes(self) -> Indices | None:
        """Row of each time, if all are on the grid and most neighbours on adjacent rows."""
        place = (self.t - self.grid.start) / self.grid.dt
        nearest = np.rint(place)
        if np.abs(place - nearest).max() * self.grid.dt > self.grid.tolerance:
            return None
        nodes = nearest.astype(np.intp)
        return nodes if np.mean(np.diff(nodes) == 1) > 0.5 else None

    @cached_property
    def plan(self) -> ResamplingPlan:
        """Plan for channels without missing values."""
        return resampling_plan(self.t, self.grid)

    def rows(self, key: str, x: Array, needed: bool) -> tuple[Array, Treatment]:
        """Values of a channel on the grid, and its treatment."""
        finite = np.isfinite(x)
        n_finite = np.count_nonzero(finite)
        placed = self.is_grid or self.nodes is not None
        if placed and 3 * n_finite > 2 * len(x):
            return self._placed(key, x, finite)
        complete = n_finite == len(x)
        plan = self.plan if complete else resampling_plan(self.t[finite], self.grid)
        dt, tolerance = self.grid.dt, self.grid.tolerance
        slow = plan.step > RATE_RATIO * dt + tolerance
        if slow and needed:
            raise TelemetryError(
                f"{key} has a value every {plan.step:.4g} s, but a monitor with a step of "
                f"{dt:.4g} s needs one at least every {RATE_RATIO * dt:.4g} s: "
                f"record faster or train a monitor with dt={plan.step:.4g}"
            )
        if placed and plan.step <= dt + tolerance:
            return self._placed(key, x, finite)
        values = x if complete else x[finite]
        rows = plan.rows(np.unwrap(values) if key in ATTITUDE else values)
        return rows, Treatment(key, plan.step, plan.even, slow, plan.gaps, plan.limit, plan.bridged)

    def _placed(self, key: str, x: Array, finite: Flags) -> tuple[Array, Treatment]:
        """Put each value on its own row, bit for bit."""
        complete = bool(finite.all())
        limit = GAP_RATIO * self.grid.dt + self.grid.tolerance
        if self.is_grid and complete:
            return np.array(x), Treatment(key, limit=limit)
        nodes = np.arange(len(x)) if self.nodes is None else self.nodes
        nodes, x = (nodes, x) if complete else (nodes[finite], x[finite])
        rows = np.full(self.grid.n, np.nan)
        inside = (nodes >= 0) & (nodes < self.grid.n)
        rows[nodes[inside]] = x[inside]
        steps = np.diff(nodes)
        return rows, Treatment(key, gaps=self.grid.dt * steps[steps > 1], limit=limit)
