"""Install Forewarn from a folder of wheels, without a network, and go back to the version before.

`make wheelhouse` copies this file into the folder; it needs Python alone.

    python install.py --into /opt/forewarn --data-dir /srv/forewarn
    python install.py --into /opt/forewarn --back

Each version has its own environment under INTO/versions, and INTO/forewarn starts the current
one. An upgrade keeps a copy of the database in INTO/before and tries its migrations on another copy
first; if anything fails, nothing has changed. Going back restores program, database and journals;
everything stored later is moved into a folder of the data directory.
"""

import argparse
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import venv
from contextlib import closing, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

DATABASE, STOP, LOCK = "forewarn.db", "forewarn.db.stop", "forewarn.lock"
OF_DATABASE = (DATABASE, f"{DATABASE}-wal", f"{DATABASE}-shm", STOP)
FOLDERS = ("live", "recordings")
"""Folders of a data directory, with a file or folder for each flight or recording."""
EXTRAS = "ulog,mdf,tdms,mcap,fmu,jsbsim,postgres,dask"
MIGRATE = "import sys; from app.store.store import open_store; open_store(sys.argv[1]).close()"
IS_WINDOWS = os.name == "nt"


class InstallError(Exception):
    """The installation failed; the message gives the cause and what to do."""


def main() -> int:
    parser = argparse.ArgumentParser(description="Install Forewarn from this folder, or go back.")
    parser.add_argument("--into", type=Path, required=True, help="folder of all versions")
    parser.add_argument("--data-dir", type=Path, help="data directory of the server, if it has one")
    parser.add_argument("--extras", default=EXTRAS, help=f"{EXTRAS} if absent")
    parser.add_argument("--back", action="store_true", help="return to the version before")
    options = parser.parse_args()
    into = options.into.absolute()
    data = options.data_dir and options.data_dir.absolute()
    try:
        done = go_back(into) if options.back else install(into, data, options.extras)
    except InstallError as error:
        print(f"install: {error}", file=sys.stderr)
        return 1
    print(done)
    return 0


def install(into: Path, data: Path | None, extras: str, wheels: Path | None = None) -> str:
    """Install the version of a folder of wheels, and make it the current one. InstallError."""
    wheels = wheels or Path(__file__).resolve().parent
    version = _version(wheels)
    place = into / "versions" / version
    history = _history(into)
    if any(each["version"] == version for each in history):
        raise InstallError(f"{version} is installed in {into}: give the folder of another version")
    _check_stopped(data)
    shutil.rmtree(place, ignore_errors=True)  # of an installation that was interrupted
    before = into / "before" / version
    try:
        venv.create(place, with_pip=True)
        wanted = f"forewarn[{extras}]=={version}" if extras else f"forewarn=={version}"
        offline = ["--no-index", "--find-links", str(wheels), "--disable-pip-version-check"]
        _run(_python(place), "-I", "-m", "pip", "install", "--quiet", *offline, wanted)
        folders = None if data is None else _keep(data, before)
        if folders is not None and (before / DATABASE).exists():
            _try_migrations(place, before / DATABASE)
    except BaseException as error:
        shutil.rmtree(place, ignore_errors=True)
        shutil.rmtree(before, ignore_errors=True)
        if isinstance(error, subprocess.CalledProcessError):
            reason = (error.stderr or "").strip().splitlines() or [str(error)]
            raise InstallError(
                f"{version} was not installed, nothing changed: {reason[-1]}"
            ) from None
        raise
    entry = {"version": version, "data": data and str(data), "kept": folders}
    _write(into / "history.json", json.dumps([*history, entry], indent=1))
    _start_with(into, place)
    return f"{version} is installed; start it by {_launcher(into)}"


