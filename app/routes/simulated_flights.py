"""The simulated flights of a monitor, which charts show behind a flown one."""

import hashlib
from functools import lru_cache
from threading import Lock
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Header, Response
from pydantic import BaseModel, Field

from app import json_codec
from app.assessment.planned_test import planned_test
from app.assessment.safe_flights import (
    HIGH,
    LOW,
    ForecastInterval,
    SafeBand,
    Unavailable,
    forecast_interval,
    safe_band,
)
from app.routes.dependencies import StoreDep
from app.store.store import Store
from core.channels import Dictionary
from core.types import Array

router = APIRouter(prefix="/api/v1/monitors", tags=["monitors"])
MOST_TIMES = 240
DIGITS = 5
MOST_KEPT = 32
NOT_HERE = "its dataset is not on this server"


class QuantileInterval(BaseModel):
    """Quantiles of a channel at each time, or of its error, in its unit."""

    low: list[float] | float
    high: list[float] | float


class SafeFlightsBand(BaseModel):
    """Band of the safe flights, each aligned at the start of its manoeuvre as detected."""

    t: list[float] = Field(description="from the manoeuvre's start [s]")
    channels: dict[str, QuantileInterval]
    n_flights: int
    onset: float = Field(description="usual time of the start in a simulated flight [s]")


class ForecastError(BaseModel):
    """Error of the forecast on safe flights that it was not fitted on: measured less forecast."""

    channels: dict[str, QuantileInterval]
    n_flights: int
    covered: float = Field(
        description="share of the samples of failing flights within it; the least of the channels"
    )


class SimulatedFlights(BaseModel):
    """Flights expected from the dataset of a monitor; null with the reason where unknown."""

    dataset: str | None = Field(description="id; its rollouts are at /datasets/{id}/rollouts")
    reason: str = Field(description="why there is no dataset, else empty")
    quantiles: tuple[float, float]
    lead_in: float = Field(description="trim before the start, in flights and scorings [s]")
    band: SafeFlightsBand | None
    band_reason: str
    forecast: ForecastError | None
    forecast_reason: str


_ONE_AT_A_TIME = Lock()


@router.get("/{monitor_id}/simulated", responses={304: {"description": "as the ETag names it"}})
def read_simulated_flights(
    monitor_id: str, store: StoreDep, if_none_match: Annotated[str, Header()] = ""
) -> SimulatedFlights:
    """Band of the simulated safe flights and interval of the forecast, for displays.

    At each time the band holds 90 % of the flights, each aligned at its manoeuvre's start; a whole
    flight stays within it less often.
    """
    info = store.monitors.info(monitor_id)
    with _ONE_AT_A_TIME:
        body = _simulated(store, monitor_id, info.digest, info.dataset_id)
    headers = {"ETag": f'"{hashlib.sha256(body).hexdigest()[:32]}"', "Cache-Control": "no-cache"}
    if headers["ETag"] in if_none_match:
        return Response(status_code=304, headers=headers)  # pyright: ignore[reportReturnType]
    return Response(body, 200, headers, "application/json")  # pyright: ignore[reportReturnType]


@lru_cache(MOST_KEPT)
def _simulated(store: Store, monitor_id: str, digest: str, dataset_id: str | None) -> bytes:
    """The answer, computed once for a monitor with its dataset."""
    monitor, band, forecast = store.monitors.get(monitor_id), None, None
    band_reason = forecast_reason = reason = "" if dataset_id else NOT_HERE
    if dataset_id:
        dataset = store.datasets.get(dataset_id)
        try:
            band = _plain_band(safe_band(dataset), dataset.dictionary)
        except Unavailable as error:
            band_reason = str(error)
        try:
            forecast = _plain_forecast(forecast_interval(monitor, dataset), dataset.dictionary)
        except Unavailable as error:
            forecast_reason = str(error)
    answer = {
        "dataset": dataset_id,
        "reason": reason,
        "quantiles": (LOW, HIGH),
        "lead_in": planned_test(monitor).trim_segment_s,
        "band": band,
        "band_reason": band_reason,
        "forecast": forecast,
        "forecast_reason": forecast_reason,
    }
    return json_codec.encode(answer)


def _plain_band(band: SafeBand, dictionary: Dictionary) -> dict[str, Any]:
    n = len(band.t)
    shown = np.unique(np.linspace(0, n - 1, min(n, MOST_TIMES)).astype(int))
    ends = _rounded(band.low[shown]).T.tolist(), _rounded(band.high[shown]).T.tolist()
    return {
        "t": _rounded(band.t[shown]).tolist(),
        "channels": _by_channel(dictionary, *ends),
        "n_flights": band.n_flights,
        "onset": band.onset,
    }


def _plain_forecast(interval: ForecastInterval, dictionary: Dictionary) -> dict[str, Any]:
    ends = _rounded(interval.low).tolist(), _rounded(interval.high).tolist()
    return {
        "channels": _by_channel(dictionary, *ends),
        "n_flights": interval.n_flights,
        "covered": interval.covered,
    }


def _by_channel(dictionary: Dictionary, low: list[Any], high: list[Any]) -> dict[str, Any]:
    ends = zip(dictionary.keys, low, high, strict=True)
    return {key: {"low": least, "high": greatest} for key, least, greatest in ends}


def _rounded(values: Array) -> Array:
    """Round to DIGITS significant digits, which halves the answer."""
    return np.vectorize(lambda value: float(f"{value:.{DIGITS}g}"), otypes=[float])(values)
