"""Files are read by their content, elsewhere, and whatever happens there is one sentence here."""

import os
import select
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from scipy.io import savemat

from app.telemetry.contents import open_columns
from app.telemetry.formats import FORMATS, PACKED, Format, format_of
from app.telemetry.readers import isolation
from app.telemetry.reading import ReadLimits, read_file
from app.telemetry.recording import TelemetryError
from tests.support.wicked_reader import MAGIC

pytestmark = pytest.mark.usefixtures("read_apart")

TABLE = "t,beta\n0,1\n1,2\n2,3\n"
MEMORY = 200 * 2**20
ENDLESS = ("loop", "burn", "hold")


@pytest.fixture
def write(tmp_path):
    """Content -> path of a file that holds it."""

    def _write(content, name="record.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return _write


@pytest.fixture
def wicked(write, tmp_path, monkeypatch):
    """What a reader does -> the error that comes of it."""
    monkeypatch.setitem(
        FORMATS,
        "wicked",
        Format(
            "wicked",
            "Wicked file",
            (".wicked",),
            lambda head: head.startswith(MAGIC),
            "tests.support.wicked_reader",
            extra="wicked",
        ),
    )

    def _wicked(deed, argument=""):
        # a process that waits is ended from outside, one that works by its limit of CPU time
        monkeypatch.setattr(isolation, "GRACE_SECONDS", 1.0 if deed == "hold" else 60.0)
        path = write(MAGIC + f"{deed} {argument}".strip().encode(), "flight.wicked")
        limits = ReadLimits(seconds=0.5 if deed in ENDLESS else 60.0, memory=MEMORY)
        return read_file(path, tmp_path / "columns", name="my.wicked", limits=limits)

    return _wicked


def test_a_file_becomes_a_folder_of_columns(write, tmp_path):
    contents = read_file(write(TABLE), tmp_path / "columns")
    columns = open_columns(tmp_path / "columns")
    assert columns.contents == contents
    np.testing.assert_array_equal(columns.values("beta"), [1, 2, 3])


OUTCOMES = {
    "crash": "the reader failed on it.*: it is damaged or no complete Wicked file, export it again",
    "abort": "the reader failed on it",
    "exit": "the reader failed on it",
    "leave": r"the reader failed on it \(SystemExit: bye\)",
    "fall": r"the reader failed on it \(RecursionError: ",
    "stumble": r"the reader failed on it \(KeyError: ",
    "loop": "took more than 0.5 s to read: export the time range and the signals of this test",
    "burn": "took more than 0.5 s to read: export the time range",
    "hold": "took more than 0.5 s to read: export the time range",
    "die": "took more than 200 MiB of memory to read",
    "eat": "took more than 200 MiB of memory to read: export the time range",
    "eat_at_once": "took more than 200 MiB of memory to read",
    "lack": r"No module named 'no_such_library', which reading Wicked file needs: "
    r"pip install 'forewarn\[wicked\]'",
    "refuse": "this is wicked: be good",
}


@pytest.mark.parametrize("deed", OUTCOMES)
def test_whatever_a_reader_does_is_one_sentence_and_leaves_nothing(deed, wicked, tmp_path, capfd):
    with pytest.raises(TelemetryError, match=OUTCOMES[deed]) as refusal:
        wicked(deed)
    assert str(refusal.value).startswith("my.wicked: ")
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 1000
    assert os.listdir(tmp_path) == ["flight.wicked"]
    assert capfd.readouterr() == ("", "")


def test_a_full_disk_is_not_the_files_fault(wicked, tmp_path):
    with pytest.raises(OSError, match="no room to store"):
        wicked("fill")
    assert os.listdir(tmp_path) == ["flight.wicked"]


def test_an_interruption_ends_the_reader_and_removes_its_columns(wicked, tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "begun")
    communicate, pids = subprocess.Popen.communicate, []

    def interrupted(process, **options):
        if not pids:
            pids.append(int((tmp_path / "begun").read_text()))
            raise KeyboardInterrupt
        return communicate(process, **options)

    monkeypatch.setattr(subprocess.Popen, "communicate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        wicked("loop", str(tmp_path / "begun"))
    with pytest.raises(ProcessLookupError):
        os.kill(pids[0], 0)
    assert not (tmp_path / "columns").exists()


def test_a_spare_that_was_ended_is_replaced(write, tmp_path):
    isolation.warm_up()
    spare = isolation._spares.get_nowait()
    isolation._spares.put(spare)
    spare.kill()
    spare.wait()
    assert read_file(write(TABLE), tmp_path / "columns").groups[0].n_rows == 3


def test_the_spare_is_what_reads_the_next_file_and_is_used_once(write, tmp_path):
    isolation.warm_up()
    spare = isolation._spares.get_nowait()
    isolation._spares.put(spare)
    read_file(write(TABLE), tmp_path / "columns")
    assert spare.returncode == 0
    assert isolation._spares.qsize() == 1


def test_a_spare_that_cannot_start_does_not_cost_the_file(write, tmp_path, monkeypatch):
    isolation.warm_up()
    monkeypatch.setattr(sys, "executable", str(tmp_path / "absent"))
    assert read_file(write(TABLE), tmp_path / "columns").groups[0].n_rows == 3
    assert isolation._spares.empty()


def test_many_threads_read_at_once(write, tmp_path):
    paths = [write(f"t,x\n0,{k}\n1,{k}\n", f"{k}.csv") for k in range(12)]
    with ThreadPoolExecutor(6) as pool:
        list(pool.map(lambda path: read_file(path, path.with_suffix("")), paths))
    for k in range(12):
        np.testing.assert_array_equal(open_columns(tmp_path / str(k)).values("x"), [k, k])


def run_script(lines, tmp_path, **options):
    """Start a program that can import what this one can."""
    script = tmp_path / "script.py"
    script.write_text("\n".join(lines))
    return subprocess.Popen(
        [sys.executable, "-W", "error", script],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def has_ended(pid):
    """Whether a process of no matter whose ends by itself."""
    try:
        handle = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([handle], [], [], 30)[0])
    finally:
        os.close(handle)


READS = (
    "from pathlib import Path",
    "from app.telemetry.readers import isolation",
    "from app.telemetry.reading import read_file",
)


def test_a_script_without_a_main_guard_reads_once_and_leaves_no_process(write, tmp_path):
    path = str(write(TABLE))
    lines = (
        *READS,
        f'print(read_file(Path({path!r}), Path("columns")).groups[0].n_rows)',
        "spare = isolation._spares.get_nowait()",
        "isolation._spares.put(spare)",
        "print(spare.pid)",
    )
    with run_script(lines, tmp_path) as program:
        output, errors = program.communicate()
    n_rows, pid = output.split()
    assert (n_rows, errors, program.returncode) == ("3", "", 0)
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid), 0)


