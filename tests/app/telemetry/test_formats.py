"""Every binary format gives the same telemetry back; damage gives one error."""

import contextlib
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from app.telemetry.formats import FORMATS, format_of
from app.telemetry.recording import TelemetryError
from tests.support.recorded_files import BETA, FILES, P, T, read

pytestmark = pytest.mark.xdist_group("formats")
NAMED = [kind for kind in FILES if kind != "ch10"]
"""Those whose files name their channels."""
WITH_UNITS = [kind for kind in NAMED if kind not in ("ulog", "mcap")]


@pytest.fixture(scope="session")
def files(tmp_path_factory):
    """Kind of file -> path of one."""
    folder = tmp_path_factory.mktemp("files")
    paths = {}
    for number, (kind, (_, ending, write)) in enumerate(FILES.items()):
        paths[kind] = folder / f"{number}{ending}"
        write(paths[kind])
    return paths


@pytest.fixture(scope="session")
def recorded(files):
    """Kind of file -> its columns."""
    return {kind: read(FILES[kind][0], path) for kind, path in files.items()}


def named(columns, name):
    """The one signal whose name is this, but for where it lies and its unit."""
    matches = [
        signal
        for signal in columns.contents.signals
        if signal.name.partition(" [")[0].rpartition("/")[2] == name
    ]
    assert len(matches) == 1, [signal.name for signal in columns.contents.signals]
    return matches[0]


@pytest.mark.parametrize("kind", NAMED)
def test_values_and_missing_values_come_back(kind, recorded):
    tolerance = 1e-6 if kind == "ulog" else 0.0
    for name, values in (("beta", BETA), ("p", P)):
        back = recorded[kind].values(named(recorded[kind], name).name)
        np.testing.assert_allclose(back, values, rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("kind", FILES)
def test_the_format_declares_the_time_of_the_group(kind, recorded):
    columns = recorded[kind]
    assert len(columns.contents.groups) == 1
    time = columns.contents.groups[0].time
    assert columns.signal(time).unit == "s"
    np.testing.assert_allclose(columns.values(time), T, atol=1e-12)


@pytest.mark.parametrize("kind", WITH_UNITS)
def test_units_come_back(kind, recorded):
    assert named(recorded[kind], "beta").unit == "deg"
    assert named(recorded[kind], "p").unit == "deg/s"


@pytest.mark.parametrize(
    ("kind", "start"),
    [
        ("netcdf 3", "2024-05-01T09:30:00Z"),
        ("netcdf 4", "2024-05-01T09:30:00Z"),
        ("mdf 4", "2024-05-01T09:30:00+00:00"),
        ("hdf5", ""),
    ],
)
def test_the_time_origin_comes_back(kind, start, recorded):
    assert recorded[kind].contents.start == start


@pytest.mark.parametrize("kind", FILES)
def test_nothing_but_columns_is_left_behind(kind, recorded):
    columns = recorded[kind]
    signals = {f"{number}.f8" for number in range(len(columns.contents.signals))}
    assert {path.name for path in columns.folder.iterdir()} == signals | {"contents.json"}


@pytest.mark.parametrize("kind", FILES)
def test_a_file_is_recognised_and_its_reader_names_the_format(kind, files, recorded):
    known, notes = format_of(files[kind], files[kind].name)
    assert known.reader == f".{FILES[kind][0]}"
    assert notes == ()
    assert recorded[kind].contents.format == known.key
    assert known in FORMATS.values()


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("share", [0.0, 0.02, 0.1, 0.35, 0.6, 0.9, 0.999])
def test_a_file_cut_short_is_refused_or_read_up_to_there(kind, share, files, tmp_path):
    whole = files[kind].read_bytes()
    path = tmp_path / "cut"
    path.write_bytes(whole[: int(share * len(whole))])
    try:
        columns = read(FILES[kind][0], path)
    except TelemetryError:
        return
    assert kind in ("ulog", "mcap", "ch10"), "formats whose every message stands for itself"
    n_rows = columns.contents.groups[0].n_rows
    np.testing.assert_allclose(columns.values(columns.contents.groups[0].time), T[:n_rows])


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("content", [b"", b"\0" * 4096, bytes(range(256)) * 40])
def test_a_file_of_another_format_is_refused(kind, content, tmp_path):
    path = tmp_path / "noise"
    path.write_bytes(content)
    with pytest.raises(TelemetryError) as refused:
        read(FILES[kind][0], path)
    assert len(str(refused.value).splitlines()) == 1


@pytest.mark.parametrize("kind", FILES)
def test_a_file_that_expands_too_much_is_refused_before_reading(kind, files, tmp_path):
    path = tmp_path / "large"
    path.write_bytes(files[kind].read_bytes())
    with pytest.raises(TelemetryError, match="MiB"):
        read(FILES[kind][0], path, most_bytes=5000)
    assert not list(tmp_path.glob("large.columns/*.f8"))


@pytest.mark.parametrize(
    ("kind", "library"), [("ulog", "pyulog"), ("mdf 4", "asammdf"), ("ch10", "chapter10")]
)
def test_a_library_that_is_not_installed_is_no_fault_of_the_file(
    kind, library, files, monkeypatch, tmp_path
):
    monkeypatch.setitem(sys.modules, library, None)
    path = tmp_path / "file"
    path.write_bytes(files[kind].read_bytes())
    with pytest.raises(ModuleNotFoundError, match=library):
        read(FILES[kind][0], path)


@pytest.mark.parametrize(
    ("reader", "package", "pattern"),
    [
        ("parquet", "pyarrow", "*.parquet"),
        ("matlab", "scipy", "*.mat"),
        ("hdf5", "h5py", "*.h5"),
        ("netcdf", "scipy", "*.nc"),
        ("ulog", "pyulog", "*.ulg"),
        ("mdf", "asammdf", "*.mf4"),
        ("ch10", "chapter10", "*.c*10"),
    ],
)
def test_sample_files_of_the_libraries_are_read_or_refused(reader, package, pattern, tmp_path):
    module_file = import_module(package).__file__
    assert module_file is not None
    files = sorted(Path(module_file).parent.rglob(pattern))
    if not files:
        pytest.skip(f"{package} is installed without {pattern} files")
    n_read = 0
    for number, file in enumerate(files):
        path = tmp_path / f"{number}{file.suffix}"
        path.write_bytes(file.read_bytes())
        with contextlib.suppress(TelemetryError):
            read(reader, path)
            n_read += 1
    assert n_read
