"""The planned manoeuvre as pilot commands, with the pilot's scatter in timing and amplitude.

Commands are constant over each step, with the value at t_k = k dt for sample k. All start at trim.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from itertools import accumulate, pairwise
from math import inf, isfinite, log
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np

from core.bounds import Bounds, check_bounds
from core.kernels.imperfections import levels_at
from core.recipe import family
from core.types import Array

Surface = Literal["aileron", "rudder", "elevator"]
Spacing = Literal["log", "linear"]
Interpolation = Literal["hold", "linear"]

Axis = Literal["bank", "sideslip", "pitch", "alpha", "heading"]

COLUMN: dict[Surface, int] = {"aileron": 0, "rudder": 1, "elevator": 2}
"""Column of a surface's command in (delta_a, delta_r, delta_e)."""
MOVED_BY: dict[Axis, Surface] = {
    "bank": "aileron",
    "sideslip": "rudder",
    "pitch": "elevator",
    "alpha": "elevator",
    "heading": "rudder",
}
"""The surface with which a pilot tracks an axis."""
LATERAL_SURFACES, ALL_SURFACES = 2, 3
POSITIVE = Bounds(above=0)
Pull = Annotated[
    float, Bounds(below=0, words="the manoeuvre pulls, so the elevator's amplitude is below 0")
]
TIME_GUARD = 1e-9
"""[s] An input due at t_k starts at sample k, despite rounding of t_k."""
MOST_MOVES = 40
"""Most changes of one command that are written out."""


class Move(NamedTuple):
    """A planned change of a command: start and end [s], and its value then [deg].

    A step ends when it starts; a ramp has a constant rate.
    """

    start: float
    end: float
    value: float

    def __str__(self) -> str:
        if self.end == self.start:
            return f"at {self.start:g} s to {self.value:.3g} deg"
        return f"from {self.start:g} s to {self.end:g} s steadily to {self.value:.3g} deg"


class Hands(NamedTuple):
    """What pilots make of a manoeuvre, each (1 or n, ...): start (, 1) of the first input and
    duration (, n_segments) of each segment [s], and factor () on the commands."""

    start: Array
    segments: Array
    factor: Array

    def some(self, which: slice) -> "Hands":
        return Hands(*(each if len(each) == 1 else each[which] for each in self))


