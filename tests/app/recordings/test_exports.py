"""Other programs read back every exported number, unit and missing value."""

import io

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow.parquet as pq
import pytest
from scipy.io import loadmat

from app.recordings.exports import EXPORTS, export
from core.channels import CHANNELS, KEYS
from core.monitor.assessment import STATES

ABOUT = {"monitor": "ab12", "epsilon": 0.1, "note": "β in rad"}
N = 50


@pytest.fixture
def samples() -> npt.NDArray:
    """Fifty samples of all states, with gaps; no heading was recorded."""
    rng = np.random.default_rng(3)
    dtype = np.dtype(
        [
            ("t", "f8"), ("y", "f8", 6), ("p_value", "f8"), ("withdrawn", "f8"), ("alert", "?"),
            ("state", "u1"), ("manoeuvre", "i2"), ("y_hat", "f8", 6), ("attitude", "f8", 3),
        ]
    )  # fmt: skip
    samples = np.zeros(N, dtype)
    samples["t"] = 3358.0 + 0.1 * np.arange(N)
    for name in ("y", "p_value", "withdrawn", "y_hat", "attitude"):
        samples[name] = rng.standard_normal(samples[name].shape)
    samples["state"] = np.arange(N) % len(STATES)
    samples["alert"] = np.arange(N) % 3 == 0
    samples["manoeuvre"] = np.arange(N) // 20 - 1
    samples["p_value"][samples["state"] != 0] = np.nan
    samples["y"][7] = np.nan
    samples["attitude"][:, 2] = np.nan
    return samples


def exported(samples: npt.NDArray, form: str) -> bytes:
    file = io.BytesIO()
    export(samples, ABOUT, form, file)
    return file.getvalue()


def test_csv_names_carry_units_and_numbers_come_back_bit_for_bit(samples: npt.NDArray) -> None:
    table = pd.read_csv(io.BytesIO(exported(samples, "csv")))
    assert list(table)[:7] == [
        "t_s", "beta_from_trim_rad", "p_from_trim_radps", "r_from_trim_radps", "Ny_from_trim_g",
        "delta_a_from_trim_rad", "delta_r_from_trim_rad",
    ]  # fmt: skip
    np.testing.assert_array_equal(table["t_s"], samples["t"])
    np.testing.assert_array_equal(table["predicted_Ny_from_trim_g"], samples["y_hat"][:, 3])
    np.testing.assert_array_equal(table["p_value"], samples["p_value"])
    assert table["state"].tolist() == [STATES[code].value for code in samples["state"]]
    assert "psi_rad" not in table
    assert table["in_manoeuvre"].tolist() == (samples["manoeuvre"] >= 0).tolist()
    assert b"nan" not in exported(samples, "csv").lower()


def test_a_table_is_the_same_however_many_rows_are_written_at_once(
    samples: npt.NDArray, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = exported(samples, "csv")
    monkeypatch.setattr("app.recordings.exports.BLOCK", 7)
    assert exported(samples, "csv") == whole


def test_parquet_keeps_units_beside_the_columns(samples: npt.NDArray) -> None:
    table = pq.read_table(io.BytesIO(exported(samples, "parquet")))
    units = {field.name: (field.metadata or {}).get(b"unit") for field in table.schema}
    for channel in CHANNELS:
        assert units[channel.key] == channel.unit.encode()
        assert units[f"predicted_{channel.key}"] == channel.unit.encode()
        assert (table.schema.field(channel.key).metadata or {})[b"reference"] == b"trim"
    assert b'"monitor": "ab12"' in (table.schema.metadata or {})[b"forewarn"]
    assert table["p_value"].null_count == np.isnan(samples["p_value"]).sum()
    np.testing.assert_array_equal(table["beta"].to_numpy(zero_copy_only=False), samples["y"][:, 0])
    assert table["alert"].to_pylist() == samples["alert"].tolist()


def test_mat_opens_in_scipy_with_units(samples: npt.NDArray) -> None:
    content = loadmat(io.BytesIO(exported(samples, "mat")), simplify_cells=True)
    for c, key in enumerate(KEYS):
        np.testing.assert_array_equal(content[key], samples["y"][:, c])
        assert content["units"][key] == CHANNELS[c].unit
    assert content["units"]["t"] == "s"
    names = [content["state_names"][number - 1] for number in content["state"]]
    assert names == [STATES[code].value for code in samples["state"]]
    assert '"epsilon": 0.1' in content["about"]
    assert {*content["from_trim"]} == {*KEYS, *(f"predicted_{key}" for key in KEYS)}


@pytest.mark.parametrize("form", EXPORTS)
def test_the_same_flight_makes_the_same_file(samples: npt.NDArray, form: str) -> None:
    assert exported(samples, form) == exported(samples.copy(), form)
