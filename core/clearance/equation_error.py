"""Equation error: least squares between smoothed signals, with a delay.

Both sides of a linear equation pass through one window, derivatives through its slope, so the
equation stays true while noise averages out. The intervals allow for autocorrelated residuals, from
gusts and from the window (Klein and Morelli, Aircraft System Identification, AIAA 2006, chapter 5;
Morelli and Klein, NASA CR-194893).
"""

from math import floor, inf
from typing import NamedTuple, Self

import numpy as np

from core.types import Array, Flags

WIDTH_S = 0.6
"""Width of the smoothing window [s]; the Dutch roll of a large transport takes ten times this."""
CORRELATED_S = 2.0
"""Residuals farther apart count as independent [s]."""
MOST_DELAY_S, DELAY_STEP_S = 0.3, 0.05
"""Largest delay searched, and the step of the first coarse search [s]."""
STEPS, SMALL_STEP_S = 6, 1e-4
"""Gauss-Newton steps from the best of those, and the step at which they end [s]."""
CONFIDENCE = 0.95
FEWEST_FREE = 4.0
"""Fewest independent residuals, beyond the unknowns, for an interval."""


class Estimate(NamedTuple):
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float

    def is_beyond(self, tolerance: float, about: float = 0.0) -> bool:
        """Whether the whole interval is farther from a number than the tolerance."""
        return self.low > about + tolerance or self.high < about - tolerance


class SmoothedSignal(NamedTuple):
    """values: (n,), NaN where unknown.   noise: variance of the remaining noise."""

    values: Array
    noise: float


DIFFERENCES: Array = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
"""Derivative from samples two before to two behind, with error (omega dt)^4 / 30."""


def smoothing_window(dt: float) -> tuple[Array, Array]:
    """A biweight window, and the window for the derivative of its output.

    Both are exact for constants and straight lines.
    """
    reach = max(2, round(0.5 * WIDTH_S / dt))
    u = np.arange(-reach, reach + 1) / (reach + 1)
    smooth: Array = (1.0 - u * u) ** 2
    smooth /= smooth.sum()
    slope = np.convolve(smooth, DIFFERENCES[::-1] / dt)
    return np.pad(smooth, 2), slope