@dataclass(frozen=True, kw_only=True)
class Maneuver(ABC):
    """A trim segment, then inputs in segments; amplitudes in degrees of command, either sign.

    Raises ValueError for non-finite numbers, negative times, frequencies and jitters, and for a
    trim segment as long as the duration.
    """

    duration_s: float = 6.0
    """length of the rollout; longer inputs are cut."""
    lead_in_s: float = 0.5
    """length of the trim segment: before the first input."""
    pedal_lag_s: float = 0.1
    """lag of stick and pedals: first order; the rollout applies it, not `pilot`."""
    timing_jitter_s: float = 0.0
    """scatter of the timing: standard deviation, normal, of the first input's start and,
    independently, of every segment's duration; later segments shift accordingly. A start before
    t = 0 becomes 0, and so does a negative duration; a segment planned with 0 s is left out."""
    amplitude_jitter: float = 0.0
    """scatter of the amplitude: standard deviation of a common factor 1 + jitter on all commands of
    a rollout."""
    build_up: tuple[float, ...] = ()
    """steps of a build-up: shares of the amplitude; each rollout flies one, drawn at random;
    none: the full amplitude."""

    def __post_init__(self) -> None:
        check_bounds(self)
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, str | Maneuver):
                continue
            numbers = value if isinstance(value, tuple) else (value,)
            signed = entry.name.endswith("_deg")
            if bad := [x for x in numbers if not (isfinite(x) and (signed or x >= 0))]:
                needed = "a finite number" if signed else "a finite number, zero or more"
                raise ValueError(f"{entry.name} is {bad[0]}; give {needed}")
        if not all(self.build_up):
            raise ValueError(
                f"build_up is {self.build_up}: give shares of the amplitude above 0, or none"
            )
        if self.lead_in_s >= self.duration_s:
            raise ValueError(
                f"lead_in_s={self.lead_in_s} leaves nothing of duration_s={self.duration_s}; "
                "give a longer duration or a shorter trim segment"
            )

    @property
    @abstractmethod
    def segments_s(self) -> tuple[float, ...]:
        """Planned duration of each segment [s]; inf for one that lasts to the end."""

    @property
    @abstractmethod
    def peak_deg(self) -> float:
        """Amplitude, or the largest command of a table, with its sign [deg]."""

    @property
    def n_surfaces(self) -> int:
        """Columns of commands: aileron and rudder, and the elevator if it moves."""
        return LATERAL_SURFACES

    @property
    def captured(self) -> Axis | None:
        """The axis whose targets the commands of its surface are; None: all are commands."""
        return None

    @property
    def corners_s(self) -> tuple[float, ...]:
        """Times after the trim segment; each command is constant or a ramp between two of them."""
        return (0.0, *accumulate(self.segments_s))

    @property
    def moves(self) -> dict[Surface, list[Move]]:
        """Planned changes of each command that moves, without scatter; times from the start."""
        last = self.duration_s - self.lead_in_s
        corners = sorted({round(t, 9) for t in self.corners_s if t < last} | {last})
        sides = np.add.outer(corners, 10.0 * TIME_GUARD * np.array([-1.0, 1.0]))
        reached = self.commands(sides.reshape(1, -1), np.array([self.segments_s]))[0]
        least = 1e-4 * abs(self.peak_deg)
        moves: dict[Surface, list[Move]] = {}
        for surface, c in list(COLUMN.items())[: self.n_surfaces]:
            start, value = self.lead_in_s, 0.0
            each = moves[surface] = []
            values = reached[:, c].reshape(sides.shape).tolist()
            for corner, (before, after) in zip(corners, values, strict=True):
                end = self.lead_in_s + corner
                if abs(before - value) > least:
                    value = before
                    each.append(Move(start, end, round(value, 4) + 0.0))
                if abs(after - value) > least and corner < last:
                    value = after
                    each.append(Move(end, end, round(value, 4) + 0.0))
                start = end
        return {surface: each for surface, each in moves.items() if each}

    @property
    def in_words(self) -> str:
        """Every command that moves, with the times and values of its changes."""
        return "; ".join(
            f"{surface if self.captured is None else f'{self.captured} target ({surface})'} "
            + (
                ", ".join(map(str, moves))
                if len(moves) <= MOST_MOVES
                else f"{len(moves)} changes from {moves[0].start:g} s to {moves[-1].end:g} s, "
                f"between {min(move.value for move in moves):.3g} and "
                f"{max(move.value for move in moves):.3g} deg, as in the table of its recipe"
            )
            for surface, moves in self.moves.items()
        )

    @abstractmethod
    def with_peak(self, peak_deg: float) -> Self:
        """The same manoeuvre with this peak [deg]; all commands scale with it."""

    @abstractmethod
    def commands(self, elapsed: Array, segments: Array) -> Array:
        """Commands [deg] (n, n_samples, n_surfaces) in a fresh array; trim where elapsed is
        negative.

        elapsed: (n, n_samples) time since the first input began [s].
        segments: (n, n_segments) durations flown [s].
        """

    def n_samples(self, dt: float) -> int:
        """Samples of a rollout, both ends included; ValueError unless dt divides the duration."""
        if not (isfinite(dt) and dt > 0):
            raise ValueError(f"dt={dt} s; give a finite time step above zero")
        steps = self.duration_s / dt
        if abs(steps - round(steps)) > 1e-6:
            raise ValueError(
                f"duration_s={self.duration_s} is {steps:.6g} steps of dt={dt}; "
                f"give a whole number of steps, such as duration_s={round(steps) * dt:.6g}"
            )
        return round(steps) + 1

    def pilot(self, dt: float, n: int, rng: np.random.Generator) -> Array:
        """Commands [rad], (n, n_samples, n_surfaces); a batch of one without jitter."""
        return self.flown(dt, self.hands(n, rng))

    def hands(self, n: int, rng: np.random.Generator) -> Hands:
        """Draw the scatter of n pilots; without jitter rng is not used."""
        start, segments = np.array([[self.lead_in_s]]), np.array([self.segments_s])
        if self.timing_jitter_s > 0.0:
            scatter = self.timing_jitter_s * rng.standard_normal((n, 1 + segments.shape[1]))
            start = np.maximum(start + scatter[:, :1], 0.0)
            segments = np.maximum(segments + scatter[:, 1:] * (segments > 0.0), 0.0)
        factor = np.ones(1)
        if self.amplitude_jitter > 0.0:
            factor = 1.0 + self.amplitude_jitter * rng.standard_normal(n)
        return Hands(start, segments, factor * self.steps_flown(n, rng))

    def flown(self, dt: float, hands: Hands) -> Array:
        """Commands of these pilots [rad], (1 or n, n_samples, n_surfaces)."""
        t = np.arange(self.n_samples(dt), dtype=np.float64) * dt
        commands = self.commands(t - hands.start, hands.segments)
        scale = np.deg2rad(hands.factor)[:, np.newaxis, np.newaxis]
        return np.multiply(commands, scale, out=commands if len(commands) >= len(scale) else None)

    def steps_flown(self, n: int, rng: np.random.Generator) -> Array:
        """(n,) share of the amplitude that each rollout flies; (1,) if all fly the same."""
        return rng.choice(self.build_up, n) if self.build_up else np.ones(1)


