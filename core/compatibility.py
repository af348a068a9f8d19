"""Data compatibility: whether the sensors of a recording agree by kinematics, whatever aircraft.

    p = d(phi)/dt - d(psi)/dt sin(theta)
    r = d(psi)/dt cos(theta) cos(phi) - d(theta)/dt sin(phi)
    d(beta)/dt = -A r + B p + K (g/V) (N_y + sin(phi) cos(theta))

The first two compare a rate with the attitude. In the third A is 1, and B the sine of the angle of
attack, which need not be recorded: A is the scale of sideslip over that of yaw rate, K/A that of
airspeed times yaw rate over that of the accelerations. All are linear, so that a window through
which both sides go leaves them true; the residual is gust and noise.

Equation error by least squares with a delay; the intervals allow for the autocorrelation of the
residuals (Klein and Morelli, Aircraft System Identification, AIAA 2006, chapters 5 and 10; Morelli
and Klein, NASA CR-194893). A ratio of scales can be told, never one alone, and a vane that is x
ahead of the centre of gravity reads as one that is x/V late.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from core.equation_error import EquationError, Estimate, SmoothedSignal, Smoothing
from core.types import Array

GRAVITY = 9.80665
"""[m/s2]"""
SCALE_TOLERANCE = {"p": 0.1, "r": 0.1, "beta": 0.1, "Ny": 0.2, "V": 0.2}
"""By channel: a scale is remarked on where all of its interval is farther from 1. Of accelerometer
and airspeed less is known: they make a tenth of the slope of sideslip."""
DELAY_TOLERANCE_S = 0.05
"""The same of a delay [s]."""
RATE_TOLERANCE = float(np.radians(0.5))
"""The same of the bias of a rate against the attitude, and of the constant in the balance of
sideslip as a bias of yaw rate [rad/s]: 280 simulated flights of seven aircraft without a fault have
0.35 deg/s there for sure at most, the real ones of tests 0.05."""
WIDEST = 0.3
"""Half an interval of a scale, as a share of it, beyond which there was too little motion."""
FOLLOWS = 0.5
"""Share of a sensor's motion that the others must explain for a scale to mean anything."""
SLOWEST = 15.0
"""Airspeed below which nothing flies [m/s]."""
LEAST_MOTION = float(np.radians(0.5))
"""Root mean square of a rate from which on sensors can be compared [rad/s]."""
MOST_NOISE = 0.5
"""Share of noise in the motion that a scale is taken from beyond which that was too little."""


TOLERANCES = (
    f"remarked on where all of an interval is beyond: a scale farther from 1 than "
    f"{SCALE_TOLERANCE['beta']:g}, of accelerometer and airspeed {SCALE_TOLERANCE['V']:g}; a delay "
    f"of {DELAY_TOLERANCE_S:g} s; a bias of a rate of {np.degrees(RATE_TOLERANCE):.2g} deg/s, "
    "and the constant of the balance of sideslip as such a bias of yaw rate"
)
"""What is beyond tolerance, in words."""


@dataclass(frozen=True, eq=False)
class SensorReadings:
    """What was recorded, on an even grid; NaN where nothing was, and between separate windows.

    dt: [s].   channels: (n,) each, by key: beta, p, r, Ny, phi, theta, psi, V, those recorded;
    angles without jumps.
    """

    dt: float
    channels: Mapping[str, Array]


@dataclass(frozen=True)
class SensorCheck:
    """A sensor against others that tell the same quantity by kinematics.

    channel: its key.   against: keys of the others, those first without which it cannot be.
    scale: its reading over what they say.   bias: its reading less what they say, in its unit.
    delay: [s] that it reads late.   None where that cannot be told.   unchecked: why nothing can.
    remarks: what lies beyond tolerance, in words.   suspects: keys of the sensors whose scale alone
    would explain a scale beyond tolerance, and contradict no other check.
    """

    channel: str
    against: tuple[str, ...]
    scale: Estimate | None = None
    bias: Estimate | None = None
    delay: Estimate | None = None
    unchecked: str = ""
    remarks: tuple[str, ...] = ()
    suspects: tuple[str, ...] = ()

    @property
    def title(self) -> str:
        """What is compared with what, in words."""
        return f"{NAMES[self.channel]} against {_others(self)}"

    def to_plain(self) -> dict[str, Any]:
        """Return JSON's types."""
        told = {name: getattr(self, name) for name in ("scale", "bias", "delay")}
        return {
            "channel": self.channel,
            "title": self.title,
            **{name: estimate and estimate._asdict() for name, estimate in told.items()},
            "unchecked": self.unchecked,
            "remarks": list(self.remarks),
            "suspects": list(self.suspects),
        }


