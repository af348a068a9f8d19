"""Equation error: smoothed signals against each other by least squares, one of them late.

Both sides of a linear equation go through one window, and what is differentiated through its slope,
so that the equation stays true while noise averages out. The intervals allow for the
autocorrelation of the residuals, as of gusts and of the window (Klein and Morelli, Aircraft System
Identification, AIAA 2006, chapter 5; Morelli and Klein, NASA CR-194893).
"""

from math import floor, inf
from typing import NamedTuple, Self

import numpy as np

from core.types import Array, Flags

WIDTH_S = 0.6
"""Of the smoothing window [s]; the Dutch roll of a large transport takes ten times as long."""
CORRELATED_S = 2.0
"""Residuals farther apart are taken as independent [s]."""
MOST_DELAY_S, DELAY_STEP_S = 0.3, 0.05
"""Delays that are looked for, and how far apart those are that are tried first [s]."""
STEPS, SMALL_STEP_S = 6, 1e-4
"""Of Gauss and Newton, from the best of those; and the one after which no more are made [s]."""
CONFIDENCE = 0.95
FEWEST_FREE = 4.0
"""Independent residuals beyond the unknowns that an interval needs."""


class Estimate(NamedTuple):
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float

    def is_beyond(self, tolerance: float, about: float = 0.0) -> bool:
        """Whether all of the interval is farther from a number than a tolerance."""
        return self.low > about + tolerance or self.high < about - tolerance


class SmoothedSignal(NamedTuple):
    """values: (n,), NaN where unknown.   noise: variance of the noise that is left in them."""

    values: Array
    noise: float


DIFFERENCES: Array = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
"""Of samples two before to two behind, the derivative up to (omega dt)^4 / 30."""


def smoothing_window(dt: float, width_s: float = WIDTH_S) -> tuple[Array, Array]:
    """A biweight window, and the one that takes the derivative of what that one leaves.

    Both exact for constants and straight lines.
    """
    reach = max(2, round(0.5 * width_s / dt))
    u = np.arange(-reach, reach + 1) / (reach + 1)
    smooth: Array = (1.0 - u * u) ** 2
    smooth /= smooth.sum()
    slope = np.convolve(smooth, DIFFERENCES[::-1] / dt)
    return np.pad(smooth, 2), slope


class Smoothing:
    """One window, and its slope, for all the signals of an equation."""

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self._smooth, self._slope = smoothing_window(dt)

    def value(self, signal: Array) -> SmoothedSignal:
        """(n,) smoothed."""
        return self._through(signal, self._smooth)

    def slope(self, signal: Array) -> SmoothedSignal:
        """(n,) the derivative, smoothed."""
        return self._through(signal, self._slope)

    def _through(self, signal: Array, window: Array) -> SmoothedSignal:
        """Noise is taken as white, and as all that the window takes out."""
        values, reach = np.full(len(signal), np.nan), len(window) // 2
        if len(signal) < len(window):
            return SmoothedSignal(values, 0.0)
        inside = slice(reach, len(signal) - reach)
        values[inside] = np.convolve(signal, window, "valid")
        rough = signal[inside] - np.convolve(signal, self._smooth, "valid")
        rough = rough[np.isfinite(rough)]
        share = 1.0 - 2.0 * self._smooth[reach] + self._smooth @ self._smooth
        white = rough @ rough / (max(len(rough), 1) * share)
        return SmoothedSignal(values, float(white * (window @ window)))