@dataclass(frozen=True, kw_only=True)
class OneSurface(Maneuver, ABC):
    """A manoeuvre flown with one control."""

    surface: Surface = "rudder"
    """control surface."""
    amplitude_deg: float = 5.0
    """amplitude of the command: either sign [deg]."""

    @property
    def peak_deg(self) -> float:
        return self.amplitude_deg

    @property
    def n_surfaces(self) -> int:
        return ALL_SURFACES if self.surface == "elevator" else LATERAL_SURFACES

    def with_peak(self, peak_deg: float) -> Self:
        return replace(self, amplitude_deg=peak_deg)

    @abstractmethod
    def shape(self, elapsed: Array, segments: Array) -> Array:
        """The command (n, n_samples), in amplitudes; arguments as in `commands`."""

    def commands(self, elapsed: Array, segments: Array) -> Array:
        command = np.zeros((*elapsed.shape, self.n_surfaces))
        column = command[..., COLUMN[self.surface]]
        np.multiply(self.shape(elapsed, segments), self.amplitude_deg, out=column)
        return command


@dataclass(frozen=True, kw_only=True)
class Steps(OneSurface, ABC):
    """A manoeuvre with one level per segment."""

    @property
    @abstractmethod
    def levels_s(self) -> tuple[tuple[float, float], ...]:
        """Level, in amplitudes, and planned duration [s] of each segment."""

    @property
    def levels(self) -> tuple[float, ...]:
        return tuple(level for level, _ in self.levels_s)

    @property
    def segments_s(self) -> tuple[float, ...]:
        return tuple(duration for _, duration in self.levels_s)

    @property
    def switches(self) -> tuple[tuple[float, float], ...]:
        """Each planned change of the command: time [s] and step [deg]."""
        switches, time, before = [], self.lead_in_s, 0.0
        for duration, level in zip((*self.segments_s, inf), (*self.levels, 0.0), strict=True):
            if level != before and duration > 0.0 and time < self.duration_s:
                switches.append((time, (level - before) * self.amplitude_deg))
                before = level
            time += duration
        return tuple(switches)

    def shape(self, elapsed: Array, segments: Array) -> Array:
        """The level of the segment at each time; trim before and after."""
        begins = np.zeros((len(segments), 1 + segments.shape[1]))
        np.cumsum(segments, axis=1, out=begins[:, 1:])
        begins -= TIME_GUARD
        return levels_at(elapsed, begins, np.array([0.0, *self.levels, 0.0]))


@dataclass(frozen=True, kw_only=True)
class Doublet(Steps):
    """An input to one side, then equally long to the other (paper: 1 s each from t = 0.5 s)."""

    half_s: float = 1.0
    """length of each half [s]."""

    @property
    def levels_s(self) -> tuple[tuple[float, float], ...]:
        return (1.0, self.half_s), (-1.0, self.half_s)


