"""Predictors: how an observation is mapped to the point whose neighbours are looked up."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, get_args

import numpy as np

from core.bounds import Bounds, check_bounds
from core.kernels.compiled import in_chunks
from core.kernels.mapping import Affine
from core.monitor.observation import RowSource
from core.recipe import family
from core.types import Array

N_OUTPUTS = 6
BLOCK = 8192
"""Numbers that a QR step takes: fits the cache, and is too little for BLAS to start threads on."""
ROWS_A_TASK = 8192
RANK_TOLERANCE = 1e-10
Phase = Literal["input", "start"]


@dataclass(frozen=True)
class Predictor(ABC):
    """Recipe of a map from observations to points, fitted on safe observations only."""

    maps_to_outputs: ClassVar[bool] = False
    """Whether the mapped point is an output y, channel by channel."""
    forecasts: ClassVar[bool] = False
    """Whether that output is the one t_early ahead."""
    forecast: ClassVar[Literal["", "card", "peaks", "members"]] = ""
    """How it forecasts what is left of the manoeuvre: from the test card, by what the peaks of
    other flights were, or as the members of a combination do; and the section of a monitor's
    file."""

    @abstractmethod
    def fit(self, o: RowSource, y_ahead: RowSource) -> Affine:
        """Fit the map.

        o: (n, 6 * (n_delay + 1)) safe observations, the newest outputs last.
        y_ahead: (n, 6) outputs t_early later; rows of NaN where the rollout ended before.
        Both may be too many for the memory: read a slice of rows at a time.
        """


@dataclass(frozen=True)
class Linear(Predictor):
    """Least-squares forecast y_hat_{t+h} = M o_t + mu (paper, "State Prediction").

    Where observations are linearly dependent, the solution of least norm.
    """

    maps_to_outputs: ClassVar[bool] = True
    forecasts: ClassVar[bool] = True

    def fit(self, o: RowSource, y_ahead: RowSource) -> Affine:
        """Fit by QR in blocks, so that memory stays small, and without normal equations."""
        mean, triangle = _centred_triangle(o, y_ahead)
        if np.isnan(mean).any():
            raise ValueError(
                "no safe observation has an output t_early later: shorten t_early or lengthen "
                "the manoeuvre"
            )
        n_o = o.shape[1]
        found = np.linalg.lstsq(triangle[:, :n_o], triangle[:, n_o:], rcond=RANK_TOLERANCE)
        solution = np.asarray(found[0], np.float64)
        return Affine(solution, mean[n_o:] - mean[:n_o] @ solution)


@dataclass(frozen=True)
class ResponseFilter(Linear):
    """Forecast of what is left of the test card, from how the aircraft responded so far.

    A Kalman filter of the aircraft's response to one step of the input, for manoeuvres made of
    steps. The map fitted beside it serves validity, and names the rollouts that a sample is like.
    """

    forecast: ClassVar[Literal["", "card", "peaks", "members"]] = "card"


@dataclass(frozen=True)
class PeakRidge(Linear):
    """Forecast of the peak that is still to come, by ridge regression on what was flown so far.

    It is learned from safe flights, for manoeuvres of any kind, without a model of the aircraft. A
    specification known only by its label takes flights that failed too. The map fitted beside it
    serves validity, and names the rollouts that a sample is like.
    """

    forecast: ClassVar[Literal["", "card", "peaks", "members"]] = "peaks"
    past_s: Annotated[float, Bounds(above=0, below=3600)] = 2.0
    """past that is read [s]: samples since the input began, so far back at most."""
    phase: Phase = "input"
    """begin of the manoeuvre: when its `input` is seen to move a surface, or the `start` of the
    samples."""

    def __post_init__(self) -> None:
        """Refuse no past, and a begin of no name."""
        check_bounds(self)
        if self.phase not in get_args(Phase):
            raise ValueError(f"phase={self.phase!r} was given: choose input or start")


def _centred_triangle(*columns: RowSource) -> tuple[Array, Array]:
    """Means (m,) of columns, and R (m, m) of the QR decomposition of columns less their means.

    columns: (n, k) side by side, m in all; rows that end with NaN are left out. A column of ones
    before them takes the means out. Means are NaN where no row is left.
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
    """R (m, m) of the QR decomposition of rows (n, m), block by block: no digits are lost."""
    from scipy.linalg import get_lapack_funcs  # slow to import, and only needed here

    m = rows.shape[1]
    n_rows = max(BLOCK // m - m, m)
    block, upper = np.zeros((m + n_rows, m), order="F"), np.triu(np.ones((m, m)))
    factorize: Any = get_lapack_funcs("geqrf", (block,))
    for start in range(0, len(rows), n_rows):
        own = rows[start : start + n_rows]
        block[m : m + len(own)], block[m + len(own) :] = own, 0.0
        block[:m] = upper * factorize(block, overwrite_a=True)[0][:m]
    return block[:m].copy()


@dataclass(frozen=True)
class Identity(Predictor):
    """The observation itself (the paper's "No pred")."""

    def fit(self, o: RowSource, y_ahead: RowSource) -> Affine:
        """Fit nothing."""
        n_o = o.shape[1]
        return Affine(np.eye(n_o), np.zeros(n_o))


@dataclass(frozen=True)
class PrincipalComponents(Predictor):
    """Projection on the safe observations' leading principal components (the paper's "PCA")."""

    n_components: int = 6
    """principal components kept."""

    def fit(self, o: RowSource, y_ahead: RowSource) -> Affine:
        """Fit by singular vectors; each sign makes the largest entry positive."""
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
    """The newest output: no look ahead (the paper's "Current")."""

    maps_to_outputs: ClassVar[bool] = True

    def fit(self, o: RowSource, y_ahead: RowSource) -> Affine:
        """Fit nothing."""
        return Affine(np.eye(o.shape[1])[:, -N_OUTPUTS:], np.zeros(N_OUTPUTS))


@dataclass(frozen=True)
class Members(Predictor):
    """Those of a combination's members, see core.monitor.combination."""

    forecast: ClassVar[Literal["", "card", "peaks", "members"]] = "members"

    def fit(self, o: RowSource, y_ahead: RowSource) -> Affine:
        """Refuse: each member was fitted by itself."""
        raise ValueError(NOT_TRAINED)


NOT_TRAINED = (
    "a combination is made of trained monitors and is not trained itself: train its members, then "
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
        "peak_ridge": PeakRidge(),
    },
    made={"combination": Members()},
)