NAMES = {
    "beta": "sideslip",
    "p": "roll rate",
    "r": "yaw rate",
    "Ny": "lateral acceleration",
    "phi": "bank angle",
    "theta": "pitch angle",
    "psi": "heading",
    "V": "airspeed",
}
POWERS = {
    "p": {"p": 1, "phi": -1},
    "r": {"r": 1, "psi": -1},
    "beta": {"beta": 1, "r": -1},
    "Ny": {"Ny": 1, "r": -1, "V": -1},
    "V": {"V": 1, "r": 1},
}
"""Of the scale that a check finds, by channel: the power of each sensor's own. Accelerometer and
bank angle make but a part each of what airspeed is checked by."""


def check_sensors(readings: SensorReadings) -> tuple[SensorCheck, ...]:
    """Compare roll rate, yaw rate, sideslip, lateral acceleration and airspeed with the others."""
    signals = _Signals(readings)
    yaw = _yaw_rate(signals)
    checks = (_roll_rate(signals), yaw, *_sideslip(signals, yaw))
    return _remarked(checks, signals.mean_speed)


def _remarked(checks: tuple[SensorCheck, ...], speed: float | None) -> tuple[SensorCheck, ...]:
    """The same, each with what lies beyond tolerance. speed: true airspeed [m/s]."""
    return tuple(
        replace(check, remarks=(*check.remarks, *_remarks(check, found, speed)), suspects=found)
        for check in checks
        for found in [_suspects(check, checks)]
    )


def _remarks(check: SensorCheck, suspects: tuple[str, ...], speed: float | None) -> list[str]:
    remarks, name, others = [], NAMES[check.channel], _others(check)
    scale, delay, bias = check.scale, check.delay, check.bias
    if _is_off(check) and scale:
        who = " or ".join(NAMES[key] for key in suspects) or "more than one of them"
        told = f"{scale.value:.2f} times ({scale.low:.2f} to {scale.high:.2f})"
        remarks.append(
            f"{name} reads {told} what {others} says: check gain, unit and sign of {who}"
        )
    if delay and delay.is_beyond(DELAY_TOLERANCE_S):
        late, against = (name, others) if delay.value > 0.0 else (others, name)
        low, high = sorted((abs(delay.low), abs(delay.high)))
        words = (
            f"{late} is {abs(delay.value):.2f} s late ({low:.2f} to {high:.2f} s) against {against}"
        )
        if check.channel == "beta" and delay.value > 0.0:
            ahead = f"{speed * delay.value:.0f} m" if speed else "so much flight"
            words += f", or measured {ahead} ahead of the centre of gravity"
        remarks.append(words)
    if check.channel in ("p", "r") and bias and bias.is_beyond(RATE_TOLERANCE):
        value, low, high = np.degrees(bias)
        remarks.append(f"{name} has a bias of {value:.2f} deg/s ({low:.2f} to {high:.2f})")
    return remarks


def _suspects(check: SensorCheck, checks: tuple[SensorCheck, ...]) -> tuple[str, ...]:
    """Sensors whose scale alone explains a check, and contradicts no other."""
    if not _is_off(check) or check.scale is None:
        return ()
    found = []
    for key, power in POWERS[check.channel].items():
        scale = check.scale.value**power
        others = [other for other in checks if other is not check and key in POWERS[other.channel]]
        if (key == "V" and scale < 0.0) or any(
            _contradicts(other, scale ** POWERS[other.channel][key]) for other in others
        ):
            continue
        found.append(key)
    return tuple(found)


def _is_off(check: SensorCheck) -> bool:
    tolerance = SCALE_TOLERANCE[check.channel]
    return check.scale is not None and check.scale.is_beyond(tolerance, 1.0)


def _contradicts(check: SensorCheck, scale: float) -> bool:
    """Whether another scale than this was found, by more than tolerance."""
    if check.scale is None:
        return False
    low, high = sorted((check.scale.low / scale, check.scale.high / scale))
    return Estimate(1.0, low, high).is_beyond(SCALE_TOLERANCE[check.channel], 1.0)