@dataclass(frozen=True, kw_only=True)
class Step(Steps):
    """One input, held to the end."""

    @property
    def levels_s(self) -> tuple[tuple[float, float], ...]:
        return ((1.0, inf),)


@dataclass(frozen=True, kw_only=True)
class Pulse(Steps):
    """One input, then back to trim."""

    width_s: float = 0.5
    """length of the pulse [s]."""

    @property
    def levels_s(self) -> tuple[tuple[float, float], ...]:
        return ((1.0, self.width_s),)


@dataclass(frozen=True, kw_only=True)
class Multistep3211(Steps):
    """Inputs of alternating sign that last 3, 2, 1 and 1 units: a broad band for identification."""

    unit_s: float = 0.5
    """length of one unit [s]."""

    @property
    def levels_s(self) -> tuple[tuple[float, float], ...]:
        return tuple(((-1.0) ** k, n * self.unit_s) for k, n in enumerate((3, 2, 1, 1)))


@dataclass(frozen=True, kw_only=True)
class BankToBank(Steps):
    """Roll in, hold, roll across to the opposite bank (twice as long), hold, roll out to level."""

    surface: Surface = "aileron"
    roll_s: float = 1.0
    """length of the roll in: the roll across takes twice as long [s]."""
    hold_s: float = 0.5
    """length of each hold [s]."""

    @property
    def levels_s(self) -> tuple[tuple[float, float], ...]:
        roll, hold = self.roll_s, self.hold_s
        return (1.0, roll), (0.0, hold), (-1.0, 2 * roll), (0.0, hold), (1.0, roll)


@dataclass(frozen=True, kw_only=True)
class Capture(Maneuver):
    """Capture a target from trim, hold it, then capture another one: a pilot flies it.

    Targets are commands of the axis's surface, which a pilot in the loop reads as targets.
    """

    axis: Axis = "bank"
    """captured axis: with its surface; bank by the aileron, sideslip or heading by the rudder,
    pitch angle or angle of attack by the elevator."""
    amplitude_deg: float = 30.0
    """target: change from trim, either sign [deg]."""
    hold_s: float = 3.0
    """time to the next target: capturing and holding the first [s]."""
    then_deg: float = 0.0
    """next target: change from trim; 0 for back to trim [deg]."""

    @property
    def captured(self) -> Axis | None:
        return self.axis

    @property
    def segments_s(self) -> tuple[float, ...]:
        return (self.hold_s,)

    @property
    def peak_deg(self) -> float:
        return self.amplitude_deg

    @property
    def n_surfaces(self) -> int:
        return ALL_SURFACES if MOVED_BY[self.axis] == "elevator" else LATERAL_SURFACES

    def with_peak(self, peak_deg: float) -> Self:
        factor = peak_deg / self.amplitude_deg if self.amplitude_deg else 0.0
        return replace(self, amplitude_deg=peak_deg, then_deg=factor * self.then_deg)

    def commands(self, elapsed: Array, segments: Array) -> Array:
        first, both = elapsed >= -TIME_GUARD, elapsed >= segments[:, :1] - TIME_GUARD
        target = np.where(both, self.then_deg, np.where(first, self.amplitude_deg, 0.0))
        commands = np.zeros((*target.shape, self.n_surfaces))
        commands[..., COLUMN[MOVED_BY[self.axis]]] = target
        return commands


