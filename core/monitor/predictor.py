"""Predictors: maps from an observation to the point whose neighbours are searched."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from core.bounds import Bounds, check_bounds
from core.kernels.assessing import Affine
from core.kernels.compiled import in_chunks
from core.monitor.observation import RowSource
from core.recipe import family
from core.types import Array

BLOCK = 8192
"""Numbers per QR step: fits the cache, and too few for BLAS to start threads."""
ROWS_A_TASK = 8192
RANK_TOLERANCE = 1e-10
Phase = Literal["input", "start"]
Forecast = Literal["", "card", "peaks", "ensemble", "members"]
Scope = Literal["planned", "near"]


@dataclass(frozen=True)
class Predictor(ABC):
    """Recipe of a map from observations to points, fitted on safe observations only."""

    maps_to_outputs: ClassVar[bool] = False
    """whether the mapped point is an output y, channel by channel"""
    forecasts: ClassVar[bool] = False
    """whether that output is the one t_early ahead"""
    forecast: ClassVar[Forecast] = ""
    """how it forecasts the rest of the manoeuvre: from the test card, from the peaks of other
    flights, from these and neighbours, or by the members of a combination; also its section of a
    monitor's file"""

    @abstractmethod
    def fit(self, o: RowSource, y_ahead: RowSource) -> Affine:
        """Fit the map.

        o: (n, n_channels * (n_delay + 1)) safe observations, the newest outputs last.
        y_ahead: (n, n_channels) outputs t_early later; rows of NaN if the rollout ended earlier.
        Both may be larger than memory: read slices of rows.
        """


@dataclass(frozen=True)
class Linear(Predictor):
    """Least-squares forecast y_hat_{t+h} = M o_t + mu (paper, "State Prediction").

    The solution of least norm if observations are linearly dependent.
    """

    maps_to_outputs: ClassVar[bool] = True
    forecasts: ClassVar[bool] = True

    def fit(self, o: RowSource, y_ahead: RowSource) -> Affine:
        """Fit by QR in blocks: little memory, and no normal equations."""
        mean, triangle = _centred_triangle(o, y_ahead)
        if np.isnan(mean).any():
            raise ValueError(
                "no safe observation has an output t_early later: shorten t_early or lengthen "
                "the manoeuvre"
            )
        n_o = o.shape[1]
        result = np.linalg.lstsq(triangle[:, :n_o], triangle[:, n_o:], rcond=RANK_TOLERANCE)
        solution = np.asarray(result[0], np.float64)
        return Affine(solution, mean[n_o:] - mean[:n_o] @ solution)


@dataclass(frozen=True)
class ResponseFilter(Linear):
    """Forecast of the rest of the test card, from the aircraft's response so far.

    A Kalman filter of the response to one step of the input, for manoeuvres made of steps. The
    linear map, fitted as well, serves validity and finds similar rollouts.
    """

    forecast: ClassVar[Forecast] = "card"
    learns_inputs: ClassVar[bool] = False
    """whether it also learns in flight how the inputs differ from the planned ones"""


@dataclass(frozen=True)
class InputFilter(ResponseFilter):
    """The same, learning in flight also how unequal the two sides of the input are.

    For an aircraft identified from flights, whose future depends mostly on the pilot's input. It
    learns the lag of the recorded surface too.
    """

    learns_inputs: ClassVar[bool] = True


@dataclass(frozen=True)
class PeakRidge(Linear):
    """Forecast of the coming peak, by ridge regression on the samples so far.

    It learns from safe flights of any manoeuvre, without a model of the aircraft; for a
    specification known only by its label, also from failing flights. The linear map, fitted as
    well, serves validity and finds similar rollouts.
    """

    forecast: ClassVar[Forecast] = "peaks"
    past_s: Annotated[float, Bounds(above=0, below=3600)] = 2.0
    """past used [s]: samples since the input began, at most this far back."""
    phase: Phase = "input"
    """begin of the manoeuvre: when the `input` moves a surface, or the `start` of the samples."""

    def __post_init__(self) -> None:
        check_bounds(self)


@dataclass(frozen=True)
class Ensemble(PeakRidge):
    """Forecast of the outputs and of the coming peak, as one rule.

    Neighbours of the outputs ahead and the peak of the rest of the manoeuvre each give a risk; the
    higher one counts. It is calibrated as a whole, on failures that trained neither.
    """

    forecast: ClassVar[Forecast] = "ensemble"
    scope: Scope = "planned"
    """scope of the promise: aircraft and hands as `planned`, or also those `near` them, with other
    derivatives and softer inputs. A near one adds the peak of the next samples as a third part,
    and needs simulated flights."""