def _others(check: SensorCheck) -> str:
    """What a sensor is compared with, in words; the first says most."""
    slopes = {"p": "the slope of bank angle", "r": "the slope of heading", "beta": "yaw rate"}
    return slopes.get(check.channel, "the balance of sideslip")


class _Signals:
    """What was recorded, and all of it smoothed alike."""

    def __init__(self, readings: SensorReadings) -> None:
        self.dt, self.channels = readings.dt, dict(readings.channels)
        self.smoothing = Smoothing(readings.dt)
        self._none = np.zeros(len(next(iter(readings.channels.values()), ())))
        speed = np.where(self.raw("V") >= SLOWEST, self.raw("V"), np.nan)
        self.mean_speed: float | None = None
        self.channels.pop("V", None)
        if np.isfinite(speed).any():
            self.channels["V"], self.mean_speed = speed, float(np.nanmean(speed))

    def raw(self, key: str) -> Array:
        """(n,) as recorded; zeros for an angle that was not: of level flight."""
        return self.channels.get(key, self._none)

    def value(self, key: str) -> Array:
        """(n,) smoothed."""
        return self.smoothing.value(self.raw(key)).values

    def slope(self, key: str) -> SmoothedSignal:
        """The derivative."""
        return self.smoothing.slope(self.raw(key))

    def lacks(self, check: SensorCheck) -> str:
        """Why a check cannot be: what is not recorded; "" where all is."""
        keys = (check.channel, *check.against)
        lacking = [NAMES[key] for key in keys if key not in self.channels]
        return f"without {' and '.join(lacking)}" if lacking else ""


def _roll_rate(signals: _Signals) -> SensorCheck:
    slope, theta = signals.slope("phi"), signals.value("theta")
    if "psi" in signals.channels:
        turn = np.sin(theta) * signals.slope("psi").values
    else:
        yaw = signals.smoothing.value(signals.raw("r") * np.cos(signals.raw("phi"))).values
        turn = np.tan(theta) * yaw
    told = slope._replace(values=slope.values - turn)
    return _of_rate(signals, SensorCheck("p", ("phi",)), told)


def _yaw_rate(signals: _Signals) -> SensorCheck:
    slope, phi, theta = signals.slope("psi"), signals.value("phi"), signals.value("theta")
    pitching = np.sin(phi) * signals.slope("theta").values
    told = slope._replace(values=np.cos(theta) * np.cos(phi) * slope.values - pitching)
    return _of_rate(signals, SensorCheck("r", ("psi",)), told)


def _of_rate(signals: _Signals, check: SensorCheck, told: SmoothedSignal) -> SensorCheck:
    """A rate against what the attitude tells of it."""
    if lacking := signals.lacks(check):
        return replace(check, unchecked=lacking)
    fit = EquationError.fit(signals.value(check.channel), (told,), signals.dt)
    if fit is None or (scale := _scale(fit, 0)) is None or fit.motion(told) < LEAST_MOTION:
        return _unclear(check, fit, told)
    return replace(check, scale=scale, bias=fit.constant, delay=fit.delay)


