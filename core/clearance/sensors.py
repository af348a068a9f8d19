"""Data compatibility: do the sensors of a recording agree by kinematics, for any aircraft?

    p = d(phi)/dt - d(psi)/dt sin(theta)
    r = d(psi)/dt cos(theta) cos(phi) - d(theta)/dt sin(phi)
    d(beta)/dt = -A r + B p + K (g/V) (N_y + sin(phi) cos(theta))

The first two compare a rate with the attitude. In the third, without sensor errors, A is 1 and B is
the sine of the angle of attack, which need not be recorded. A is the scale of sideslip over that of
yaw rate; K/A is the scale of airspeed times yaw rate over that of the accelerations. All equations
are linear, so they remain true after both sides are smoothed alike; the residual is gust and noise.

Equation error by least squares with a delay; the intervals allow for the autocorrelation of the
residuals (Klein and Morelli, Aircraft System Identification, AIAA 2006, chapters 5 and 10; Morelli
and Klein, NASA CR-194893). Only ratios of scales can be measured. A vane x ahead of the centre of
gravity looks like a vane that is late by x/V.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

import numpy as np

from core.clearance.equation_error import EquationError, Estimate, SmoothedSignal, Smoothing
from core.types import Array

GRAVITY = 9.80665
"""[m/s2]"""
SCALE_TOLERANCE = {"p": 0.1, "r": 0.1, "beta": 0.1, "Ny": 0.2, "V": 0.2}
"""By channel: a scale gets a remark if its whole interval is farther from 1. Accelerometer and
airspeed are less certain: they make a tenth of the slope of sideslip."""
DELAY_TOLERANCE_S = 0.05
"""The same for a delay [s]."""
RATE_TOLERANCE = float(np.radians(0.5))
"""The same for the bias of a rate against the attitude, and for the constant in the balance of
sideslip as a bias of yaw rate [rad/s]. In 280 simulated flights of seven aircraft without a fault
it is at most 0.35 deg/s; in the real test records, 0.05."""
WIDEST = 0.3
"""Half the interval of a scale, as a share of it; if wider, there was too little motion."""
FOLLOWS = 0.5
"""Share of a sensor's motion that the others must explain for a meaningful scale."""
SLOWEST = 15.0
"""Lowest plausible airspeed in flight [m/s]."""
LEAST_MOTION = float(np.radians(0.5))
"""Smallest root mean square of a rate for comparing sensors [rad/s]."""
MOST_NOISE = 0.5
"""Largest share of noise in the motion that a scale is measured from."""


TOLERANCES = (
    "remarks where a whole interval is beyond: "
    f"scale within {SCALE_TOLERANCE['beta']:g} of 1 "
    f"({SCALE_TOLERANCE['V']:g} for accelerometer and airspeed); delay {DELAY_TOLERANCE_S:g} s; "
    f"bias of a rate {np.degrees(RATE_TOLERANCE):.2g} deg/s, also for the constant of the balance "
    "of sideslip as a bias of yaw rate"
)
"""The tolerances in words."""


@dataclass(frozen=True, eq=False)
class SensorReadings:
    """Recorded channels on an even grid; NaN where not recorded and between separate windows.

    dt: [s].   channels: (n,) each, by key, any of beta, p, r, Ny, phi, theta, psi, V; angles
    without jumps.
    """

    dt: float
    channels: Mapping[str, Array]


