"""Recordings without times, with a rate from the file or a person."""

import h5py
import netCDF4
import numpy as np
import pytest

from app.telemetry.mapping.applying import apply_mapping
from app.telemetry.mapping.mapping import (
    Mapping,
    TimeSource,
    counts_the_day,
    rate_words,
    read_rate,
    time_of_day,
)
from app.telemetry.mapping.proposal import propose
from app.telemetry.recording import TelemetryError
from tests.support.clocks import EVEN, N
from tests.support.recorded_files import read
from tests.support.tables import columns_of

SWING = 0.1 * np.sin(EVEN)


@pytest.mark.parametrize(
    ("text", "rate", "start", "words"),
    [
        ("50 Hz from 12:31:05", 50.0, 45_065.0, "50 Hz from 12:31:05"),
        (" 62,5hz FROM 0:01:05.25 UTC", 62.5, 65.25, "62.5 Hz from 00:01:05.25"),
        ("50", 50.0, 0.0, "50 Hz"),
        ("8 samples/s from 0.25 s", 8.0, 0.25, "8 Hz from 0.25 s"),
        ("20 Hz from 100000 s", 20.0, 1e5, "20 Hz from 100000 s"),
    ],
)
def test_a_rate_is_read_as_it_is_written(text, rate, start, words):
    source = read_rate(text)
    assert source == TimeSource(rate=rate, start=start)
    assert rate_words(source) == words
    assert read_rate(words) == source


@pytest.mark.parametrize(
    "text",
    ["", "fast", "50 Hz at noon", "-50 Hz", "0 Hz", "1e9", "999999 Hz", "5 Hz from 25:00:00"],
)
def test_a_text_that_is_not_a_rate_is_refused_with_an_example(text):
    with pytest.raises(TelemetryError, match=r"12:31:05|give one"):
        read_rate(text)


@pytest.mark.parametrize(
    "time",
    [{}, {"signal": "t", "rate": 50}, {"rate": -1.0}, {"rate": 1e9}, {"rate": 5, "start": "noon"},
     {"rate": 5, "start": float("inf")}],
)  # fmt: skip
def test_a_time_is_a_signal_or_a_plausible_rate(time):
    with pytest.raises(TelemetryError, match="''"):
        Mapping.from_plain({"times": {"": time}})


def test_a_given_rate_gives_times_to_a_table_without_times(tmp_path):
    columns = columns_of(tmp_path, {"beta_deg": SWING})
    proposal = propose(columns)
    assert proposal.mapping.channels["beta"].signal == "beta_deg"
    with pytest.raises(TelemetryError, match="or give the sample rate, such as 50 Hz"):
        apply_mapping(columns, proposal.mapping)
    given = propose(columns, rate=read_rate("50 Hz from 12:31:05")).mapping
    trace = apply_mapping(columns, Mapping.from_plain(given.to_plain()))
    np.testing.assert_allclose(trace.channels["beta"].t, 45_065.0 + EVEN, rtol=1e-15)
    assert trace.notes[-1] == (
        "Times computed from the sample rate, not recorded: 50 Hz from 12:31:05."
    )


def test_a_given_rate_does_not_replace_recorded_times(tmp_path):
    table = {"a//t_s": EVEN, "a//p_dps": SWING, "b//beta_deg": SWING}
    times = propose(columns_of(tmp_path, table), rate=TimeSource(rate=10.0)).mapping.times
    assert times == {"a": TimeSource("t_s", "s"), "b": TimeSource(rate=10.0)}


def test_a_rate_is_remembered_for_the_next_file_but_not_its_start(tmp_path):
    columns = columns_of(tmp_path, {"beta_deg": SWING})
    before = propose(columns, rate=TimeSource(rate=50.0, start=45_065.0)).mapping
    assert propose(columns, before).mapping.times == {"": TimeSource(rate=50.0)}


def test_a_declared_time_with_conflicting_values_is_replaced_by_a_better_one(tmp_path):
    backward = np.where(np.arange(N) % 2, EVEN, EVEN[::-1])
    for name, declared, unit in (("backward", backward, "s"), ("unit", EVEN, "h")):
        proposal = propose(
            columns_of(
                tmp_path / name,
                {"time": declared, "timestamp": 1e6 * EVEN, "beta": SWING},
                times={"": "time"},
                units={"time": unit},
            )
        )
        assert proposal.mapping.times == {"": TimeSource("timestamp", "us")}, name


def recorder(path):
    """Parameters of a flight data recorder, each with its own rate and start."""
    with h5py.File(path, "w") as file:
        for name, unit, rate, start, values in (
            ("Sideslip", "deg", 8.0, 0.25, np.degrees(SWING)),
            ("Roll Rate", "deg/s", 8.0, 0.25, SWING),
            ("Airspeed", "kt", 1.0, 0.5, np.full(N // 8, 250.0)),
        ):
            group = file.create_group(f"series/{name}")
            group.attrs.update({"frequency": rate, "supf_offset": start, "units": unit})
            group["data"] = values
            group["mask"] = np.arange(len(values)) == 3


def test_a_flight_data_recorders_parameters_have_the_times_of_their_rates(tmp_path):
    recorder(tmp_path / "fdr.h5")
    columns = read("hdf5", tmp_path / "fdr.h5")
    assert [group.name for group in columns.contents.groups] == [
        "1 Hz from 0.5 s",
        "8 Hz from 0.25 s",
    ]
    mapping = propose(columns).mapping
    assert mapping.times["8 Hz from 0.25 s"] == TimeSource(rate=8.0, start=0.25)
    beta = apply_mapping(columns, mapping).channels["beta"]
    np.testing.assert_array_equal(beta.t, 0.25 + np.arange(N) / 8)
    np.testing.assert_array_equal(np.isnan(beta.values), np.arange(N) == 3)
    assert beta.values[50] == pytest.approx(SWING[50])
    assert mapping.channels["V"].unit == "kt"
    assert mapping.channels["p"].signal == "series/Roll Rate"


@pytest.mark.parametrize("kind", ["NETCDF3_CLASSIC", "NETCDF4"])
@pytest.mark.parametrize("timed", [False, True])
def test_a_netcdf_variable_without_a_time_uses_its_frequency(tmp_path, kind, timed):
    with netCDF4.Dataset(tmp_path / "flight.nc", "w", format=kind) as file:
        file.createDimension("record", N)
        for name in ("SSLIP_deg", "roll_rate", *(["time"] if timed else [])):
            variable = file.createVariable(name, "f8", ("record",))
            variable.frequency = np.int32(32)
            variable[:] = EVEN if name == "time" else SWING
        variable = file.createVariable("radar", "f8", ("record",))
        variable.frequency = 9.4e9
        variable[:] = SWING
    columns = read("netcdf", tmp_path / "flight.nc")
    mapping = propose(columns).mapping
    if timed:
        assert {source.signal for source in mapping.times.values()} == {"time"}
    else:
        (t,) = set(mapping.times.values())
        assert t == TimeSource(rate=32.0)
        assert columns.contents.groups[columns.signal("radar").group].rate == 0.0


def test_only_a_rate_with_a_time_of_day_counts_the_day() -> None:
    day, number = read_rate("25 Hz from 12:31:05"), read_rate("25 Hz from 5 s")
    assert counts_the_day([day, day])
    assert not any(map(counts_the_day, ([], [number], [day, number], [TimeSource("t")])))
    assert time_of_day(45073.757) == "12:31:13.76"
    assert time_of_day(86_399.999) == "00:00:00.00"
