"""Read NetCDF; results equal those of the netCDF library."""

from datetime import UTC, datetime
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import scipy.io

from app.telemetry.readers.netcdf import Since, since
from tests.support.recorded_files import read

SCIPYS = Path(scipy.io.__file__).parent / "tests" / "data"
KINDS = ("NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF4_CLASSIC", "NETCDF4")
T = np.arange(40) / 20


@pytest.fixture(params=KINDS)
def read_back(request, tmp_path):
    """A function that fills a dataset -> columns of it."""

    def _made(fill):
        path = tmp_path / "recording.nc"
        with netCDF4.Dataset(path, "w", format=request.param) as file:
            fill(file)
        return read("netcdf", path)

    return _made


def variable(file, name, kind, dimensions, values, fill_value=None, **attributes):
    read_back = file.createVariable(name, kind, dimensions, fill_value=fill_value)
    read_back.set_auto_maskandscale(False)
    read_back.setncatts(attributes)
    read_back[:] = values


def test_packed_and_missing_values_are_what_the_netcdf_library_reads(read_back, tmp_path):
    stored = np.arange(40) - 5

    def fill(file):
        file.createDimension("time", None)
        variable(file, "packed", "i2", "time", stored, -3, scale_factor=0.5, add_offset=10.0)
        variable(file, "missing", "f4", "time", stored, missing_value=np.float32(4))
        variable(file, "ranged", "i4", "time", stored, valid_range=np.array([0, 20], "i4"))
        variable(file, "lowest", "f8", "time", stored, valid_min=0.0)
        variable(file, "default", "i2", "time", np.where(stored == 3, -32767, stored))

    columns = read_back(fill)
    with netCDF4.Dataset(tmp_path / "recording.nc") as file:
        for name, theirs in file.variables.items():
            expected = np.ma.filled(theirs[:].astype(float), np.nan)
            np.testing.assert_array_equal(columns.values(name), expected, name)
            assert np.isnan(expected).any()


def test_a_group_is_a_dimension_with_its_coordinate(read_back):
    def fill(file):
        file.createDimension("time", 40)
        file.createDimension("slow", 40)
        file.createDimension("axis", 3)
        variable(
            file, "rates", "f8", ("time", "axis"), np.arange(120.0).reshape(40, 3), units="deg"
        )
        variable(file, "wide", "f8", ("axis", "time"), np.arange(120.0).reshape(3, 40))
        variable(file, "time", "f8", "time", T, units="s")
        variable(file, "clock", "f8", "slow", 2 * T, standard_name="time")
        variable(file, "V", "f8", "slow", T, long_name="airspeed")
        variable(file, "axis", "f8", "axis", np.arange(3))

    columns = read_back(fill)
    groups = {group.name: group.time for group in columns.contents.groups}
    assert groups == {"time": "time", "slow": "clock", "axis": ""}
    np.testing.assert_array_equal(columns.values("rates[1]"), np.arange(1.0, 120, 3))
    np.testing.assert_array_equal(columns.values("wide[1]"), np.arange(40.0, 80))
    assert columns.signal("rates[1]").unit == "deg"
    assert columns.signal("V").description == "airspeed"


def test_times_with_different_origins_get_one_origin(read_back):
    def fill(file):
        file.createDimension("time", 40)
        file.createDimension("slow", 40)
        variable(file, "time", "f8", "time", T, units="seconds since 2024-05-01 09:30:00")
        variable(file, "slow", "f8", "slow", T, units="minutes since 2024-05-01 09:31:00")

    columns = read_back(fill)
    assert columns.contents.start == "2024-05-01T09:30:00Z"
    np.testing.assert_allclose(columns.values("slow"), T + 1)
    assert columns.signal("slow").unit == "min"


def test_groups_of_netcdf_4_are_read(tmp_path):
    path = tmp_path / "groups.nc"
    with netCDF4.Dataset(path, "w") as file:
        air = file.createGroup("air")
        air.createDimension("time", 40)
        variable(air, "time", "f8", "time", T, units="days since 2024-05-01")
        variable(air, "beta", "f8", "time", T)
    columns = read("netcdf", path)
    assert columns.contents.groups[0].time == "air/time"
    assert columns.signal("air/time").unit == "day"


@pytest.mark.parametrize(
    ("name", "signal"),
    [("example_2.nc", "Temperature"), ("example_3_maskedvals.nc", "var4_missingValue")],
)
def test_files_of_other_programs_are_what_the_netcdf_library_reads(name, signal, tmp_path):
    if not (SCIPYS / name).exists():
        pytest.skip("scipy is installed without its NetCDF files")
    (tmp_path / name).write_bytes((SCIPYS / name).read_bytes())
    columns = read("netcdf", tmp_path / name)
    with netCDF4.Dataset(tmp_path / name) as file:
        expected = np.ma.filled(file[signal][:].astype(float), np.nan)
    np.testing.assert_allclose(columns.values(signal), expected, rtol=1e-7)


@pytest.mark.parametrize(
    ("unit", "key", "moment"),
    [
        ("seconds since 2024-05-01 09:30:00", "s", (2024, 5, 1, 9, 30)),
        ("Seconds since 2024-5-1T9:30:00.25Z", "s", (2024, 5, 1, 9, 30, 0, 250000)),
        ("ms since 2024-05-01 09:30 UTC", "ms", (2024, 5, 1, 9, 30)),
        ("hours since 2024-05-01 09:30:00 +02:00", "h", (2024, 5, 1, 7, 30)),
        ("days since 1970-01-01", "day", (1970, 1, 1)),
    ],
)
def test_a_unit_of_time_names_its_moment(unit, key, moment):
    assert since(unit) == Since(key, datetime(*moment, tzinfo=UTC))


@pytest.mark.parametrize("unit", ["s", "", "deg since 2024-05-01", "s since", "s since 2024-13-01"])
def test_other_units_have_no_time_origin(unit):
    assert since(unit) is None
