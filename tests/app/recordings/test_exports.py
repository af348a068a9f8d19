"""Other programs read back every exported number, unit and missing value."""

import io
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow.parquet as pq
import pytest
from scipy.io import loadmat

from app.recordings.exports import EXPORTS, export
from core.channels import CHANNELS, KEYS, LATERAL, LONGITUDINAL, Dictionary, channel
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


def exported(
    samples: npt.NDArray, form: str, dictionary: Dictionary = LATERAL, **about: Any
) -> bytes:
    file = io.BytesIO()
    export(samples, ABOUT | about, form, file, dictionary)
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
    for known in CHANNELS:
        assert units[known.key] == known.unit.encode()
        assert units[f"predicted_{known.key}"] == known.unit.encode()
        assert (table.schema.field(known.key).metadata or {})[b"reference"] == b"trim"
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


def test_names_units_and_references_are_the_dictionary_s(samples: npt.NDArray) -> None:
    table = pd.read_csv(io.BytesIO(exported(samples, "csv", LONGITUDINAL)))
    assert list(table)[:7] == [
        "t_s", "alpha_rad", "q_from_trim_radps", "theta_rad", "Nz_g", "V_mps", "delta_e_rad",
    ]  # fmt: skip
    assert list(table).count("theta_rad") == 1
    np.testing.assert_array_equal(table["theta_rad"], samples["y"][:, 2])
    fields = pq.read_table(io.BytesIO(exported(samples, "parquet", LONGITUDINAL))).schema
    assert (fields.field("q").metadata or {})[b"reference"] == b"trim"
    assert (fields.field("V").metadata or {}) == {b"unit": b"m/s", b"reference": b""}


@pytest.mark.parametrize("form", EXPORTS)
def test_any_name_of_a_channel_can_be_written(samples: npt.NDArray, form: str) -> None:
    keys = ["α, left", "wing bending", 'the "q"', "1st", "a/b", "a_b"]
    dictionary = Dictionary("own", tuple(channel(key, key, "N*m", key) for key in keys))
    content = io.BytesIO(exported(samples, form, dictionary))
    if form == "csv":
        names = ["α  left", "wing bending", "the  q ", "1st", "a/b", "a_b"]
        assert list(pd.read_csv(content))[1:7] == [f"{name}_from_trim_Nm" for name in names]
    elif form == "parquet":
        assert pq.read_table(content).column_names[1:7] == keys
    else:
        read = loadmat(content, simplify_cells=True)
        columns = [read[name] for name, unit in read["units"].items() if unit == "N*m"]
        np.testing.assert_array_equal(np.stack(columns[:6], axis=1), samples["y"])


def test_a_hundred_columns_with_one_long_beginning_are_written_for_matlab(
    samples: npt.NDArray,
) -> None:
    keys = [f"bending_moment_of_the_wing_at_rib_{n}" for n in range(32)]
    dictionary = Dictionary("own", tuple(channel(key, key, "N*m", key) for key in keys))
    type_of = {name: samples.dtype[name] for name in samples.dtype.names or ()}
    many = np.zeros(N, [*(type_of | dict.fromkeys(("y", "y_hat"), ("f8", 32))).items()])
    content = exported(many, "mat", dictionary)
    assert len(loadmat(io.BytesIO(content), simplify_cells=True)["units"]) > 2 * 32