@dataclass(frozen=True, kw_only=True)
class FrequencySweep(OneSurface):
    """A sine with a frequency that changes logarithmically or linearly in time.

    One segment: jitter of its duration stretches the sweep without changing its frequencies.
    `pilot` refuses a dt with fewer than two samples per period.
    """

    start_hz: Annotated[float, POSITIVE] = 0.2
    """first frequency [Hz]."""
    end_hz: Annotated[float, POSITIVE] = 2.0
    """last frequency [Hz]."""
    sweep_s: float = 5.0
    """length of the sweep [s]."""
    spacing: Spacing = "log"
    """change of the frequency: logarithmic or linear in time."""

    @property
    def segments_s(self) -> tuple[float, ...]:
        return (self.sweep_s,)

    @property
    def in_words(self) -> str:
        end = min(self.lead_in_s + self.sweep_s, self.duration_s)
        return (
            f"{self.surface} sine of {self.amplitude_deg:.3g} deg from {self.lead_in_s:g} s to "
            f"{end:g} s, swept {'steadily' if self.spacing == 'linear' else 'logarithmically'} "
            f"from {self.start_hz:g} to {self.end_hz:g} Hz in {self.sweep_s:g} s"
        )

    def n_samples(self, dt: float) -> int:
        """As for every manoeuvre; ValueError also if dt is too large for the highest frequency."""
        highest = max(self.start_hz, self.end_hz)
        if dt * highest >= 0.5:
            raise ValueError(
                f"dt={dt} s resolves frequencies below {0.5 / dt:.4g} Hz; the sweep goes to "
                f"{highest} Hz: give a smaller dt or a lower frequency"
            )
        return super().n_samples(dt)

    def shape(self, elapsed: Array, segments: Array) -> Array:
        """sin(2 pi cycles), cycles the integral of the frequency over the sweep so far."""
        on = (elapsed >= -TIME_GUARD) & (elapsed < segments - TIME_GUARD)
        part = np.where(on, elapsed, 0.0) / np.maximum(segments, TIME_GUARD)
        octaves = log(self.end_hz / self.start_hz)
        if self.spacing == "linear" or octaves == 0.0:
            cycles = part * (self.start_hz + 0.5 * (self.end_hz - self.start_hz) * part)
        else:
            cycles = self.start_hz * np.expm1(octaves * part) / octaves
        return np.where(on, np.sin(2.0 * np.pi * segments * cycles), 0.0)


@dataclass(frozen=True, kw_only=True)
class Table(Maneuver):
    """Commands at times after the trim segment, constant or linear between; the last one stays.

    Trim before the first time. One segment: jitter of its duration stretches the whole table.
    Raises ValueError for no rows, columns of unequal length and times that do not increase.
    """

    t_s: tuple[float, ...] = (0.0, 0.5, 1.5, 2.5, 3.0)
    """times after the trim segment: increasing, from 0."""
    delta_a_deg: tuple[float, ...] = (0.0, 2.0, -2.0, 2.0, 0.0)
    """aileron commands: as many as t_s. Trim before the first time."""
    delta_r_deg: tuple[float, ...] = (0.0, 5.0, -5.0, 1.0, 0.0)
    """rudder commands: as many as t_s. Trim before the first time."""
    interpolation: Interpolation = "linear"
    """between the times: hold the command, or change it linearly."""

    def __post_init__(self) -> None:
        super().__post_init__()
        rows = len(self.t_s)
        if not rows == len(self.delta_a_deg) == len(self.delta_r_deg) > 0:
            raise ValueError(
                f"{rows} times, {len(self.delta_a_deg)} aileron and {len(self.delta_r_deg)} rudder "
                "commands; give equally many, at least one"
            )
        for row, (before, after) in enumerate(pairwise(self.t_s), 1):
            if after <= before:
                raise ValueError(f"t_s[{row}]={after} follows {before}; the times must increase")

    @property
    def segments_s(self) -> tuple[float, ...]:
        return (self.t_s[-1],)

    @property
    def corners_s(self) -> tuple[float, ...]:
        return self.t_s

    @property
    def peak_deg(self) -> float:
        """The command farthest from trim [deg]."""
        return max((*self.delta_a_deg, *self.delta_r_deg), key=abs)

    def with_peak(self, peak_deg: float) -> Self:
        """Scale both columns; ValueError if all commands are at trim."""
        if not self.peak_deg:
            raise ValueError("the table stays at trim: give a command other than 0")
        factor = peak_deg / self.peak_deg
        columns = (self.delta_a_deg, self.delta_r_deg)
        a, r = (tuple(factor * command for command in column) for column in columns)
        return replace(self, delta_a_deg=a, delta_r_deg=r)

    def commands(self, elapsed: Array, segments: Array) -> Array:
        """The table at each sample's planned time, after stretching."""
        last = self.t_s[-1]
        planned = elapsed * (last / np.maximum(segments, TIME_GUARD)) if last else elapsed
        begun = np.searchsorted(self.t_s, planned + TIME_GUARD, side="right")
        columns = (
            np.where(begun > 0, np.interp(planned, self.t_s, column), 0.0)
            if self.interpolation == "linear"
            else np.array((0.0, *column))[begun]
            for column in (self.delta_a_deg, self.delta_r_deg)
        )
        return np.stack(tuple(columns), axis=-1)


