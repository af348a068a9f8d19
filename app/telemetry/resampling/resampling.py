"""Channels on one time grid, each from its own times, without inventing what was not measured.

Offline there is a future to look at, and a filter without delay uses some of it. A live monitor at
the same instant would know less; the notes of the result say by how much.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from app.telemetry.recording import ATTITUDE, Recording, TelemetryError
from app.telemetry.resampling.resampling_notes import Treatment, notes_on
from app.telemetry.resampling.segments import GAP_RATIO, Course, Grid, course
from app.telemetry.traces import Trace, Traces
from core.channels import KEYS
from core.types import Array, Flags, Indices

CONDITION = ("V", "h")
RATE_RATIO = 1.5
"""Steps this much longer than the grid's are refused of a channel that the monitor needs."""
MAX_ROWS = 10_000_000
"""More rows than any flight has; a clock that jumps would ask for them."""


def on_grid(traces: Traces, dt: float, needed: Collection[str] = KEYS) -> Recording:
    """The channels at t_0 + k dt [s], as long as those that are needed were all being recorded.

    traces: with times that increase, as `repaired` returns them.
    needed: channels that may not be slower than RATE_RATIO dt; any other may, for display.
    t_0: the first time of the slowest needed channel since all needed ones are recorded.

    A channel whose times are all on the grid (within 1e-6 dt) is returned bit for bit, on its own
    times if they are the grid. Any other goes through `low_pass`, at half of the slower of its own
    rate and the grid's, at 1/T: what is below 0.4/T stays within 0.1 %, what would alias into it
    falls below 1/1000, and no channel is delayed. One whose clock is not even comes through local
    cubics first. Attitude loses its jumps of a turn on the way.

    A missing value is treated as a sample that was not taken. Where neighbours are then more than
    1.5 steps apart, of the channel or of the grid, whichever are longer, there is a gap: its rows
    are NaN, and no row takes a sample from beyond it. Shorter holes are bridged by local cubics.
    Rows before the first and after the last value of a channel are NaN. A channel without any
    value, or that is not there, is NaN and not among `columns`.

    Raises TelemetryError for a needed channel that is too slow, where the needed channels have no
    two rows in common, and for a grid of more than MAX_ROWS rows.
    """
    known = {
        key: trace
        for key, trace in traces.channels.items()
        if key in (*KEYS, *ATTITUDE, *CONDITION) and np.isfinite(trace.values).any()
    }
    clocks: dict[int, _Clock] = {}
    grid = _grid({key: known[key].t for key in KEYS if key in needed and key in known}, dt)
    rows, treatments = {}, []
    for key, trace in known.items():
        clock = clocks.get(id(trace.t)) or _Clock(trace.t, grid)
        clocks[id(trace.t)] = clock
        rows[key], treatment = clock.rows(key, trace.values, key in needed)
        treatments.append(treatment)
    y = np.full((grid.n, len(KEYS)), np.nan)
    for c, key in enumerate(KEYS):
        if key in rows:
            y[:, c] = rows.pop(key)
    same = [clock.t for clock in clocks.values() if clock.is_grid]
    return Recording(
        t=np.array(same[0]) if same else grid.t,
        y=y,
        attitude={key: rows[key] for key in ATTITUDE if key in rows},
        condition={key: rows[key] for key in CONDITION if key in rows},
        columns={key: trace.source for key, trace in known.items()},
        derived=frozenset(key for key, trace in known.items() if trace.derived),
        notes=(*traces.notes, *notes_on(grid, treatments)),
    )


def resample(recording: Recording, dt: float) -> Recording:
    """A recording at t[0] + k dt [s] by the same rules; one on that grid is returned as it is."""
    grid = _grid({"the recording": recording.t}, dt)
    if _Clock(recording.t, grid).is_grid:
        return recording
    channels = {
        **dict(zip(KEYS, np.ascontiguousarray(recording.y.T), strict=True)),
        **recording.attitude,
        **recording.condition,
    }
    even = on_grid(
        Traces({key: Trace(recording.t, values) for key, values in channels.items()}), dt
    )
    return replace(
        recording,
        t=even.t,
        y=even.y,
        attitude=even.attitude,
        condition=even.condition,
        notes=(*recording.notes, *even.notes),
    )