class EquationError:
    """y(t) = sum of b_k x_k(t - tau) + b_last, fitted.

    share: of the variance of y that is explained.   spread: standard deviation of y.
    """

    def __init__(self, y: Array, x: tuple[SmoothedSignal, ...], rows: Flags, dt: float) -> None:
        self._y, self._rows, self._dt = np.where(rows, y, 0.0), rows, dt
        self._x = np.column_stack([signal.values for signal in x])
        self._noise = np.array([*(signal.noise for signal in x), 0.0])
        self.spread, self.tau, self.share = float(y[rows].std()), 0.0, 0.0

    @classmethod
    def fit(
        cls, y: Array, x: tuple[SmoothedSignal, ...], dt: float, tau: float | None = None
    ) -> Self | None:
        """Fit where all is known as far around as delays are looked for; None where that is short.

        y, x: (n,) each, a sample each dt [s].   tau: delay to begin with [s]; None: looked for.
        """
        margin = round(MOST_DELAY_S / dt) + 3
        signals = np.column_stack([y, *(signal.values for signal in x)])
        unknown = np.pad(~np.isfinite(signals).all(axis=1), margin, constant_values=True)
        rows = np.convolve(unknown.astype(float), np.ones(2 * margin + 1), "valid") < 0.5
        if rows.sum() * dt < CORRELATED_S:
            return None
        fitted = cls(y, x, rows, dt)
        fitted.tau = fitted._about() if tau is None else tau
        return fitted if fitted._solve() else None

    def motion(self, signal: SmoothedSignal) -> float:
        """Standard deviation of a signal where it was fitted."""
        return float(signal.values[self._rows].std())

    @property
    def delay(self) -> Estimate:
        """tau [s]."""
        return self._estimate(self.tau, np.eye(len(self._covariance))[-1])

    @property
    def constant(self) -> Estimate:
        """b_last."""
        return self.coefficient(len(self._b) - 1)

    @property
    def delay_is_inside(self) -> bool:
        """Whether the best delay is not the largest one that was looked for."""
        return abs(self.tau) < MOST_DELAY_S

    def coefficient(self, k: int, over: int | None = None) -> Estimate:
        """b_k, or its quotient with another coefficient; infinite where that is 0."""
        b, gradient = self._b, np.zeros(len(self._covariance))
        if over is None:
            gradient[k] = 1.0
            return self._estimate(b[k], gradient)
        if not b[over]:
            return Estimate(inf, -inf, inf)
        gradient[k], gradient[over] = 1.0 / b[over], -b[k] / b[over] ** 2
        return self._estimate(b[k] / b[over], gradient)

    def noise_share(self, k: int) -> float:
        """Share of noise in what of x_k the others do not explain: so much too small is b_k."""
        return float(self._noise_shares[k])

    def _estimate(self, value: float, gradient: Array) -> Estimate:
        variance = float(gradient @ self._covariance @ gradient)
        half = self._quantile * variance**0.5 if variance >= 0.0 else inf
        return Estimate(float(value), float(value - half), float(value + half))

    def _about(self) -> float:
        """About the best delay."""
        tries = np.arange(-MOST_DELAY_S, MOST_DELAY_S + 0.5 * DELAY_STEP_S, DELAY_STEP_S)
        return float(min(tries, key=self._misfit))

    def _misfit(self, tau: float) -> float:
        x, y = self._at(tau)[self._rows], self._y[self._rows]
        return float(np.square(y - x @ np.linalg.lstsq(x, y)[0]).sum())

    def _solve(self) -> bool:
        """Find delay, coefficients and their covariance; whether there are residuals enough."""
        for _ in range(STEPS):
            jacobian, residuals = self._linearised()
            step = float(np.linalg.lstsq(jacobian[self._rows], residuals[self._rows])[0][-1])
            self.tau = float(np.clip(self.tau + step, -MOST_DELAY_S, MOST_DELAY_S))
            if abs(step) < SMALL_STEP_S:
                break
        jacobian, residuals = self._linearised()
        return self._judge(jacobian, residuals)

    def _judge(self, jacobian: Array, residuals: Array) -> bool:
        """The covariance of the unknowns, from how long the residuals resemble each other."""
        n, n_unknown = int(self._rows.sum()), jacobian.shape[1]
        most = min(round(CORRELATED_S / self._dt), len(residuals) - 1)
        products = [residuals[: len(residuals) - lag] @ residuals[lag:] for lag in range(most + 1)]
        alike = (1.0 - np.arange(most + 1) / (most + 1)) * np.array(products) / n
        if not alike[0] > 0.0:
            return False
        n_free = n / max(1.0, 2.0 * alike.sum() / alike[0] - 1.0) - n_unknown
        if n_free < FEWEST_FREE:
            return False
        gram = jacobian.T @ jacobian
        inverse = np.linalg.pinv(gram, rcond=1e-12, hermitian=True)
        middle = alike[0] * gram
        for lag in range(1, most + 1):
            product = jacobian[:-lag].T @ jacobian[lag:]
            middle += alike[lag] * (product + product.T)
        self._covariance = inverse @ middle @ inverse * (1.0 + n_unknown / n_free)
        from scipy.special import stdtrit  # slow to import, and only needed here

        self._quantile = float(stdtrit(n_free, 0.5 + 0.5 * CONFIDENCE))
        self._noise_shares = self._noise * n * np.diag(inverse)[: len(self._noise)]
        self.share = float(1.0 - alike[0] / self.spread**2) if self.spread else 0.0
        return True

    def _linearised(self) -> tuple[Array, Array]:
        """Derivatives of the model by its unknowns (n, k + 2), the delay last; residuals (n,)."""
        x = self._at(self.tau)
        self._b = np.linalg.lstsq(x[self._rows], self._y[self._rows])[0]
        ahead, behind = (self._at(self.tau + sign * self._dt) for sign in (-1, 1))
        by_delay = (behind - ahead) @ self._b / (2.0 * self._dt)
        return np.column_stack([x, by_delay]), self._y - x @ self._b

    def _at(self, tau: float) -> Array:
        """Signals and constant (n, k + 1) at a delay; zeros in rows that are not fitted."""
        x = np.column_stack([late(self._x, tau / self._dt), np.ones(len(self._y))])
        return np.where(self._rows[:, None], x, 0.0)


def late(x: Array, samples: float) -> Array:
    """x (n, k) so many samples later, by cubics; NaN where that is outside."""
    whole = floor(samples)
    u = samples - whole
    weights = (
        -u * (u - 1) * (u - 2) / 6,
        (u + 1) * (u - 1) * (u - 2) / 2,
        -(u + 1) * u * (u - 2) / 2,
        (u + 1) * u * (u - 1) / 6,
    )
    room = abs(whole) + 2
    padded = np.pad(x, ((room, room), (0, 0)), constant_values=np.nan)
    moved = np.zeros_like(x)
    for lag, weight in enumerate(weights, whole - 1):
        moved += weight * padded[room - lag : room - lag + len(x)]
    return moved
