"""Read HDF5, and resist hostile files."""

import h5py
import numpy as np
import pytest

from tests.support.recorded_files import read

N = 300
T = np.arange(N) / 50


@pytest.fixture
def read_back(tmp_path):
    """A function that fills a file -> columns of it."""

    def fill_and_read(fill, userblock_size=0, head=b""):
        path = tmp_path / "recording.h5"
        with h5py.File(path, "w", userblock_size=userblock_size) as file:
            fill(file)
        if head:
            with path.open("r+b") as raw:
                raw.write(head)
        return read("hdf5", path)

    return fill_and_read


def reasons(columns):
    return dict(text.split(": ", 1) for text in columns.contents.ignored)


def test_groups_follow_place_length_and_time(read_back):
    def fill(file):
        file["time"] = T
        file["air/beta"] = T + 1
        file["fast/time"] = np.arange(3 * N)
        file["fast/p"] = np.arange(3 * N)
        file["fast/odd"] = np.arange(7)

    columns = read_back(fill)
    groups = columns.contents.groups
    of = {s.name: groups[s.group] for s in columns.contents.signals}
    assert of["air/beta"] is of["time"]
    assert of["fast/p"].time == "fast/time"
    assert (of["fast/odd"].n_rows, of["fast/odd"].time) == (7, "")
    assert len({group.name for group in groups}) == len(groups) == 3


@pytest.mark.parametrize("chunks", [None, (7, 2), (300, 1), (1, 5)])
@pytest.mark.parametrize("turned", [False, True])
def test_columns_of_a_matrix_are_signals(chunks, turned, read_back, monkeypatch):
    monkeypatch.setattr("app.telemetry.readers.signal_tables.BLOCK", 64)
    matrix = np.arange(5.0 * N).reshape(N, 5)

    def fill(file):
        stored = chunks[::-1] if chunks and turned else chunks
        file.create_dataset("rates", data=matrix.T if turned else matrix, chunks=stored)

    columns = read_back(fill)
    for k in range(5):
        np.testing.assert_array_equal(columns.values(f"rates[{k}]"), matrix[:, k])


@pytest.mark.parametrize("name", ["unit", "units", "Units", "UNIT"])
@pytest.mark.parametrize("value", ["deg", b"deg", np.array([b"deg"]), np.array("deg", "O")])
def test_units_are_found_in_attributes_of_many_kinds(name, value, read_back):
    def fill(file):
        file["beta"] = T
        file["beta"].attrs[name] = value if value is not None else ""

    assert read_back(fill).signal("beta").unit == "deg"


def test_a_dimension_scale_is_the_time_of_its_datasets(read_back):
    def fill(file):
        file["clock"] = T
        file["clock"].make_scale()
        file["other"] = T + 5
        file["air/beta"] = T + 1
        file["air/beta"].dims[0].attach_scale(file["clock"])

    columns = read_back(fill)
    group = columns.contents.groups[columns.signal("air/beta").group]
    assert group.time == "clock"
    assert columns.signal("other").group != columns.signal("air/beta").group


def test_fields_of_a_table_are_signals(read_back):
    kind = [("time", "f8"), ("q", "f4", 4), ("who", "S3"), ("s", [("x", "i2"), ("y", "?")])]
    table = np.zeros(N, kind)
    table["time"], table["q"][:, 2], table["s"]["x"] = T, 7, np.arange(N)

    def fill(file):
        file["log"] = table
        file["log"].attrs["units"] = ["s", "", "", "m"]

    columns = read_back(fill)
    np.testing.assert_array_equal(columns.values("log/q[2]"), np.full(N, 7.0))
    np.testing.assert_array_equal(columns.values("log/s.x"), np.arange(N))
    assert columns.signal("log/s.x").unit == "m"
    assert columns.contents.groups[0].time == "log/time"
    assert reasons(columns) == {"log/who": "no numbers"}


def test_ignored_content_is_listed_with_reasons(read_back):
    def fill(file):
        file["beta"] = T
        file["text"] = "flight 3"
        file["z"] = T + 1j
        file["cube"] = np.ones((3, 4, 5))
        file["one"] = 2.0
        file.create_dataset("none", shape=(0,), dtype="f8")
        file.create_dataset("rows", shape=(2,), dtype=h5py.vlen_dtype(float))
        file.create_dataset("links", shape=(2,), dtype=h5py.ref_dtype)

    assert reasons(read_back(fill)) == {
        "text": "no numbers",
        "z": "no numbers",
        "cube": "3 dimensions",
        "one": "one value",
        "none": "no value",
        "rows": "no numbers",
        "links": "no numbers",
    }