def _grid(clocks: dict[str, Array], dt: float) -> Grid:
    """Span the rows that the needed channels have in common."""
    if not clocks:
        raise TelemetryError(
            "none of the channels that the monitor needs has a value: map them to signals of the "
            "file that were recorded"
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
            f"{late} is recorded from {begin:.10g} s and {early} until {end:.10g} s, which leaves "
            f"no two steps of {dt:.4g} s in common: give a recording in which all channels of the "
            "monitor were recorded together, on one clock"
        )
    if steps >= MAX_ROWS:
        i = int(np.diff(slowest).argmax())
        raise TelemetryError(
            f"the recording spans {end - start:.6g} s, {steps:.3g} steps of {dt:.4g} s where "
            f"{MAX_ROWS:.3g} are the most; its largest step is "
            f"{slowest[i + 1] - slowest[i]:.6g} s after t={slowest[i]:.10g} s: split the file "
            "where its clock jumps"
        )
    return Grid(start, dt, int(steps) + 1, tolerance)


@dataclass(eq=False)
class _Clock:
    """The times that some channels share, and what has been found of them on one grid."""

    t: Array
    grid: Grid

    def __post_init__(self) -> None:
        if not (np.diff(self.t) > 0.0).all():
            raise ValueError("times that do not increase cannot be resampled: repair them first")

    @cached_property
    def is_grid(self) -> bool:
        """Whether its times are the grid's."""
        t, grid = self.t, self.grid
        return len(t) == grid.n and bool(np.abs(t - grid.t).max() <= grid.tolerance)

    @cached_property
    def nodes(self) -> Indices | None:
        """Each time's row, where all are on the grid and most neighbours on neighbouring rows."""
        place = (self.t - self.grid.start) / self.grid.dt
        nearest = np.rint(place)
        if np.abs(place - nearest).max() * self.grid.dt > self.grid.tolerance:
            return None
        nodes = nearest.astype(np.intp)
        return nodes if np.mean(np.diff(nodes) == 1) > 0.5 else None

    @cached_property
    def course(self) -> Course:
        """The way of the channels that miss no value."""
        return course(self.t, self.grid)

    def rows(self, key: str, x: Array, needed: bool) -> tuple[Array, Treatment]:
        """A channel's values on the grid, and what was done to them."""
        finite = np.isfinite(x)
        known = np.count_nonzero(finite)
        placed = self.is_grid or self.nodes is not None
        if placed and 3 * known > 2 * len(x):
            return self._placed(key, x, finite)
        way = self.course if known == len(x) else course(self.t[finite], self.grid)
        slow = way.step > RATE_RATIO * self.grid.dt + self.grid.tolerance
        if slow and needed:
            raise TelemetryError(
                f"{key} has a value every {way.step:.4g} s; a monitor with a step of "
                f"{self.grid.dt:.4g} s needs one at least every {RATE_RATIO * self.grid.dt:.4g} s: "
                f"record faster or train a monitor with dt={way.step:.4g}"
            )
        if placed and way.step <= self.grid.dt + self.grid.tolerance:
            return self._placed(key, x, finite)
        own = x[finite] if known < len(x) else x
        rows = way.rows(np.unwrap(own) if key in ATTITUDE else own)
        return rows, Treatment(key, way.step, way.even, slow, way.gaps, way.limit, way.bridged)

    def _placed(self, key: str, x: Array, finite: Flags) -> tuple[Array, Treatment]:
        """Each value on its own row, bit for bit."""
        whole = bool(finite.all())
        limit = GAP_RATIO * self.grid.dt + self.grid.tolerance
        if self.is_grid and whole:
            return np.array(x), Treatment(key, limit=limit)
        nodes = np.arange(len(x)) if self.nodes is None else self.nodes
        nodes, x = (nodes, x) if whole else (nodes[finite], x[finite])
        rows = np.full(self.grid.n, np.nan)
        inside = (nodes >= 0) & (nodes < self.grid.n)
        rows[nodes[inside]] = x[inside]
        steps = np.diff(nodes)
        return rows, Treatment(key, gaps=self.grid.dt * steps[steps > 1], limit=limit)
