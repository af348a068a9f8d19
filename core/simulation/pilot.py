"""Who flies the manoeuvre: commands alone, or a pilot who reacts to what the aircraft does."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import exp, inf, pi, radians, tan
from typing import Annotated, NamedTuple

import numpy as np

from core.bounds import NOT_NEGATIVE, Bounds, check_bounds
from core.kernels.pilot import CAPTURES, LAG, LEAD, OUTPUT, PER_AXIS, STEP, SURFACE, TRIM, Pilots
from core.recipe import family
from core.simulation.imperfections import channel_array
from core.simulation.maneuver import COLUMN, MOVED_BY, Axis, Maneuver
from core.types import Array

CHANNEL_OF: dict[Axis, str] = {
    "bank": "phi",
    "sideslip": "beta",
    "pitch": "theta",
    "alpha": "alpha",
    "heading": "psi",
}
"""Channel of each axis, whose sensor noise the pilot sees. Heading is the integral of yaw rate."""
TRIMS_RAD_S = 0.3
"""[rad/s] A lasting error is trimmed away: a of McRuer's extended crossover model, whose phase is
-a / omega at low frequencies."""
REMNANT_S = 0.3
"""[s] Time constant of the remnant, a bandwidth of 3 rad/s (AGARD-AG-188)."""
MOST_EQUALISED = radians(60.0)
"""Phase that a pilot adds or takes, at most."""

NotNegative = Annotated[float, NOT_NEGATIVE]
Positive = Annotated[float, Bounds(above=0)]
OrNever = Annotated[float | None, Bounds(above=0, words="give a number above 0, or none")]
Respond = Callable[[Axis, complex], complex]
"""Transfer function of the nominal aircraft with law, actuators and pedals: angle of an axis per
command of its surface, at s [rad/s]."""


class Sight(NamedTuple):
    """Where a simulator has the angle of an axis: an output, which is its rate if `is_rate`."""

    output: int
    is_rate: bool = False


@dataclass(frozen=True)
class Intervention:
    """When a pilot in the loop gives up the test; flights are then labelled by that, not by limits.

    Without a number the pilot never gives up. An oscillation is two cycles. A target is judged once
    it is captured, so the way there is no error.
    """

    error_deg: OrNever = None
    """largest error: of a tracked axis [deg]."""
    error_s: Positive = 0.5
    """time beyond the largest error: then the pilot gives up [s]."""
    swing_deg: OrNever = None
    """amplitude of an oscillation: of a tracked axis's error, to either side [deg]."""
    least_hz: Positive = 0.3
    """lowest frequency of an oscillation: slower ones are accepted [Hz]."""

    def __post_init__(self) -> None:
        check_bounds(self)

    def __str__(self) -> str:
        """`the pilot gives up: error beyond 10 deg for 0.5 s`; empty if never."""
        reasons = []
        if self.error_deg is not None:
            reasons.append(f"error beyond {self.error_deg:g} deg for {self.error_s:g} s")
        if self.swing_deg is not None:
            reasons.append(
                f"oscillation beyond {self.swing_deg:g} deg at {self.least_hz:g} Hz or faster"
            )
        return f"the pilot gives up: {' or '.join(reasons)}" if reasons else ""