@dataclass(frozen=True)
class SensorCheck:
    """A sensor compared with others that give the same quantity by kinematics.

    channel: its key.   against: keys of the others, the most important first.
    scale: its reading over theirs.   bias: its reading minus theirs, in its unit.
    delay: [s] by which it is late.   None where unknown.   unchecked: why nothing was measured.
    remarks: values beyond tolerance, in words.   suspects: keys of the sensors whose scale alone
    explains a scale beyond tolerance without contradicting another check.
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
        return f"{NAMES[self.channel]} against {_others(self)}"

    def to_plain(self) -> dict[str, Any]:
        estimates = {name: getattr(self, name) for name in ("scale", "bias", "delay")}
        return {
            "channel": self.channel,
            "title": self.title,
            **{name: estimate and estimate._asdict() for name, estimate in estimates.items()},
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
"""By check: the power of each sensor's scale in the measured scale. Accelerometer and bank angle
are left out of the check of airspeed: each makes only a part of it."""


def check_sensors(readings: SensorReadings) -> tuple[SensorCheck, ...]:
    """Compare roll rate, yaw rate, sideslip, lateral acceleration and airspeed with the others."""
    signals = _Signals(readings)
    checks = (_roll_rate(signals), _yaw_rate(signals), *_sideslip(signals))
    return _remarked(checks, signals.mean_speed)


def _remarked(checks: tuple[SensorCheck, ...], speed: float | None) -> tuple[SensorCheck, ...]:
    """Add remarks and suspects. speed: true airspeed [m/s]."""
    return tuple(
        replace(
            check, remarks=(*check.remarks, *_remarks(check, suspects, speed)), suspects=suspects
        )
        for check in checks
        for suspects in [_suspects(check, checks)]
    )


def _remarks(check: SensorCheck, suspects: tuple[str, ...], speed: float | None) -> list[str]:
    remarks, name, others = [], NAMES[check.channel], _others(check)
    scale, delay, bias = check.scale, check.delay, check.bias
    if _is_off(check) and scale:
        sensors = " or ".join(NAMES[key] for key in suspects) or "more than one of them"
        ratio = f"{scale.value:.2f} times ({scale.low:.2f} to {scale.high:.2f})"
        remarks.append(f"{name} reads {ratio} {others}: check gain, unit and sign of {sensors}")
    if delay and delay.is_beyond(DELAY_TOLERANCE_S):
        late, against = (name, others) if delay.value > 0.0 else (others, name)
        low, high = sorted((abs(delay.low), abs(delay.high)))
        words = (
            f"{late} is {abs(delay.value):.2f} s late ({low:.2f} to {high:.2f} s) against {against}"
        )
        if check.channel == "beta" and delay.value > 0.0:
            ahead = f"{speed * delay.value:.0f} m" if speed else "this flight distance"
            words += f", or measured {ahead} ahead of the centre of gravity"
        remarks.append(words)
    if check.channel in ("p", "r") and bias and bias.is_beyond(RATE_TOLERANCE):
        value, low, high = np.degrees(bias)
        remarks.append(f"{name} has a bias of {value:.2f} deg/s ({low:.2f} to {high:.2f})")
    return remarks


def _suspects(check: SensorCheck, checks: tuple[SensorCheck, ...]) -> tuple[str, ...]:
    """Sensors whose scale alone explains a check without contradicting another."""
    if not _is_off(check) or check.scale is None:
        return ()
    suspects = []
    for key, power in POWERS[check.channel].items():
        scale = check.scale.value**power
        others = [other for other in checks if other is not check and key in POWERS[other.channel]]
        if (key == "V" and scale < 0.0) or any(
            _contradicts(other, scale ** POWERS[other.channel][key]) for other in others
        ):
            continue
        suspects.append(key)
    return tuple(suspects)


def _is_off(check: SensorCheck) -> bool:
    tolerance = SCALE_TOLERANCE[check.channel]
    return check.scale is not None and check.scale.is_beyond(tolerance, 1.0)


def _contradicts(check: SensorCheck, scale: float) -> bool:
    """Whether a check measured another scale, by more than the tolerance."""
    if check.scale is None:
        return False
    low, high = sorted((check.scale.low / scale, check.scale.high / scale))
    return Estimate(1.0, low, high).is_beyond(SCALE_TOLERANCE[check.channel], 1.0)


def _others(check: SensorCheck) -> str:
    """The main quantity that a sensor is compared with, in words."""
    slopes = {"p": "the slope of bank angle", "r": "the slope of heading", "beta": "yaw rate"}
    return slopes.get(check.channel, "the balance of sideslip")


class _Signals:
    """The recorded channels, all smoothed alike."""

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
        """(n,) as recorded; zeros (level flight) for an angle that was not."""
        return self.channels.get(key, self._none)

    def value(self, key: str) -> Array:
        """(n,) smoothed."""
        return self.smoothing.value(self.raw(key)).values

    def slope(self, key: str) -> SmoothedSignal:
        return self.smoothing.slope(self.raw(key))

    def lacks(self, check: SensorCheck) -> str:
        """`without heading`: channels that a check lacks; "" if all are recorded."""
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
    expected = slope._replace(values=slope.values - turn)
    return _of_rate(signals, SensorCheck("p", ("phi",)), expected)


def _yaw_rate(signals: _Signals) -> SensorCheck:
    slope, phi, theta = signals.slope("psi"), signals.value("phi"), signals.value("theta")
    pitching = np.sin(phi) * signals.slope("theta").values
    expected = slope._replace(values=np.cos(theta) * np.cos(phi) * slope.values - pitching)
    return _of_rate(signals, SensorCheck("r", ("psi",)), expected)


def _of_rate(signals: _Signals, check: SensorCheck, expected: SmoothedSignal) -> SensorCheck:
    """A rate against the rate from the attitude."""
    if lacking := signals.lacks(check):
        return replace(check, unchecked=lacking)
    fit = EquationError.fit(signals.value(check.channel), (expected,), signals.dt)
    if fit is None or (scale := _scale(fit, 0)) is None or fit.motion(expected) < LEAST_MOTION:
        return _unclear(check, fit, expected)
    return replace(check, scale=scale, bias=fit.constant, delay=fit.delay)


def _sideslip(signals: _Signals) -> tuple[SensorCheck, SensorCheck, SensorCheck]:
    """Sideslip against yaw rate; accelerometer and airspeed by their part of that balance.

    First with accelerometer and gravity together, since both have the factor g/V. Then each alone,
    as far as they differ: a late vane looks much like another scale of theirs.
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
    lateral = replace(lateral, remarks=_constant(offset))
    if lacking := signals.lacks(speed):
        return beta, replace(lateral, unchecked=lacking), replace(speed, unchecked=lacking)
    parts = (turn, roll, smooth(force), smooth(gravity))
    separate = EquationError.fit(slope, parts, signals.dt, fit.tau)
    if force_scale := _scale(separate, 0, over=2) if separate else None:
        lateral = replace(lateral, scale=force_scale, bias=_bias(offset, signals.mean_speed or 0.0))
    else:
        words = "too little motion to separate its scale from delay of sideslip and angle of attack"
        lateral = replace(lateral, unchecked=words)
    speed_scale = _scale(fit, 2, over=0)
    return (
        beta,
        lateral,
        replace(speed, scale=speed_scale) if speed_scale else _too_little(speed),
    )


