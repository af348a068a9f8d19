"""Read MATLAB files, including files by MATLAB that scipy ships."""

import struct
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from scipy.io import savemat

from app.telemetry.reading import read_file
from app.telemetry.recording import TelemetryError
from tests.support.recorded_files import read

MATLABS_OWN = Path(scipy.io.__file__).parent / "matlab" / "tests" / "data"
T = np.arange(50.0) / 25


@pytest.fixture
def saved(tmp_path):
    """Variables -> columns of a file of them."""

    def _saved(**variables):
        path = tmp_path / "recording.mat"
        savemat(path, variables)
        return read("matlab", path)

    return _saved


def matlabs_own(name, tmp_path, reader="matlab"):
    if not (MATLABS_OWN / name).exists():
        pytest.skip("scipy is installed without its MATLAB files")
    path = tmp_path / name
    path.write_bytes((MATLABS_OWN / name).read_bytes())
    return read(reader, path)


@pytest.mark.parametrize(
    "version",
    ["4.2c_SOL2", "6.1_SOL2", "6.5.1_GLNX86", "7.1_GLNX86", "7.4_GLNX86"],
)
def test_a_vector_of_every_version_of_matlab_is_read(version, tmp_path):
    columns = matlabs_own(f"testdouble_{version}.mat", tmp_path)
    np.testing.assert_array_equal(columns.values("testdouble"), np.pi / 4 * np.arange(9))


def test_a_vector_of_matlab_7_3_is_read(tmp_path):
    columns = matlabs_own("testhdf5_7.4_GLNX86.mat", tmp_path, "hdf5")
    np.testing.assert_array_equal(columns.values("testdouble"), np.pi / 4 * np.arange(9))
    assert columns.contents.format == "hdf5"


@pytest.mark.parametrize("name", ["big_endian", "little_endian"])
def test_either_byte_order_is_read(name, tmp_path):
    columns = matlabs_own(f"{name}.mat", tmp_path)
    np.testing.assert_array_equal(columns.values("floats[0]"), [2, 3])
    assert columns.contents.ignored == ("strings: a cell array",)


def test_a_structure_of_matlab_gives_fields_and_units(tmp_path):
    columns = matlabs_own("nasty_duplicate_fieldnames.mat", tmp_path)
    assert columns.signal("Summary.Total_Q").unit == "m3/s"
    assert {group.name for group in columns.contents.groups} == {"Summary"}


@pytest.mark.parametrize("shape", [(50,), (50, 1), (1, 50), (1, 1, 50)])
def test_a_vector_is_a_signal_whichever_way_it_lies(shape, saved):
    columns = saved(time=T, beta=np.sin(T).reshape(shape))
    np.testing.assert_array_equal(columns.values("beta"), np.sin(T))


@pytest.mark.parametrize("turned", [False, True])
def test_the_time_decides_which_axis_of_a_matrix_is_time(turned, saved):
    matrix = np.arange(50.0 * 80).reshape(50, 80)
    columns = saved(time=T, rates=matrix.T if turned else matrix)
    np.testing.assert_array_equal(columns.values("rates[79]"), matrix[:, 79])
    assert len(columns.contents.groups) == 1


def test_integers_and_logicals_become_numbers(saved):
    columns = saved(t=T, on=T > 1, mode=np.arange(50, dtype=np.int8))
    np.testing.assert_array_equal(columns.values("on"), T > 1)
    np.testing.assert_array_equal(columns.values("mode"), np.arange(50))
    assert columns.contents.groups[0].time == "t"


def test_a_structure_without_a_time_uses_the_one_outside_it(saved):
    columns = saved(t=T, air={"beta": T + 1, "inner": {"Ny": T + 2}}, other={"x": np.arange(9.0)})
    groups = [group.name for group in columns.contents.groups]
    assert [groups[columns.signal(n).group] for n in ("air.beta", "air.inner.Ny", "other.x")] == [
        "", "", "other",
    ]  # fmt: skip


def test_a_signal_has_the_description_within_or_beside_it(saved):
    columns = saved(
        ch1={"time": T, "data": np.sin(T), "comment": "Sideslip angle"},
        air={"t": T, "ch2": np.cos(T), "ch2_description": "Roll rate", "ch3": np.sin(T),
             "long_name": {"ch3": "Yaw rate"}},
    )  # fmt: skip
    descriptions = {
        name: columns.signal(name).description for name in ("ch1", "air.ch2", "air.ch3")
    }
    assert descriptions == {"ch1": "Sideslip angle", "air.ch2": "Roll rate", "air.ch3": "Yaw rate"}
    assert columns.signal("air.t").description == ""