class Crew(NamedTuple):
    """Pilots who know the nominal aircraft, and the axes that each of them tracks.

    steps: [s], see `Pilots`.   gains, leads_s, lags_s: (n_axes,) of the nominal pilot.
    """

    pilot: "Crossover"
    axes: tuple[Axis, ...]
    captured: Axis | None
    outputs: tuple[int, ...]
    are_rates: tuple[bool, ...]
    gains: Array
    leads_s: Array
    lags_s: Array

    def draw(
        self, n: int, n_samples: int, dt: float, noise: object, rng: np.random.Generator
    ) -> Pilots:
        """n of them for flights of n_samples, dt apart [s].   noise: of the sensors, by channel."""
        pilot, shape = self.pilot, (n, len(self.axes))
        spreads = pilot.gain_spread, pilot.lag_spread, pilot.delay_spread, pilot.remnant_spread
        gain, lag, delay, remnant = np.exp(rng.standard_normal((n, 4)) * spreads).T
        seen = rng.standard_normal((*shape, n_samples))
        fade = exp(-dt / REMNANT_S)
        seen[..., 1:] *= (1.0 - fade * fade) ** 0.5
        for k in range(1, n_samples):
            seen[..., k] += fade * seen[..., k - 1]
        seen *= radians(pilot.remnant_deg) * remnant[:, np.newaxis, np.newaxis]
        sensors = channel_array(noise, tuple(CHANNEL_OF[axis] for axis in self.axes))
        if sensors.any():
            seen += sensors[:, np.newaxis] * rng.standard_normal(seen.shape)
        gives_up = pilot.intervention
        axes = np.zeros((len(self.axes), PER_AXIS))
        axes[:, SURFACE] = [COLUMN[MOVED_BY[axis]] for axis in self.axes]
        axes[:, OUTPUT], axes[:, STEP] = self.outputs, dt * np.array(self.are_rates)
        axes[:, CAPTURES] = [axis == self.captured for axis in self.axes]
        axes[:, LEAD], axes[:, LAG] = self.leads_s / dt, self.lags_s / dt
        axes[:, TRIM] = TRIMS_RAD_S * dt
        times = pilot.lag_s / dt * lag, pilot.delay_s / dt * delay
        accepts = (
            radians(gives_up.error_deg or inf),
            max(round(gives_up.error_s / dt), 1),
            radians(gives_up.swing_deg or inf),
            0.5 / gives_up.least_hz / dt,
        )
        return Pilots(
            axes,
            np.column_stack([*times, self.gains * gain[:, np.newaxis]]),
            seen,
            np.array(accepts),
            np.full(n, n_samples),
        )


@dataclass(frozen=True)
class Pilot(ABC):
    """Who flies the manoeuvre."""

    @property
    def label(self) -> str:
        """What labels flights instead of limits; empty for limits."""
        return ""

    @abstractmethod
    def check(self, maneuver: Maneuver, sights: Mapping[Axis, Sight]) -> None:
        """ValueError for a manoeuvre that this pilot cannot fly where these axes are seen."""

    @abstractmethod
    def crew(
        self, maneuver: Maneuver, sights: Mapping[Axis, Sight], respond: Respond
    ) -> Crew | None:
        """Pilots for a manoeuvre; None if its commands are all that they do."""


@dataclass(frozen=True)
class OpenLoop(Pilot):
    """The commands of the manoeuvre, whatever the aircraft does."""

    def check(self, maneuver: Maneuver, sights: Mapping[Axis, Sight]) -> None:
        if maneuver.captured:
            raise ValueError(
                f"the manoeuvre captures a target of {maneuver.captured}, which needs a pilot in "
                "the loop: choose the pilot crossover"
            )

    def crew(
        self, maneuver: Maneuver, sights: Mapping[Axis, Sight], respond: Respond
    ) -> Crew | None:
        return None