def _sideslip(signals: _Signals, yaw: SensorCheck) -> tuple[SensorCheck, SensorCheck, SensorCheck]:
    """Sideslip against yaw rate; accelerometer and airspeed by what they add to that.

    First accelerometer and gravity together, which both stand with g/V; then each alone, as far as
    they differ: a vane that is late looks much as another scale of theirs. yaw: of yaw rate.
    """
    beta = SensorCheck("beta", ("r", "p", "Ny", "phi"))
    lateral = SensorCheck("Ny", ("beta", "r", "p", "phi", "V"))
    speed = SensorCheck("V", ("beta", "r", "p", "Ny", "phi"))
    if lacking := signals.lacks(beta):
        return (
            replace(beta, unchecked=lacking),
            replace(lateral, unchecked=signals.lacks(lateral)),
            replace(speed, unchecked=signals.lacks(speed)),
        )
    smooth = signals.smoothing.value
    per_g = GRAVITY / signals.raw("V") if signals.mean_speed else GRAVITY
    force = per_g * signals.raw("Ny")
    gravity = per_g * np.sin(signals.raw("phi")) * np.cos(signals.raw("theta"))
    slope = signals.slope("beta").values
    turn, roll = smooth(-signals.raw("r")), smooth(signals.raw("p"))
    fit = EquationError.fit(slope, (turn, roll, smooth(force + gravity)), signals.dt)
    if fit is None or (scale := _scale(fit, 0)) is None or fit.motion(turn) < LEAST_MOTION:
        return _unclear(beta, fit, turn), _too_little(lateral), _too_little(speed)
    beta = replace(beta, scale=scale, delay=fit.delay)
    offset = fit.coefficient(3, over=0)
    lateral = replace(lateral, remarks=_constant(offset, yaw, signals.mean_speed))
    if lacking := signals.lacks(speed):
        return beta, replace(lateral, unchecked=lacking), replace(speed, unchecked=lacking)
    parts = (turn, roll, smooth(force), smooth(gravity))
    apart = EquationError.fit(slope, parts, signals.dt, fit.tau)
    if read := _scale(apart, 0, over=2) if apart else None:
        lateral = replace(lateral, scale=read, bias=_bias(offset, signals.mean_speed or 0.0))
    else:
        words = "too little motion to tell its scale from delay of sideslip and angle of attack"
        lateral = replace(lateral, unchecked=words)
    told = _scale(fit, 2, over=0)
    return (
        beta,
        lateral,
        replace(speed, scale=told) if told else _too_little(speed),
    )


def _bias(offset: Estimate, speed: float) -> Estimate:
    """Of the accelerometer [g], were it alone what makes the constant. offset: [rad/s]."""
    low, value, high = sorted(-speed / GRAVITY * part for part in offset)
    return Estimate(value, low, high)


def _constant(offset: Estimate, yaw: SensorCheck, speed: float | None) -> tuple[str, ...]:
    """What a constant in the balance of sideslip may be, where it is beyond tolerance.

    offset: as a bias of yaw rate [rad/s].   yaw: of yaw rate; a heading that agrees clears it.
    speed: true airspeed [m/s], None where it is not known.
    """
    if not offset.is_beyond(RATE_TOLERANCE):
        return ()
    value, low, high = np.degrees(offset)
    may_be = [f"a bias of yaw rate of {value:.2f} deg/s ({low:.2f} to {high:.2f})"]
    if yaw.bias and abs(yaw.bias.value) < 0.5 * abs(offset.value):
        may_be = []
    if speed is None:
        may_be += ["one of lateral acceleration or bank angle, whose size needs airspeed"]
    else:
        force = _bias(offset, speed)
        bank = float(np.degrees(np.arcsin(np.clip(force.value, -1.0, 1.0))))
        may_be += [
            f"a bias of lateral acceleration of {force.value:.3f} g ({force.low:.3f} to "
            f"{force.high:.3f})",
            f"a mean bank angle that is {bank:.1f} deg off",
        ]
    words = ", or ".join(may_be)
    return (f"the balance of sideslip has a constant: {words}; kinematics cannot tell which",)


def _scale(fit: EquationError, k: int, over: int | None = None) -> Estimate | None:
    """A scale from coefficients; None where there was too little motion, or too much noise.

    The interval is widened by what noise may have made a coefficient too small.
    """
    told = fit.coefficient(k, over)
    noise = max(fit.noise_share(part) for part in (k, over) if part is not None)
    wide = noise * abs(told.value)
    if (
        not isfinite(told.value)
        or noise > MOST_NOISE
        or told.high - told.value + wide > WIDEST * abs(told.value)
    ):
        return None
    is_clear = fit.share >= FOLLOWS and fit.delay_is_inside
    return Estimate(told.value, told.low - wide, told.high + wide) if is_clear else None


def _unclear(check: SensorCheck, fit: EquationError | None, told: SmoothedSignal) -> SensorCheck:
    """A check without a scale: too little motion, or two that do not go together."""
    if fit is None or min(fit.motion(told), fit.spread) < LEAST_MOTION or fit.share >= FOLLOWS:
        return _too_little(check)
    words = (
        f"{NAMES[check.channel]} does not follow {_others(check)}, which explains {fit.share:.0%}"
    )
    return replace(check, unchecked="they do not go together", remarks=(words,))


def _too_little(check: SensorCheck) -> SensorCheck:
    return replace(check, unchecked="not enough motion to tell")