class Smoothing:
    """One window, and its slope, for all (n,) signals of an equation."""

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self._smooth, self._slope = smoothing_window(dt)

    def value(self, signal: Array) -> SmoothedSignal:
        return self._through(signal, self._smooth)

    def slope(self, signal: Array) -> SmoothedSignal:
        return self._through(signal, self._slope)

    def _through(self, signal: Array, window: Array) -> SmoothedSignal:
        """Assumes white noise, and that the window removes only noise."""
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

    share: explained share of the variance of y.   spread: standard deviation of y.
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
        """Fit the rows with all signals known within MOST_DELAY_S; None if there are too few.

        y, x: (n,) each, one sample each dt [s].   tau: delay to start from [s]; None: searched.
        """
        margin = round(MOST_DELAY_S / dt) + 3
        signals = np.column_stack([y, *(signal.values for signal in x)])
        unknown = np.pad(~np.isfinite(signals).all(axis=1), margin, constant_values=True)
        rows = np.convolve(unknown.astype(float), np.ones(2 * margin + 1), "valid") < 0.5
        if rows.sum() * dt < CORRELATED_S:
            return None
        fitted = cls(y, x, rows, dt)
        fitted.tau = fitted._coarse_delay() if tau is None else tau
        return fitted if fitted._solve() else None

    def motion(self, signal: SmoothedSignal) -> float:
        """Standard deviation of a signal over the fitted rows."""
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
        """Whether the best delay is inside the searched range."""
        return abs(self.tau) < MOST_DELAY_S

    def coefficient(self, k: int, over: int | None = None) -> Estimate:
        """b_k, or its ratio to another coefficient; infinite if that is 0."""
        b, gradient = self._b, np.zeros(len(self._covariance))
        if over is None:
            gradient[k] = 1.0
            return self._estimate(b[k], gradient)
        if not b[over]:
            return Estimate(inf, -inf, inf)
        gradient[k], gradient[over] = 1.0 / b[over], -b[k] / b[over] ** 2
        return self._estimate(b[k] / b[over], gradient)

    def noise_share(self, k: int) -> float:
        """Share of noise in the part of x_k the others do not explain: b_k is too small by it."""
        return float(self._noise_shares[k])

    def _estimate(self, value: float, gradient: Array) -> Estimate:
        variance = float(gradient @ self._covariance @ gradient)
        half = self._quantile * variance**0.5 if variance >= 0.0 else inf
        return Estimate(float(value), float(value - half), float(value + half))

    def _coarse_delay(self) -> float:
        tries = np.arange(-MOST_DELAY_S, MOST_DELAY_S + 0.5 * DELAY_STEP_S, DELAY_STEP_S)
        return float(min(tries, key=self._misfit))

    def _misfit(self, tau: float) -> float:
        x, y = self._at(tau)[self._rows], self._y[self._rows]
        return float(np.square(y - x @ np.linalg.lstsq(x, y)[0]).sum())

    def _solve(self) -> bool:
        """Solve for delay, coefficients and covariance; False with too few residuals."""
        for _ in range(STEPS):
            jacobian, residuals = self._linearised()
            step = float(np.linalg.lstsq(jacobian[self._rows], residuals[self._rows])[0][-1])
            self.tau = float(np.clip(self.tau + step, -MOST_DELAY_S, MOST_DELAY_S))
            if abs(step) < SMALL_STEP_S:
                break
        jacobian, residuals = self._linearised()
        return self._judge(jacobian, residuals)

    def _judge(self, jacobian: Array, residuals: Array) -> bool:
        """Covariance of the unknowns, from the autocorrelation of the residuals."""
        n, n_unknown = int(self._rows.sum()), jacobian.shape[1]
        most = min(round(CORRELATED_S / self._dt), len(residuals) - 1)
        products = [residuals[: len(residuals) - lag] @ residuals[lag:] for lag in range(most + 1)]
        correlation = (1.0 - np.arange(most + 1) / (most + 1)) * np.array(products) / n
        if not correlation[0] > 0.0:
            return False
        n_free = n / max(1.0, 2.0 * correlation.sum() / correlation[0] - 1.0) - n_unknown
        if n_free < FEWEST_FREE:
            return False
        gram = jacobian.T @ jacobian
        inverse = np.linalg.pinv(gram, rcond=1e-12, hermitian=True)
        middle = correlation[0] * gram
        for lag in range(1, most + 1):
            product = jacobian[:-lag].T @ jacobian[lag:]
            middle += correlation[lag] * (product + product.T)
        self._covariance = inverse @ middle @ inverse * (1.0 + n_unknown / n_free)
        from scipy.special import stdtrit  # slow to import, and only needed here

        self._quantile = float(stdtrit(n_free, 0.5 + 0.5 * CONFIDENCE))
        self._noise_shares = self._noise * n * np.diag(inverse)[: len(self._noise)]
        self.share = float(1.0 - correlation[0] / self.spread**2) if self.spread else 0.0
        return True

    def _linearised(self) -> tuple[Array, Array]:
        """Jacobian of the model (n, k + 2), the delay last; residuals (n,)."""
        x = self._at(self.tau)
        self._b = np.linalg.lstsq(x[self._rows], self._y[self._rows])[0]
        ahead, behind = (self._at(self.tau + sign * self._dt) for sign in (-1, 1))
        by_delay = (behind - ahead) @ self._b / (2.0 * self._dt)
        return np.column_stack([x, by_delay]), self._y - x @ self._b

    def _at(self, tau: float) -> Array:
        """Signals and constant (n, k + 1) at a delay; zeros outside the fitted rows."""
        x = np.column_stack([late(self._x, tau / self._dt), np.ones(len(self._y))])
        return np.where(self._rows[:, None], x, 0.0)


def late(x: Array, samples: float) -> Array:
    """x (n, k) delayed by this many samples, by cubic interpolation; NaN outside."""
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