def go_back(into: Path) -> str:
    """Return to the version before: program, database and journals. InstallError."""
    history = _history(into)
    if len(history) < 2:
        raise InstallError(f"{into} holds {len(history)} version(s): there is none to go back to")
    *rest, newest = history
    data = newest["data"] and Path(newest["data"])
    _check_stopped(data)
    words = ""
    if data is not None and newest["kept"] is not None:
        aside = _put_back(data, into / "before" / newest["version"], newest)
        words = f"; what was stored since is in {aside}"
    _start_with(into, into / "versions" / rest[-1]["version"])
    _write(into / "history.json", json.dumps(rest, indent=1))
    shutil.rmtree(into / "versions" / newest["version"], ignore_errors=True)
    shutil.rmtree(into / "before" / newest["version"], ignore_errors=True)
    return f"back at {rest[-1]['version']}{words}"


def _keep(data: Path, before: Path) -> dict[str, list[str]]:
    """Copy the database; return the names in each folder of the data directory."""
    before.mkdir(parents=True)
    if (data / DATABASE).exists():
        _copy_database(data / DATABASE, before / DATABASE)
    with suppress(FileNotFoundError):
        shutil.copy2(data / STOP, before / STOP)
    return {name: _names(data / name) for name in FOLDERS}


def _put_back(data: Path, before: Path, newest: dict[str, Any]) -> Path:
    """Restore the copied database; move everything stored later aside."""
    aside = data / f"after-{newest['version']}-{datetime.now():%Y%m%d-%H%M%S}"
    aside.mkdir(parents=True)
    for name in OF_DATABASE:
        with suppress(FileNotFoundError):
            os.replace(data / name, aside / name)
    for name in (DATABASE, STOP):
        with suppress(FileNotFoundError):
            shutil.copy2(before / name, data / name)
    for folder in FOLDERS:
        for name in sorted({*_names(data / folder)} - {*newest["kept"][folder]}):
            (aside / folder).mkdir(exist_ok=True)
            os.replace(data / folder / name, aside / folder / name)
    return aside


def _try_migrations(place: Path, database: Path) -> None:
    with tempfile.TemporaryDirectory() as directory:
        trial = Path(directory) / DATABASE
        shutil.copy2(database, trial)
        _run(_python(place), "-I", "-c", MIGRATE, f"sqlite:///{trial}")


def _copy_database(source: Path, to: Path) -> None:
    with closing(sqlite3.connect(source)) as original, closing(sqlite3.connect(to)) as copy:
        original.backup(copy)


def _check_stopped(data: Path | None) -> None:
    """InstallError while a server holds the data directory."""
    if data is None or not (data / LOCK).exists():
        return
    with (data / LOCK).open("a") as lock:
        try:
            if IS_WINDOWS:
                import msvcrt

                msvcrt.locking(lock.fileno(), msvcrt.LK_NBLCK, 1)  # pyright: ignore
                msvcrt.locking(lock.fileno(), msvcrt.LK_UNLCK, 1)  # pyright: ignore
            else:
                import fcntl

                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InstallError(f"a server uses {data}: stop it first") from None


def _version(wheels: Path) -> str:
    candidates = sorted(wheels.glob("forewarn-*.whl"))
    if len(candidates) != 1:
        raise InstallError(
            f"{wheels} holds {len(candidates)} wheels of forewarn: give a folder with one"
        )
    return candidates[0].name.split("-")[1]


def _history(into: Path) -> list[dict[str, Any]]:
    """The installed versions, oldest first."""
    try:
        return json.loads((into / "history.json").read_text())
    except FileNotFoundError:
        return []


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []


def _python(place: Path) -> Path:
    return place / ("Scripts/python.exe" if IS_WINDOWS else "bin/python")


def _launcher(into: Path) -> Path:
    return into / ("forewarn.cmd" if IS_WINDOWS else "forewarn")


def _start_with(into: Path, place: Path) -> None:
    start = f'"{_python(place)}" -I -m app.cli'  # whatever folder it is called from
    text = f"@{start} %*\n" if IS_WINDOWS else f'#!/bin/sh\nexec {start} "$@"\n'
    _write(_launcher(into), text)
    _launcher(into).chmod(0o755)


def _write(path: Path, text: str) -> None:
    """Write a file whole, or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.part")
    part.write_text(text)
    os.replace(part, path)


def _run(*command: object) -> None:
    subprocess.run([*map(str, command)], check=True, capture_output=True, text=True)


if __name__ == "__main__":
    sys.exit(main())