@dataclass(frozen=True, kw_only=True)
class Altered(Maneuver):
    """A manoeuvre flown differently than planned: slower, or stopped before its end."""

    planned: Maneuver
    slower: float = 1.0
    """factor on the length of every segment."""
    flown_share: float = 1.0
    """share of the inputs' planned length after which commands return to trim."""

    @classmethod
    def of(cls, planned: Maneuver, slower: float = 1.0, flown_share: float = 1.0) -> Self:
        common = {entry.name: getattr(planned, entry.name) for entry in fields(Maneuver)}
        return cls(planned=planned, slower=slower, flown_share=flown_share, **common)

    @property
    def segments_s(self) -> tuple[float, ...]:
        return self.planned.segments_s

    @property
    def captured(self) -> Axis | None:
        return self.planned.captured

    @property
    def peak_deg(self) -> float:
        return self.planned.peak_deg

    @property
    def n_surfaces(self) -> int:
        return self.planned.n_surfaces

    def with_peak(self, peak_deg: float) -> Self:
        return replace(self, planned=self.planned.with_peak(peak_deg))

    def commands(self, elapsed: Array, segments: Array) -> Array:
        """The planned manoeuvre's commands at each sample's planned time."""
        planned = elapsed / self.slower
        commands = self.planned.commands(planned, segments)
        if self.flown_share < 1.0:
            length = min(sum(self.segments_s), self.duration_s - self.lead_in_s)
            commands[planned >= self.flown_share * length - TIME_GUARD] = 0.0
        return commands


@dataclass(frozen=True, kw_only=True)
class Ramps(Maneuver, ABC):
    """A manoeuvre flown with several controls, each moved at a constant rate from level to level.

    Its amplitude is that of one control; the others scale with it.
    """

    amplitude_deg: float = -5.0
    """amplitude of the command: either sign; negative elevator raises the nose [deg]."""

    @property
    @abstractmethod
    def levels_s(self) -> tuple[tuple[float, float, float, float], ...]:
        """Duration of each segment [s], and aileron, rudder and elevator at its end, in
        amplitudes."""

    @property
    def segments_s(self) -> tuple[float, ...]:
        return tuple(duration for duration, *_ in self.levels_s)

    @property
    def peak_deg(self) -> float:
        return self.amplitude_deg

    @property
    def n_surfaces(self) -> int:
        pulls = any(elevator for *_, elevator in self.levels_s)
        return ALL_SURFACES if pulls else LATERAL_SURFACES

    def with_peak(self, peak_deg: float) -> Self:
        return replace(self, amplitude_deg=peak_deg)

    def commands(self, elapsed: Array, segments: Array) -> Array:
        rows = len(np.broadcast_arrays(elapsed[:, :1], segments[:, :1])[0])
        command = np.zeros((rows, elapsed.shape[1], self.n_surfaces))
        begun, before = np.zeros((len(segments), 1)), np.zeros(ALL_SURFACES)
        for s, (_, *level) in enumerate(self.levels_s):
            lasts = np.maximum(segments[:, s : s + 1], 1e-3 * TIME_GUARD)
            share = np.clip((elapsed - begun + TIME_GUARD) / lasts, 0.0, 1.0)
            step = self.amplitude_deg * (np.array(level) - before)
            for c in np.flatnonzero(step):
                command[..., c] += step[c] * share
            begun, before = begun + segments[:, s : s + 1], np.array(level)
        return command


