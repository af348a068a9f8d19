"""Files are read in another process; any failure there becomes one sentence."""

import os
import select
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from app.telemetry.contents import open_columns
from app.telemetry.formats import FORMATS, Format
from app.telemetry.readers import isolation
from app.telemetry.reading import ReadLimits, read_file
from app.telemetry.recording import TelemetryError
from tests.support.wicked_reader import MAGIC

pytestmark = pytest.mark.usefixtures("read_apart")
TABLE = "t,beta\n0,1\n1,2\n2,3\n"
MEMORY = 200 * 2**20
ENDLESS = ("loop", "burn", "hold")


@pytest.fixture
def wicked(write, tmp_path, monkeypatch):
    """What a reader does -> the error that comes of it."""
    monkeypatch.setitem(
        FORMATS,
        "wicked",
        Format(
            "wicked",
            "Wicked file",
            ".wicked",
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


def test_a_note_on_the_choice_comes_with_the_contents(write, tmp_path):
    contents = read_file(write(TABLE, "flight.mat"), tmp_path / "columns")
    assert contents.notes[0].startswith("Read as text table by its content")


def test_limits_reach_the_reader(write, tmp_path):
    bad = write(TABLE * 30)
    with pytest.raises(TelemetryError, match="29 of the 119 rows"):
        read_file(bad, tmp_path / "columns")
    limits = ReadLimits(bad_share=0.3)
    assert read_file(bad, tmp_path / "columns", limits=limits).n_bad_rows == 29
    with pytest.raises(TelemetryError, match="expands to more"):
        read_file(bad, tmp_path / "more", limits=ReadLimits(most_bytes=100, bad_share=0.3))


OUTCOMES = {
    "crash": "the file cannot be read.*: it is damaged or not a complete Wicked file",
    "abort": "the file cannot be read",
    "exit": "the file cannot be read",
    "leave": r"the file cannot be read \(SystemExit: bye\)",
    "fall": r"the file cannot be read \(RecursionError: ",
    "stumble": r"the file cannot be read \(KeyError: ",
    "loop": "took more than 0.5 s: export only the time range and signals",
    "burn": "took more than 0.5 s: export only",
    "hold": "took more than 0.5 s: export only",
    "die": "took more than 200 MiB of memory",
    "eat": "took more than 200 MiB of memory: export only",
    "eat_at_once": "took more than 200 MiB of memory",
    "lack": r"reading Wicked file needs .* \(No module named 'no_such_library'\): "
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


def test_a_full_disk_is_not_reported_as_a_damaged_file(wicked, tmp_path):
    with pytest.raises(OSError, match="no room to store"):
        wicked("fill")
    assert os.listdir(tmp_path) == ["flight.wicked"]


def test_an_interruption_ends_the_reader_and_removes_its_columns(wicked, tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "begun")
    pids = []

    def interrupted(*_):
        pids.append(int((tmp_path / "begun").read_text()))
        raise KeyboardInterrupt

    monkeypatch.setattr(isolation, "Timer", interrupted)
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


def test_a_command_starts_no_spare(write, tmp_path):
    while not isolation._spares.empty():
        isolation._end(isolation._spares.get_nowait())
    read_file(write(TABLE), tmp_path / "columns")
    assert isolation._spares.empty()


def test_a_file_is_read_even_if_no_spare_can_start(write, tmp_path, monkeypatch):
    isolation.warm_up()
    monkeypatch.setattr(sys, "executable", str(tmp_path / "absent"))
    assert read_file(write(TABLE), tmp_path / "columns").groups[0].n_rows == 3
    assert isolation._spares.empty()


def test_many_threads_read_at_once(write, tmp_path):
    paths = [write(f"t,x\n0,{k}\n1,{k}\n", f"{k}.csv") for k in range(6)]
    with ThreadPoolExecutor(3) as pool:
        list(pool.map(lambda path: read_file(path, path.with_suffix("")), paths))
    for k in range(6):
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
        "isolation.warm_up()",
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


def test_a_kept_reader_reads_one_file_after_another(write, tmp_path):
    path = write(TABLE)
    with isolation.kept_readers():
        for k in range(3):
            assert read_file(path, tmp_path / f"columns{k}").groups[0].n_rows == 3
        reader = isolation._spares.get_nowait()
        isolation._spares.put(reader)
        with pytest.raises(TelemetryError, match="29 of the 119 rows"):
            read_file(write(TABLE * 30, "bad.csv"), tmp_path / "bad")
        assert reader.poll() is None
        assert isolation._spares.qsize() == 1
    assert reader.returncode is not None
    assert isolation._spares.empty()


@pytest.mark.parametrize("deed", ["crash", "burn", "hold", "eat", "refuse"])
def test_a_kept_reader_keeps_its_limits(deed, write, wicked, tmp_path):
    with isolation.kept_readers():
        read_file(write(TABLE), tmp_path / "before")
        with pytest.raises(TelemetryError, match=OUTCOMES[deed]):
            wicked(deed)
        assert read_file(write(TABLE), tmp_path / "after").groups[0].n_rows == 3
