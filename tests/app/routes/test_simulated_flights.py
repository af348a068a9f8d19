"""GET /monitors/{id}/simulated: what charts show behind a flight."""

from typing import Any

import pytest

from core.dataset import Dataset
from core.monitor import Monitor
from core.planned_test.collection import collect
from tests.support import attas


@pytest.fixture(scope="module")
def dataset() -> Dataset:
    return collect(attas.TEST)


@pytest.fixture(scope="module")
def stored(client: Any, attas: Monitor, dataset: Dataset) -> tuple[str, str]:
    store = client.app.state.store
    about = store.datasets.add(dataset, "transport doublet")
    return about.id, store.monitors.add(attas, "transport", about.id).id


def test_the_band_and_the_interval_are_those_of_its_dataset(
    client: Any, stored: tuple[str, str], dataset: Dataset
) -> None:
    answer = client.get(f"/api/v1/monitors/{stored[1]}/simulated").json()
    assert answer["dataset"] == stored[0]
    assert answer["reason"] == answer["band_reason"] == answer["forecast_reason"] == ""
    assert answer["lead_in"] == pytest.approx(0.5)
    band = answer["band"]
    assert 0.9 * len(dataset.safe) < band["n_flights"] <= len(dataset.safe)
    assert band["t"][0] <= 0 < band["t"][-1]
    for channel in band["channels"].values():
        assert len(channel["low"]) == len(channel["high"]) == len(band["t"])
        assert all(low <= high for low, high in zip(channel["low"], channel["high"], strict=True))
    for error in answer["forecast"]["channels"].values():
        assert error["low"] < 0 < error["high"]


def test_an_unchanged_answer_is_not_sent_again(client: Any, stored: tuple[str, str]) -> None:
    path = f"/api/v1/monitors/{stored[1]}/simulated"
    first = client.get(path)
    again = client.get(path, headers={"If-None-Match": first.headers["ETag"]})
    assert again.status_code == 304
    assert again.content == b""


def test_a_monitor_without_its_dataset_gives_the_reason(client: Any, attas: Monitor) -> None:
    alone = client.app.state.store.monitors.add(attas, "alone").id
    answer = client.get(f"/api/v1/monitors/{alone}/simulated").json()
    assert answer["dataset"] is None
    assert answer["band"] is None
    assert "not on this server" in answer["reason"]


def test_rollouts_can_be_read_of_some_channels(client: Any, stored: tuple[str, str]) -> None:
    path = f"/api/v1/datasets/{stored[0]}/rollouts?outcome=safe&count=2&channel=beta&channel=Ny"
    for rollout in client.get(path).json():
        assert list(rollout["telemetry"]) == ["t", "beta", "Ny"]