@dataclass(frozen=True)
class Crossover(Pilot):
    """McRuer's crossover model: pilot and aircraft together are K e^(-tau s) / s near K.

    The pilot keeps one axis at trim, and captures that of the manoeuvre; leads or lags so that the
    nominal aircraft responds like 1 / s at the crossover frequency; and sees each axis with sensor
    noise and remnant. What the pilot adds goes through pedals, law and actuators, as commands do.
    """

    axis: Axis = "bank"
    """axis to keep at trim: bank by the aileron, sideslip or heading by the rudder, pitch angle or
    angle of attack by the elevator; a captured one with the same surface is captured instead."""
    crossover_rad_s: Positive = 1.5
    """gain: as crossover frequency with the nominal aircraft [rad/s]."""
    gain_spread: NotNegative = 0.2
    """spread of the gain: of its logarithm, normal, between pilots."""
    delay_s: NotNegative = 0.2
    """delay: from what is seen to the arm's command [s]."""
    delay_spread: NotNegative = 0.15
    """spread of the delay: of its logarithm, normal, between pilots."""
    lag_s: NotNegative = 0.1
    """lag of the arm: first order, besides that of stick and pedals [s]."""
    lag_spread: NotNegative = 0.15
    """spread of the lag: of its logarithm, normal, between pilots."""
    remnant_deg: NotNegative = 0.2
    """remnant: standard deviation of noise on the angle seen, lasting about 0.3 s [deg]."""
    remnant_spread: NotNegative = 0.3
    """spread of the remnant: of its logarithm, normal, between pilots."""
    intervention: Intervention = Intervention()
    """giving up: when a flight is labelled unsafe because the pilot gives up."""

    def __post_init__(self) -> None:
        check_bounds(self)

    @property
    def label(self) -> str:
        return str(self.intervention)

    def _axes(self, maneuver: Maneuver) -> tuple[Axis, ...]:
        captured = maneuver.captured
        if captured is None or MOVED_BY[captured] == MOVED_BY[self.axis]:
            return (captured or self.axis,)
        return captured, self.axis

    def check(self, maneuver: Maneuver, sights: Mapping[Axis, Sight]) -> None:
        axes = self._axes(maneuver)
        if unseen := [axis for axis in axes if axis not in sights]:
            raise ValueError(
                f"the aircraft has no {unseen[0]} to track: choose {' or '.join(sights)}"
            )
        column = COLUMN[MOVED_BY[self.axis]]
        if self.axis not in axes or column >= maneuver.n_surfaces:
            return
        t = np.linspace(-maneuver.lead_in_s, maneuver.duration_s - maneuver.lead_in_s, 200)
        planned = maneuver.commands(t[np.newaxis], np.array([maneuver.segments_s]))
        if self.axis != maneuver.captured and planned[..., column].any():
            raise ValueError(
                f"the manoeuvre moves the {MOVED_BY[self.axis]}, with which the pilot would keep "
                f"{self.axis}: choose another axis or manoeuvre"
            )

    def crew(
        self, maneuver: Maneuver, sights: Mapping[Axis, Sight], respond: Respond
    ) -> Crew | None:
        axes = self._axes(maneuver)
        tuned = np.array([self.tuned(lambda s, axis=axis: respond(axis, s)) for axis in axes])
        outputs, are_rates = zip(*(sights[axis] for axis in axes), strict=True)
        return Crew(self, axes, maneuver.captured, outputs, are_rates, *tuned.T)

    def tuned(self, respond: Callable[[complex], complex]) -> tuple[float, float, float]:
        """Gain, lead and lag [s] with which this aircraft responds like 1 / s at the crossover.

        respond: transfer function of the aircraft.
        """
        frequency = self.crossover_rad_s
        sign = np.sign(respond(frequency + 0.0j).real)
        response = sign * respond(1j * frequency) * (1.0 + TRIMS_RAD_S / (1j * frequency))
        phase = float(np.angle(response))
        needed = -0.5 * pi - (phase if phase < 0.5 * pi else phase - 2.0 * pi)
        part = tan(min(max(abs(needed), 0.0), MOST_EQUALISED)) / frequency
        lead, lag = (part, 0.0) if needed > 0.0 else (0.0, part)
        pilot = (1.0 + 1j * frequency * lead) / (1.0 + 1j * frequency * lag)
        return float(sign / abs(pilot * response)), lead, lag


PILOTS = family("pilot", Pilot, {"open_loop": OpenLoop(), "crossover": Crossover()})


def usual_pilot(maneuver: Maneuver) -> Pilot:
    """Who flies a manoeuvre unless chosen: a pilot in the loop only where it captures a target."""
    return PILOTS["crossover" if maneuver.captured else "open_loop"]
