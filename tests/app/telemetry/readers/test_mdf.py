"""Recordings in ASAM MDF, as asammdf writes them."""

import struct
import warnings
from pathlib import Path

import numpy as np
import pytest

from app.telemetry.reading import ReadLimits, read_file
from app.telemetry.recording import TelemetryError
from tests.support.recorded_files import read

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    asammdf = pytest.importorskip("asammdf")

T = np.arange(300) / 100


@pytest.fixture
def saved(tmp_path):
    """Groups of signals -> path of a file of them."""

    def _saved(*groups, version="4.10", **options):
        path = tmp_path / "recording.mf4"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with asammdf.MDF(version=version) as file:
                for number, signals in enumerate(groups):
                    file.append(signals, comment=f"rack {number}", acq_name=f"rack {number}")
                return Path(file.save(path, overwrite=True, **options))

    return _saved


def signal(name, values, t=T, **more):
    return asammdf.Signal(values, t, name=name, **more)


def reasons(columns):
    return dict(text.split(": ", 1) for text in columns.contents.ignored)


@pytest.mark.parametrize("version", ["4.10", "4.20"])
def test_conversions_give_physical_values_and_text_tables_are_skipped(version, saved):
    counts = np.arange(300, dtype="i2")
    states = {"val_0": 0, "val_1": 1, "text_0": b"off", "text_1": b"on"}
    points = {f"raw_{k}": 100.0 * k for k in range(4)} | {f"phys_{k}": k**2 for k in range(4)}
    path = saved(
        [
            signal("rudder", counts, unit="deg", conversion={"a": 0.1, "b": -15.0}),
            signal("state", (counts % 2).astype("u1"), conversion=states),
            signal("curve", counts, conversion=points | {"interpolation": True}),
        ],
        version=version,
    )
    columns = read("mdf", path)
    np.testing.assert_allclose(columns.values("rudder"), 0.1 * counts - 15, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(columns.values("state"), counts % 2)
    np.testing.assert_allclose(
        columns.values("curve"), np.interp(counts, [0, 100, 200, 300], [0, 1, 4, 9])
    )
    assert columns.signal("rudder").unit == "deg"


def test_a_file_of_version_3_is_refused_by_name(saved):
    with pytest.raises(TelemetryError, match=r"MDF version 3\.30: convert it to MDF 4"):
        read("mdf", saved([signal("p", T)], version="3.30"))


def test_a_formula_in_a_file_is_never_evaluated(saved, monkeypatch):
    evaluated = []
    monkeypatch.setattr("asammdf.blocks.v4_blocks.evaluate", evaluated.append)
    path = saved([signal("p", T), signal("evil", T, conversion={"formula": "X*2"})])
    columns = read("mdf", path)
    assert reasons(columns) == {"evil": "converted by a formula, which is not evaluated"}
    assert not evaluated


def test_invalid_samples_are_missing(saved):
    invalid = np.arange(300) % 7 == 0
    counts = np.arange(300, dtype="u2")
    path = saved([signal("p", counts, invalidation_bits=invalid), signal("r", counts)])
    columns = read("mdf", path)
    np.testing.assert_array_equal(columns.values("p"), np.where(invalid, np.nan, counts))
    np.testing.assert_array_equal(columns.values("r"), counts)


def test_channel_groups_keep_their_own_times_and_namesakes_their_group(saved):
    path = saved([signal("p", T)], [signal("p", T[::3], T[::3]), signal("r", T[::3], T[::3])])
    columns = read("mdf", path)
    times = {group.name: group.time for group in columns.contents.groups}
    assert times == {"rack 0": "rack 0/time", "rack 1": "rack 1/time"}
    np.testing.assert_array_equal(columns.values("rack 1/time"), T[::3])
    assert {s.name for s in columns.contents.signals} >= {"rack 0/p", "rack 1/p", "r"}


@pytest.mark.parametrize("compression", [0, 1, 2])
def test_records_come_in_their_order_from_many_fragments(compression, saved, monkeypatch):
    monkeypatch.setattr("app.telemetry.readers.mdf.FRAGMENT", 1000)
    t = np.arange(40_000) / 100
    path = saved([signal("p", np.sin(t), t), signal("r", t, t)], compression=compression)
    columns = read("mdf", path)
    np.testing.assert_array_equal(columns.values("p"), np.sin(t))
    np.testing.assert_array_equal(columns.values("time"), t)


def test_text_is_ignored_and_elements_of_arrays_are_signals(saved):
    rows = np.arange(900.0).reshape(300, 3)
    array = np.rec.fromarrays([rows], dtype=[("rates", "f8", (3,))])
    text = signal("mode", np.array([b"abc"] * 300), encoding="utf-8")
    columns = read("mdf", saved([signal("rates", array), text]))
    np.testing.assert_array_equal(columns.values("rates[2]"), rows[:, 2])
    assert reasons(columns)["mode"] == "text or bytes"


def test_a_file_that_its_writer_did_not_finish_is_read(saved):
    path = saved([signal("p", T), signal("r", 2 * T)])
    content = bytearray(path.read_bytes())
    content[:8] = b"UnFinMF "
    struct.pack_into("<H", content, 60, 1)  # the cycle counters are not up to date
    path.write_bytes(content)
    columns = read("mdf", path)
    np.testing.assert_array_equal(columns.values("p"), T)
    assert {p.suffix for p in columns.folder.iterdir()} == {".f8", ".json"}


@pytest.mark.usefixtures("read_apart")
def test_blocks_in_a_circle_end_at_a_limit(saved, tmp_path):
    path = saved([signal("p", T)])
    content = bytearray(path.read_bytes())
    group = struct.unpack_from("<Q", content, 64 + 24)[0]
    struct.pack_into("<Q", content, group + 24, group)
    path.write_bytes(content)
    with pytest.raises(TelemetryError, match="took more than 3 s: export"):
        read_file(path, tmp_path / "columns", limits=ReadLimits(seconds=3.0))
    assert not (tmp_path / "columns").exists()


def test_data_beyond_the_end_of_the_file_are_refused(saved):
    path = saved([signal("p", T)])
    content = path.read_bytes()
    data = content.index(b"##DT")
    path.write_bytes(content[: data + 124])
    with pytest.raises(TelemetryError, match="damaged or cut short"):
        read("mdf", path)