def _centred_triangle(*columns: RowSource) -> tuple[Array, Array]:
    """Means (m,) of columns, and R (m, m) of the QR decomposition of the centred columns.

    columns: (n, k) side by side, m in all; rows that end with NaN are skipped. A leading column of
    ones removes the means. Means are NaN if no row remains.
    """
    n, m = columns[0].shape[0], 1 + sum(part.shape[1] for part in columns)
    triangles = np.empty((-(-n // ROWS_A_TASK), m, m))

    def decompose(start: int, stop: int) -> None:
        for i in range(start, stop):
            rows = slice(i * ROWS_A_TASK, min((i + 1) * ROWS_A_TASK, n))
            ones = np.ones((rows.stop - rows.start, 1))
            block = np.hstack([ones, *(part[rows] for part in columns)])
            known = ~np.isnan(block[:, -1])
            triangles[i] = _triangle(block if known.all() else block[known])

    in_chunks(len(triangles), 1, decompose)
    whole = _triangle(triangles.reshape(-1, m))
    with np.errstate(invalid="ignore"):
        return whole[0, 1:] / whole[0, 0], whole[1:, 1:]


def _triangle(rows: Array) -> Array:
    """R (m, m) of the QR decomposition of rows (n, m), block by block without losing digits."""
    from scipy.linalg import get_lapack_funcs  # slow to import, and only needed here

    m = rows.shape[1]
    n_rows = max(BLOCK // m - m, m)
    block, upper = np.zeros((m + n_rows, m), order="F"), np.triu(np.ones((m, m)))
    factorize: Any = get_lapack_funcs("geqrf", (block,))
    for start in range(0, len(rows), n_rows):
        part = rows[start : start + n_rows]
        block[m : m + len(part)], block[m + len(part) :] = part, 0.0
        block[:m] = upper * factorize(block, overwrite_a=True)[0][:m]
    return block[:m].copy()


@dataclass(frozen=True)
class Identity(Predictor):
    """The observation itself (the paper's "No pred")."""

    def fit(self, o: RowSource, y_ahead: RowSource) -> Affine:
        n_o = o.shape[1]
        return Affine(np.eye(n_o), np.zeros(n_o))


@dataclass(frozen=True)
class PrincipalComponents(Predictor):
    """Projection on the safe observations' leading principal components (the paper's "PCA")."""

    n_components: int = 6
    """principal components kept."""

    def fit(self, o: RowSource, y_ahead: RowSource) -> Affine:
        """Fit by singular vectors, with the sign that makes the largest entry positive."""
        if not 1 <= self.n_components <= o.shape[1]:
            raise ValueError(
                f"n_components={self.n_components} was given: observations have {o.shape[1]} "
                f"entries, choose 1 to {o.shape[1]}"
            )
        mean, triangle = _centred_triangle(o)
        vectors = np.linalg.svd(triangle)[2][: self.n_components].T
        leading = np.abs(vectors).argmax(axis=0)
        matrix = vectors * np.sign(vectors[leading, np.arange(len(leading))])
        return Affine(matrix, -mean @ matrix)


@dataclass(frozen=True)
class LastOutput(Predictor):
    """The newest output, without looking ahead (the paper's "Current")."""

    maps_to_outputs: ClassVar[bool] = True

    def fit(self, o: RowSource, y_ahead: RowSource) -> Affine:
        n_channels = y_ahead.shape[1]
        return Affine(np.eye(o.shape[1])[:, -n_channels:], np.zeros(n_channels))


@dataclass(frozen=True)
class Members(Predictor):
    """Predictors of a combination's members, see core.monitor.combination."""

    forecast: ClassVar[Forecast] = "members"

    def fit(self, o: RowSource, y_ahead: RowSource) -> Affine:
        raise ValueError(NOT_TRAINED)


NOT_TRAINED = (
    "a combination consists of trained monitors and is not trained itself: train its members, then "
    "`forewarn combine` or POST /api/v1/monitors/combinations"
)
PREDICTORS = family(
    "predictor",
    Predictor,
    {
        "linear": Linear(),
        "identity": Identity(),
        "pca": PrincipalComponents(),
        "last_output": LastOutput(),
        "response_filter": ResponseFilter(),
        "input_filter": InputFilter(),
        "peak_ridge": PeakRidge(),
        "ensemble": Ensemble(),
    },
    made={"combination": Members()},
)
