"""Read many damaged files in one isolated process, as if they were one file with one reader.

Each result is one line of a log; the first missing line is the file that ended the process.
"""

import json
import os
import shutil
import tempfile
import time
from importlib import import_module
from pathlib import Path
from signal import ITIMER_REAL, setitimer

from app.recordings.mapped_columns import propose_mapping
from app.telemetry.contents import Columns, ColumnWriter, open_columns
from app.telemetry.formats import READERS, format_of
from app.telemetry.recording import TelemetryError
from tests.fuzzing.damage import Damaged, damaged

MOST_BYTES = 1 << 30


def read(path: Path, writer: ColumnWriter) -> None:
    """Do what the JSON at `path` says: seed, files, paths, seconds, log."""
    order = json.loads(path.read_text())
    aside = writer.folder / "temporary"
    aside.mkdir()
    tempfile.tempdir = str(aside)
    log = os.open(order["log"], os.O_WRONLY | os.O_APPEND)
    for kind, number in order["files"]:
        file = damaged(order["seed"], kind, number, [Path(path) for path in order["paths"][kind]])
        setitimer(ITIMER_REAL, order["seconds"])
        begun = time.process_time()
        end, text = outcome(file, writer.folder)
        took = time.process_time() - begun
        setitimer(ITIMER_REAL, 0)
        os.write(log, json.dumps([end, text, took, _most_memory()]).encode() + b"\n")


def outcome(file: Damaged, folder: Path) -> tuple[str, str]:
    """How the reading of a file ended: "read", "refused", or "wrong" with what is wrong."""
    path, columns = folder / "damaged", folder / "columns"
    path.write_bytes(file.content)
    columns.mkdir()
    try:
        known, notes = format_of(path, file.name)
        writer = ColumnWriter(columns, MOST_BYTES, notes=notes)
        contents = import_module(known.reader, READERS).read(path, writer)
        if open_columns(columns).contents != contents:
            return "wrong", "what was written is not what was answered"
        if reason := wrong_columns(open_columns(columns)):
            return "wrong", reason
        propose_mapping(open_columns(columns), None)
    except TelemetryError as error:
        return "refused", str(error)
    except Exception as error:
        return "wrong", f"{type(error).__name__}: {error}"[:500]
    finally:
        shutil.rmtree(columns)
        path.unlink()
    left = [path.name for path in (folder / "temporary").iterdir()]
    return ("wrong", f"it left {left} behind") if left else ("read", "")


def wrong_columns(columns: Columns) -> str:
    """What is wrong with a folder of columns, "" where nothing is."""
    contents = columns.contents
    names = [signal.name for signal in contents.signals]
    expected = {"contents.json", *(f"{number}.f8" for number in range(len(names)))}
    if more := {path.name for path in columns.folder.iterdir()} - expected:
        return f"{more} lies beside the columns"
    if len(set(names)) < len(names) or not all(name and name.isprintable() for name in names):
        return f"signals have the names {names}"
    for signal in contents.signals:
        values, n_rows = columns.values(signal.name), contents.groups[signal.group].n_rows
        if values.shape != (n_rows,):
            return f"{signal.name} has {len(values)} values in a group of {n_rows} rows"
    return ""


def _most_memory() -> int:
    """The most that this process has used so far [MiB]; 0 where the system does not say.

    ru_maxrss is no measure of it: a program inherits there what the process that started it used.
    """
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    peaks = [int(line.split()[1]) // 1024 for line in lines if line.startswith("VmHWM:")]
    return max(peaks, default=0)