def test_numbers_of_other_files_are_never_read(read_back, tmp_path):
    other = tmp_path / "other"
    other.write_bytes(bytes(80))
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = T
    layout = h5py.VirtualLayout((N,), "f8")
    layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "x", (N,))

    def fill(file):
        file["beta"] = T
        file["link"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/x")
        file["soft"] = h5py.SoftLink("/link")
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("raw", shape=(10,), dtype="f8", external=[(str(other), 0, 80)])

    columns = read_back(fill)
    assert [signal.name for signal in columns.contents.signals] == ["beta"]
    assert set(reasons(columns)) == {"link", "virtual", "raw"}


def test_groups_in_circles_are_visited_once(read_back):
    def fill(file):
        file["air/beta"] = T
        file["air/again"] = file["/"]
        file["air/loop"] = file["air"]

    assert [signal.name for signal in read_back(fill).contents.signals] == ["air/beta"]


def test_deeply_nested_groups_are_read(read_back):
    columns = read_back(lambda file: file.create_dataset("/".join("a" * 200), data=T))
    assert len(columns.contents.signals) == 1


def test_declared_but_unwritten_datasets_are_ignored(read_back):
    def fill(file):
        file["beta"] = T
        file.create_dataset("huge", shape=(10**12,), dtype="f8", chunks=(1000,))
        file.create_dataset("late", shape=(10**12,), dtype="f8")

    assert reasons(read_back(fill)) == dict.fromkeys(("huge", "late"), "nothing written")


def test_a_filter_that_is_not_installed_is_named(read_back, monkeypatch):
    monkeypatch.setattr("h5py.h5z.filter_avail", lambda code: code != h5py.h5z.FILTER_LZF)

    def fill(file):
        file["beta"] = T
        file.create_dataset("p", data=T, compression="lzf")

    assert reasons(read_back(fill)) == {"p": "compressed by lzf, which is not installed"}


MATLAB = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"


def test_matlabs_classes_are_understood(read_back):
    def write(file, name, values, kind, **attributes):
        file[name] = values
        file[name].attrs["MATLAB_class"] = np.bytes_(kind)
        for key, value in attributes.items():
            file[name].attrs[key] = value

    def text(value):
        return np.frombuffer(value.encode("utf-16-le"), "<u2")[:, None]

    def fill(file):
        write(file, "logs/time", T[None], b"double")
        write(file, "#refs#/a", np.sin(T)[None], b"double")
        write(file, "#refs#/b", np.stack([T, 2 * T]), b"double")
        write(file, "#refs#/c", text("beta"), b"char")
        write(file, "#refs#/d", text("rates"), b"char")
        for field, names in (("values", "ab"), ("label", "cd")):
            read_back = file.create_dataset(f"logs/signals/{field}", (2, 1), h5py.ref_dtype)
            for k, name in enumerate(names):
                read_back[k, 0] = file[f"#refs#/{name}"].ref
        write(file, "square", np.arange(9.0).reshape(3, 3), b"double")
        write(file, "cell", np.zeros((1, 1)), b"cell")
        write(file, "nothing", np.zeros(2, "u8"), b"double", MATLAB_empty=1)
        write(file, "thing", np.zeros((1, 6), "u4"), b"timetable", MATLAB_object_decode=3)
        for part in ("data", "ir", "jc"):
            file[f"sparse/{part}"] = np.arange(4.0)
        file["sparse"].attrs["MATLAB_sparse"] = 4

    columns = read_back(fill, 512, MATLAB)
    np.testing.assert_array_equal(columns.values("beta"), np.sin(T))
    np.testing.assert_array_equal(columns.values("rates[1]"), 2 * T)
    np.testing.assert_array_equal(columns.values("square[0]"), [0, 1, 2], "a row as stored")
    assert columns.contents.groups[columns.signal("beta").group].time == "logs.time"
    assert reasons(columns) == {
        "cell": "a cell array",
        "nothing": "no value",
        "thing": "an object; save its numbers as plain vectors",
        **dict.fromkeys((f"sparse.{part}" for part in ("data", "ir", "jc")), "a sparse matrix"),
    }