def _bias(offset: Estimate, speed: float) -> Estimate:
    """Bias of the accelerometer [g] that alone would make this offset [rad/s]."""
    low, value, high = sorted(-speed / GRAVITY * part for part in offset)
    return Estimate(value, low, high)


def _constant(offset: Estimate) -> tuple[str, ...]:
    """Remark on a constant in the balance of sideslip beyond tolerance.

    offset: as a bias of yaw rate [rad/s].
    """
    if not offset.is_beyond(RATE_TOLERANCE):
        return ()
    value, low, high = np.degrees(offset)
    return (
        f"the balance of sideslip has a constant of {value:.2f} deg/s ({low:.2f} to {high:.2f}): "
        "check for a bias of yaw rate, lateral acceleration or bank angle",
    )


def _scale(fit: EquationError, k: int, over: int | None = None) -> Estimate | None:
    """A scale from coefficients; None with too little motion or too much noise.

    The interval includes the possible attenuation of a coefficient by noise.
    """
    estimate = fit.coefficient(k, over)
    noise = max(fit.noise_share(part) for part in (k, over) if part is not None)
    wide = noise * abs(estimate.value)
    if (
        not isfinite(estimate.value)
        or noise > MOST_NOISE
        or estimate.high - estimate.value + wide > WIDEST * abs(estimate.value)
    ):
        return None
    is_clear = fit.share >= FOLLOWS and fit.delay_is_inside
    if not is_clear:
        return None
    return Estimate(estimate.value, estimate.low - wide, estimate.high + wide)


def _unclear(
    check: SensorCheck, fit: EquationError | None, expected: SmoothedSignal
) -> SensorCheck:
    """A check without a scale: too little motion, or sensors that do not match."""
    if fit is None or min(fit.motion(expected), fit.spread) < LEAST_MOTION or fit.share >= FOLLOWS:
        return _too_little(check)
    words = (
        f"{NAMES[check.channel]} does not follow {_others(check)}, which explains {fit.share:.0%}"
    )
    return replace(check, unchecked="the signals do not match", remarks=(words,))


def _too_little(check: SensorCheck) -> SensorCheck:
    return replace(check, unchecked="not enough motion")