def test_a_structure_of_time_and_data_is_a_signal_of_its_name(saved):
    info = {"Units": "deg"}
    columns = saved(
        beta={"Time": T, "Data": np.sin(T), "DataInfo": info},
        p={"time": T[:20], "data": T[:20], "unit": "deg/s"},
    )
    assert columns.signal("beta").unit == "deg"
    assert columns.signal("p").unit == "deg/s"
    times = {group.name: group.time for group in columns.contents.groups}
    assert times == {"beta": "beta.Time", "p": "p.time"}


@pytest.mark.parametrize("shape", [(-1, 1), (1, -1)])
def test_structures_of_data_and_unit_share_the_time_that_is_one_of_them(shape, saved):
    signals = {"time": ("sec", T), "vane_SS": ("deg", np.sin(T))}
    columns = saved(
        flightdata={
            name: {"data": values.reshape(shape if name == "time" else (-1, 1)), "units": unit}
            for name, (unit, values) in signals.items()
        }
    )
    (group,) = columns.contents.groups
    assert (group.name, group.time) == ("flightdata", "flightdata.time")
    signal = columns.signal("flightdata.vane_SS")
    assert (signal.unit, signal.group) == ("deg", 0)


@pytest.mark.parametrize("n_signals", [1, 2])
def test_a_structure_with_time_of_simulink_gives_labelled_signals(n_signals, saved):
    signals = np.zeros((1, n_signals), dtype=[("values", "O"), ("label", "O"), ("dimensions", "O")])
    signals[0, 0] = (np.sin(T)[:, None], "beta", 1.0)
    if n_signals == 2:
        signals[0, 1] = (np.column_stack([T, 2 * T]), "rates", 2.0)
    columns = saved(logsout={"time": T, "signals": signals})
    np.testing.assert_array_equal(columns.values("beta"), np.sin(T))
    if n_signals == 2:
        np.testing.assert_array_equal(columns.values("rates[1]"), 2 * T)
    assert [group.time for group in columns.contents.groups] == ["logsout.time"]


def test_ignored_content_is_listed_with_reasons(saved):
    cell = np.empty(2, object)
    cell[:] = [T, "text"]
    columns = saved(
        t=T, cell=cell, cube=np.ones((3, 4, 5)), gain=2.0, z=T + 1j, name="flight 3",
        map=np.ones((300, 300)), sparse=scipy.sparse.eye_array(3).tocsc(),
    )  # fmt: skip
    assert set(columns.contents.ignored) == {
        "cell: a cell array", "cube: 3 dimensions", "gain: one value", "z: complex",
        "map: 300 by 300 numbers, too wide for a set of signals", "sparse: a sparse matrix",
    }  # fmt: skip


def element(kind, content):
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def matrix(flags, shape, *parts, name=b""):
    """A MATLAB 5 matrix; its parts follow flags, dimensions and name."""
    head = [
        element(6, struct.pack("<II", flags, 0)),
        element(5, struct.pack(f"<{len(shape)}i", *shape)),
        element(1, name),
    ]
    return element(14, b"".join((*head, *parts)))


HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"


def test_a_value_deep_in_structures_is_named(tmp_path):
    inner = matrix(6, (1, 1), element(9, struct.pack("<d", 1.0)))
    fields = (element(5, struct.pack("<i", 8)), element(1, b"s".ljust(8, b"\0")))
    for _ in range(300):
        inner = matrix(2, (1, 1), *fields, inner)
    path = tmp_path / "deep.mat"
    path.write_bytes(HEADER + matrix(2, (1, 1), *fields, inner, name=b"deep"))
    with pytest.raises(TelemetryError, match="no numeric signals"):
        read("matlab", path)


@pytest.mark.usefixtures("read_apart")
def test_cells_that_are_declared_but_not_there_are_refused(tmp_path):
    path = tmp_path / "cells.mat"
    path.write_bytes(HEADER + matrix(2, (1, 1), matrix(1, (30000, 30000)), name=b"s"))
    with pytest.raises(TelemetryError, match="damaged or cut short"):
        read_file(path, tmp_path / "columns")
    assert not (tmp_path / "columns").exists()


def test_compressed_variables_are_measured_before_writing(tmp_path):
    path = tmp_path / "bomb.mat"
    savemat(path, {"t": np.zeros(2_000_000)}, do_compression=True)
    assert path.stat().st_size < 20_000
    with pytest.raises(TelemetryError, match="more than the limit of 10 MiB"):
        read("matlab", path, most_bytes=10 << 20)
