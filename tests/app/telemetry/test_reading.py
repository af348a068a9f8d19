"""Files are read by their content, whatever their names; other paths are refused."""

import os
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from scipy.io import savemat

from app.telemetry.contents import open_columns
from app.telemetry.formats import FORMATS, PACKED, format_of
from app.telemetry.reading import ReadLimits, read_file
from app.telemetry.recording import TelemetryError

TABLE = "t,beta\n0,1\n1,2\n2,3\n"


def test_a_file_becomes_a_folder_of_columns(write, tmp_path):
    contents = read_file(write(TABLE), tmp_path / "columns")
    columns = open_columns(tmp_path / "columns")
    assert columns.contents == contents
    np.testing.assert_array_equal(columns.values("beta"), [1, 2, 3])


CH10 = bytes.fromhex("25eb 0000 3400 0000 1800 0000 0301 0001") + bytes(6)
CH10 += (sum(int.from_bytes(CH10[i : i + 2], "little") for i in range(0, 22, 2)) % 2**16).to_bytes(
    2, "little"
)
HEADS = {
    "parquet": b"PAR1" + bytes(99),
    "matlab5": b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\1IM" + bytes(9),
    "hdf5": b"\x89HDF\r\n\x1a\n" + bytes(99),
    "netcdf": b"CDF\x02" + bytes(99),
    "ulog": b"ULog\x01\x12\x35\x01" + bytes(99),
    "mdf4": b"MDF     4.10    forewarn" + bytes(99),
    "tdms": b"TDSm" + bytes(99),
    "mcap": b"\x89MCAP0\r\n" + bytes(99),
    "ch10": CH10 + bytes(99),
    "journal": b'{"format":1,"flight":"f","began":"2030-01-01T00:00:00+00:00","a":0.0}\n',
    "csv": TABLE.encode(),
}
MATLAB73 = b"MATLAB 7.3 MAT-file".ljust(512) + HEADS["hdf5"]


def test_the_text_table_is_listed_first_and_recognised_last(write):
    assert next(iter(FORMATS)) == "csv"
    alike = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b" " * 900
    assert FORMATS["csv"].looks_like(alike)
    assert format_of(write(alike), "flight")[0].key == "matlab5"


@pytest.mark.parametrize("key", FORMATS)
def test_a_format_is_known_by_its_content_under_any_name(key, write):
    assert key in HEADS, "add the first bytes of such a file to HEADS"
    for ending in FORMATS[key].endings:
        assert format_of(write(HEADS[key]), f"flight{ending.upper()}") == (FORMATS[key], ())
    assert format_of(write(HEADS[key]), "flight") == (FORMATS[key], ())
    other = ".csv" if key != "csv" else ".mat"
    known, (note,) = format_of(write(HEADS[key]), f"flight{other}")
    assert known.key == key
    assert f"its name ends in {other}" in note


@pytest.mark.parametrize(
    ("head", "name", "key"),
    [
        (MATLAB73, "flight.mat", "hdf5"),
        (HEADS["hdf5"], "flight.nc", "netcdf"),
        (HEADS["hdf5"], "flight.dat", "hdf5"),
        (TABLE.encode("utf-16"), "flight.txt", "csv"),
        (TABLE.encode("utf-16-be"), "flight.txt", "csv"),
        ("t;Winkel ß\n0;1\n".encode("latin-1"), "flight.txt", "csv"),
    ],
)
def test_formats_in_one_container_are_distinguished(head, name, key, write):
    assert format_of(write(head), name)[0].key == key


@pytest.mark.parametrize("magic", PACKED)
def test_an_archive_is_refused_with_advice(magic, write, tmp_path):
    with pytest.raises(TelemetryError, match="and give"):
        read_file(write(magic + bytes(99)), tmp_path / "columns")


NO_FILE = {
    "empty": (b"", "record.csv", "the file is empty"),
    "noise": (bytes(range(256)), "record", "unknown file format: export one of text table"),
    "wrong": (bytes(range(256)), "record.mf4", "content is neither ASAM MDF"),
}


@pytest.mark.parametrize(("content", "name", "message"), NO_FILE.values(), ids=NO_FILE)
def test_a_file_of_no_format_is_refused(content, name, message, write, tmp_path):
    with pytest.raises(TelemetryError, match=message):
        read_file(write(content, name), tmp_path / "columns")
    assert not (tmp_path / "columns").exists()


def test_a_path_that_is_not_a_file_is_refused_with_its_name(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, message in [
        (tmp_path, "the file: this is a directory"),
        (tmp_path / "absent.csv", "no such file"),
        (tmp_path / "absent" / "record.csv", "no such file"),
        (tmp_path / "pipe", "the file: this is not a regular file"),
        (Path("/dev/zero"), "not a regular file"),
        (Path("a\0b"), "cannot be opened"),
        (Path("x" * 1000), "cannot be opened"),
    ]:
        with pytest.raises(TelemetryError, match=message) as refusal:
            read_file(path, tmp_path / "columns", name="the file")
        assert str(refusal.value).startswith("the file: ")
    assert os.listdir(tmp_path) == ["pipe"]


def test_a_link_without_end_is_refused(tmp_path):
    (tmp_path / "link").symlink_to("link")
    with pytest.raises(TelemetryError, match="cannot be opened"):
        read_file(tmp_path / "link", tmp_path / "columns")


def test_columns_do_not_overwrite_others(write, tmp_path):
    read_file(write(TABLE), tmp_path / "columns")
    with pytest.raises(FileExistsError):
        read_file(write(TABLE), tmp_path / "columns")
    assert open_columns(tmp_path / "columns").contents.groups[0].n_rows == 3


@pytest.mark.parametrize("kind", ["mat", "h5", "parquet"])
def test_a_small_file_does_not_become_a_large_folder(kind, tmp_path):
    """Ten million zeros are under half a megabyte as a file and 80 MB of columns."""
    path, zeros = tmp_path / f"zeros.{kind}", np.zeros(10_000_000)
    if kind == "mat":
        savemat(path, {"t": zeros}, do_compression=True)
    elif kind == "h5":
        with h5py.File(path, "w") as file:
            file.create_dataset("t", data=zeros, chunks=(2**17,), compression="gzip")
    else:
        parquet.write_table(pa.table({"t": zeros}), path)
    assert path.stat().st_size < 500_000
    with pytest.raises(TelemetryError, match="more than the limit of 64 MiB") as refused:
        read_file(path, tmp_path / "columns")
    assert str(refused.value).endswith("export only the time range and signals of this test")
    assert not (tmp_path / "columns").exists()


def test_the_size_limit_of_a_file_grows_with_the_file(write, tmp_path):
    table = write(TABLE)
    for unfolds_by in (2, 4):
        limits = ReadLimits(unfolds_by=unfolds_by, unfolds_to=0)
        if unfolds_by == 2:
            with pytest.raises(TelemetryError, match="expands to more"):
                read_file(table, tmp_path / "columns", limits=limits)
        else:
            assert read_file(table, tmp_path / "columns", limits=limits).groups[0].n_rows == 3
