"""Gain, phase and disk margin of a closed loop, from its poles.

A loop is broken at the command of one surface, with the other surface's closed. With F the closed
loop and F_i the broken one, 1 + L_i(s) = det(s - F) / det(s - F_i), by the matrix determinant
lemma: the poles with the loop closed and broken give its frequency response.
"""

from dataclasses import dataclass
from math import log
from typing import Annotated, NamedTuple

import numpy as np
import numpy.typing as npt

from core.bounds import Bounds, check_bounds
from core.simulation.control_law import Actuator, Controller, closed_loops
from core.simulation.uncertain_plant import Plants
from core.types import Array, Flags

FREQUENCIES = np.geomspace(0.02, 200.0, 800)
"""[rad/s] Grid of the frequency response; the closed loop's natural frequencies join it."""
FASTEST_GROWTH = log(2.0) / 4.0
"""[1/s] Of a spiral that takes 4 s to double (MIL-F-8785C, level 3): a closed loop is unstable if a
real mode grows faster, or if any oscillation grows."""
NO_LOOP = 1e-9
"""A loop of a smaller gain is one of rounding."""
AT_ONCE = 256
UNITS = {"gain": "dB", "phase": "deg", "disk": ""}
"""Of each margin."""
Poles = npt.NDArray[np.complex128]


class Margins(NamedTuple):
    """Of each aircraft, (n,); 0 where its closed loop is unstable.

    gain: smallest factor [dB], up or down, that makes the loop unstable; inf for none.
    phase: smallest lead or lag [deg] that does; inf for none.
    disk: radius of the largest symmetric disk of gain and phase changes that do not, 1 / max|S -
    1/2|, at most 2 (Seiler, Packard and Gahinet, "An Introduction to Disk Margins", 2020).
    """

    gain: Array
    phase: Array
    disk: Array


Decibels = Bounds(above=0, below=100, words="give its least value in dB, above 0 and below 100")
Degrees = Bounds(above=0, below=180, words="give its least value in deg, above 0 and below 180")
Radius = Bounds(above=0, below=2, words="give its least radius, above 0 and below 2")


@dataclass(frozen=True)
class LeastMargins:
    """Stability margins of the closed loop, which label rollouts instead of the limits.

    A rollout is unsafe if its aircraft has no more of one of these. No sample shows a margin: a
    rollout fails at its last one, and in flight nothing is judged by it.
    """

    gain_db: Annotated[float | None, Decibels] = None
    """least gain margin: factor on the loop, up or down, that makes it unstable [dB]."""
    phase_deg: Annotated[float | None, Degrees] = None
    """least phase margin: lead or lag that makes the loop unstable [deg]."""
    disk: Annotated[float | None, Radius] = None
    """least disk margin: radius of the disk of gain and phase changes together, 0 to 2."""

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def given(self) -> dict[str, float]:
        """By the name in `Margins`."""
        every = {"gain": self.gain_db, "phase": self.phase_deg, "disk": self.disk}
        return {kind: least for kind, least in every.items() if least is not None}

    @property
    def label(self) -> str:
        """`requirement phase margin > 73 deg and disk margin > 1.2`; empty for none."""
        texts = [f"{k} margin > {least:g} {UNITS[k]}".rstrip() for k, least in self.given.items()]
        return f"requirement {' and '.join(texts)}" if texts else ""

    def too_little(self, margins: Margins) -> Flags:
        """(n,) whether aircraft with these margins are unsafe."""
        return np.any([getattr(margins, kind) <= k for kind, k in self.given.items()], axis=0)

    def in_words(self, margins: Margins) -> str:
        """`phase margins of 60 to 85 deg`. ValueError where no aircraft has any."""
        ranges = []
        for kind in self.given:
            low, high = float(getattr(margins, kind).min()), float(getattr(margins, kind).max())
            ranges.append(f"{kind} margins of {low:.3g} to {high:.3g} {UNITS[kind]}".rstrip())
            if low == np.inf:
                raise ValueError(
                    f"no change of {kind} makes any of these aircraft unstable, with this control "
                    "law: choose another margin or a law with feedback"
                )
        return " and ".join(ranges)


def loop_margins(broken: Poles, closed: Poles) -> Margins:
    """Margins of loops, from their poles (n, k) while broken and closed."""
    grid = np.broadcast_to(FREQUENCIES, (len(closed), len(FREQUENCIES)))
    w = np.sort(np.concatenate([grid, np.abs(closed)], axis=1))
    returned: Poles = np.ones(w.shape, np.complex128)  # 1 + L
    for k in range(closed.shape[1]):
        with np.errstate(divide="ignore", invalid="ignore"):
            returned *= (1j * w - closed[:, k : k + 1]) / (1j * w - broken[:, k : k + 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        loop = returned - 1.0
        disk = 1.0 / np.fmax.reduce(np.abs(1.0 / returned - 0.5), axis=1)
        at_phase = _at_zero(loop.imag, loop)
        gain = np.where(at_phase.real < -NO_LOOP, np.abs(20 * np.log10(-at_phase.real)), np.inf)
        at_gain = _at_zero(np.log(np.abs(loop)), loop)
        phase = np.abs(np.rad2deg(np.angle(-at_gain)))
    least = (np.fmin.reduce(each, axis=1, initial=np.inf) for each in (gain, phase))
    growth = closed.real - np.where(closed.imag == 0.0, FASTEST_GROWTH, 0.0)
    stable = growth.max(axis=1) <= 0.0
    return Margins(*(np.where(stable, each, 0.0) for each in (*least, disk)))


def _at_zero(what: Array, loop: Poles) -> Poles:
    """The loop where `what` crosses zero between two frequencies; NaN where it does not."""
    before, after = what[:, :-1], what[:, 1:]
    crosses = (before < 0) != (after < 0)
    part = np.where(crosses, before / (before - after), np.nan)
    return (1 - part) * loop[:, :-1] + part * loop[:, 1:]


def stability_margins(plants: Plants, controller: Controller, actuator: Actuator) -> Margins:
    """The smaller margins of the aileron's and the rudder's loop of each aircraft, (n,).

    Limits of the actuators do not count.
    """
    loops, drive = closed_loops(plants, controller, actuator)
    parts = [_margins(loops[k : k + AT_ONCE], drive) for k in range(0, len(loops), AT_ONCE)]
    return Margins(*map(np.concatenate, zip(*parts, strict=True)))


def _margins(loops: Array, drive: Array) -> Margins:
    closed, each = _poles(loops), []
    for column in drive.T:
        row = int(column.argmax())
        broken = loops.copy()
        broken[:, row] = 0.0
        broken[:, row, row] = -column[row]
        each.append(loop_margins(_poles(broken), closed))
    return Margins(*map(np.minimum, *each))


def _poles(loops: Array) -> Poles:
    return np.asarray(np.linalg.eigvals(loops), np.complex128)