@pytest.mark.skipif(
    not hasattr(os, "pidfd_open"), reason="the system does not tell of others' processes"
)
@pytest.mark.parametrize("task", ["wait", "loop"])
def test_no_process_outlives_a_program_that_is_killed(task, tmp_path):
    """Neither a spare nor one that is reading."""
    os.mkfifo(tmp_path / "begun")
    (tmp_path / "columns").mkdir()
    (tmp_path / "file").write_bytes(MAGIC + f"loop {tmp_path / 'begun'}".encode())
    order = {
        "path": str(tmp_path / "file"), "folder": str(tmp_path / "columns"), "notes": (),
        "reader": "tests.support.wicked_reader", "extra": "", "seconds": 1000.0,
        "memory": MEMORY, "most_bytes": 1 << 30, "bad_share": 0.01,
    }  # fmt: skip
    lines = (
        *READS,
        "isolation.warm_up()",
        "spare = isolation._spares.get_nowait()",
        "isolation._spares.put(spare)",
        "print(spare.pid, flush=True)",
        f"isolation.carry_out({order!r})" if task == "loop" else "input()",
    )
    with run_script(lines, tmp_path, stdin=subprocess.PIPE) as program:
        assert program.stdout
        pid = int(program.stdout.readline())
        if task == "loop":
            assert int((tmp_path / "begun").read_text()) == pid
        program.kill()
    assert has_ended(pid)