@dataclass(frozen=True, kw_only=True)
class WindUpTurn(Ramps):
    """From a trimmed turn, pull steadily to the elevator's amplitude, and hold it.

    The turn's load factor is that of the flight condition; the pull tightens it.
    """

    amplitude_deg: Pull = -5.0
    """amplitude of the pull: elevator, negative [deg]."""
    duration_s: float = 10.0
    """length of the rollout; longer inputs are cut."""
    pull_s: float = 8.0
    """length of the pull [s]."""

    @property
    def levels_s(self) -> tuple[tuple[float, float, float, float], ...]:
        return ((self.pull_s, 0.0, 0.0, 1.0),)


@dataclass(frozen=True, kw_only=True)
class PushOverPullUp(Ramps):
    """Push over, then pull up equally far, then back to trim. Positive amplitude pushes first."""

    amplitude_deg: float = 3.0
    """amplitude of the elevator: positive to push first [deg]."""
    ramp_s: float = 0.5
    """length of each change from trim: from push to pull takes twice as long [s]."""
    hold_s: float = 1.0
    """length of push and of pull [s]."""

    @property
    def levels_s(self) -> tuple[tuple[float, float, float, float], ...]:
        ramp, hold = self.ramp_s, self.hold_s
        up, down = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
        return (ramp, *down), (hold, *down), (2 * ramp, *up), (hold, *up), (ramp, 0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class RollingPullOut(Ramps):
    """Pull, then roll while pulling, then stop the roll; the pull lasts to the end."""

    amplitude_deg: Pull = -5.0
    """amplitude of the pull: elevator, negative [deg]."""
    pull_s: float = 1.0
    """length of the pull's onset [s]."""
    aileron: float = 1.0
    """share of aileron: a multiple of the elevator's amplitude."""
    roll_s: float = 1.0
    """length of the roll [s]."""

    @property
    def levels_s(self) -> tuple[tuple[float, float, float, float], ...]:
        pulled, rolling = (0.0, 0.0, 1.0), (self.aileron, 0.0, 1.0)
        return (self.pull_s, *pulled), (0.0, *rolling), (self.roll_s, *rolling), (0.0, *pulled)


@dataclass(frozen=True, kw_only=True)
class SteadyHeadingSideslip(Ramps):
    """Pedal in steadily, with aileron against the roll; hold; then back to trim."""

    amplitude_deg: float = 8.0
    """amplitude of the rudder: either sign [deg]."""
    ramp_s: float = 2.0
    """length of the onset, and of the return [s]."""
    hold_s: float = 1.0
    """length of the steady sideslip [s]."""
    aileron: float = 0.0
    """share of aileron: a multiple of the rudder's amplitude, that which holds the bank."""

    @property
    def levels_s(self) -> tuple[tuple[float, float, float, float], ...]:
        slip = (self.aileron, 1.0, 0.0)
        return (self.ramp_s, *slip), (self.hold_s, *slip), (self.ramp_s, 0.0, 0.0, 0.0)


MANEUVERS = family(
    "maneuver",
    Maneuver,
    {
        "rudder_doublet": Doublet(),
        "aileron_doublet": Doublet(surface="aileron"),
        "step": Step(),
        "pulse": Pulse(),
        "multistep_3211": Multistep3211(),
        "bank_to_bank": BankToBank(),
        "frequency_sweep": FrequencySweep(),
        "table": Table(),
        "pitch_doublet": Doublet(surface="elevator", amplitude_deg=-3.0),
        "wind_up_turn": WindUpTurn(),
        "push_over_pull_up": PushOverPullUp(),
        "rolling_pull_out": RollingPullOut(),
        "steady_heading_sideslip": SteadyHeadingSideslip(),
        "bank_capture": Capture(),
        "sideslip_capture": Capture(axis="sideslip", amplitude_deg=3.0),
        "heading_capture": Capture(axis="heading", amplitude_deg=2.0),
        "pitch_capture": Capture(axis="pitch", amplitude_deg=5.0),
    },
)
LATERAL_MANEUVERS = {
    name: maneuver
    for name, maneuver in MANEUVERS.items()
    if maneuver.n_surfaces == LATERAL_SURFACES
}
"""Those that do not move the elevator."""