def mdf(n):
    return b"MDF     4.10    forewarn" + bytes(n)


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
    "ch10": CH10 + bytes(99),
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
    for ending in FORMATS[key].endings:
        assert format_of(write(HEADS[key]), f"flight{ending.upper()}") == (FORMATS[key], ())
    assert format_of(write(HEADS[key]), "flight") == (FORMATS[key], ())
    other = ".csv" if key != "csv" else ".mat"
    known, (note,) = format_of(write(HEADS[key]), f"flight{other}")
    assert known.key == key
    assert f"not by the ending of its name ({other})" in note


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
def test_formats_that_share_a_container_are_told_apart(head, name, key, write):
    assert format_of(write(head), name)[0].key == key


def test_a_note_on_the_choice_comes_with_the_contents(write, tmp_path):
    contents = read_file(write(TABLE, "flight.mat"), tmp_path / "columns")
    assert contents.notes[0].startswith("Read by its content (text table)")


@pytest.mark.parametrize("magic", PACKED)
def test_what_is_packed_is_to_be_unpacked_first(magic, write, tmp_path):
    with pytest.raises(TelemetryError, match="and give"):
        read_file(write(magic + bytes(99)), tmp_path / "columns")


NO_FILE = {
    "empty": (b"", "record.csv", "the file is empty"),
    "noise": (bytes(range(256)), "record", "the format is not known: export one of text table"),
    "wrong": (bytes(range(256)), "record.mf4", "content is not that of a ASAM MDF"),
}


@pytest.mark.parametrize(("content", "name", "message"), NO_FILE.values(), ids=NO_FILE)
def test_a_file_of_no_format_is_refused(content, name, message, write, tmp_path):
    with pytest.raises(TelemetryError, match=message):
        read_file(write(content, name), tmp_path / "columns")
    assert not (tmp_path / "columns").exists()


def test_what_is_no_file_is_refused_by_its_own_name(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path, message in [
        (tmp_path, "is a directory"),
        (tmp_path / "absent.csv", "there is no such file"),
        (tmp_path / "absent" / "record.csv", "there is no such file"),
        (tmp_path / "pipe", "no file on disk"),
        (Path("/dev/zero"), "no file on disk"),
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


def test_columns_are_not_laid_over_others(write, tmp_path):
    read_file(write(TABLE), tmp_path / "columns")
    with pytest.raises(FileExistsError):
        read_file(write(TABLE), tmp_path / "columns")
    assert open_columns(tmp_path / "columns").contents.groups[0].n_rows == 3


def test_limits_reach_the_reader(write, tmp_path):
    bad = write(TABLE * 30)
    with pytest.raises(TelemetryError, match="29 of the 119 rows"):
        read_file(bad, tmp_path / "columns")
    limits = ReadLimits(bad_share=0.3)
    assert read_file(bad, tmp_path / "columns", limits=limits).n_bad_rows == 29
    with pytest.raises(TelemetryError, match="unfolds to more"):
        read_file(bad, tmp_path / "more", limits=ReadLimits(most_bytes=100, bad_share=0.3))


@pytest.mark.parametrize("kind", ["mat", "h5", "parquet"])
def test_a_small_file_does_not_become_a_large_folder(kind, tmp_path):
    """Twenty million zeros are under half a megabyte as a file and 160 MB of columns."""
    path, zeros = tmp_path / f"zeros.{kind}", np.zeros(20_000_000)
    if kind == "mat":
        savemat(path, {"t": zeros}, do_compression=True)
    elif kind == "h5":
        with h5py.File(path, "w") as file:
            file.create_dataset("t", data=zeros, chunks=(2**17,), compression="gzip")
    else:
        parquet.write_table(pa.table({"t": zeros}), path)
    assert path.stat().st_size < 500_000
    with pytest.raises(TelemetryError, match="more than the 64 MiB") as refused:
        read_file(path, tmp_path / "columns")
    assert str(refused.value).endswith("export the time range and the signals of this test")
    assert not (tmp_path / "columns").exists()


def test_what_a_file_may_unfold_to_grows_with_its_size(write, tmp_path):
    table = write(TABLE)
    for unfolds_by in (2, 4):
        limits = ReadLimits(unfolds_by=unfolds_by, unfolds_to=0)
        if unfolds_by == 2:
            with pytest.raises(TelemetryError, match="unfolds to more"):
                read_file(table, tmp_path / "columns", limits=limits)
        else:
            assert read_file(table, tmp_path / "columns", limits=limits).groups[0].n_rows == 3
