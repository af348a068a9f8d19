"""An installation from a folder of wheels, without a network, and the way back."""

import shutil
import sqlite3
import subprocess
import zipfile
from contextlib import closing
from pathlib import Path

import pytest
from filelock import FileLock

from app.upkeep.offline import InstallError, go_back, install

OPENS = """
import sqlite3
def open_store(url):
    database = sqlite3.connect(url.removeprefix("sqlite:///"))
    {migration}
    database.commit()
    return database
"""


def wheelhouse(folder: Path, version: str, migration: str = "") -> Path:
    """A folder with a small program of that name, whose store migrates like this."""
    folder.mkdir()
    about = f"forewarn-{version}.dist-info"
    files = {
        "app/__init__.py": "",
        "app/cli.py": f"print({version!r})",
        "app/store/__init__.py": "",
        "app/store/store.py": OPENS.format(migration=migration),
        f"{about}/METADATA": f"Metadata-Version: 2.1\nName: forewarn\nVersion: {version}\n",
        f"{about}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    with zipfile.ZipFile(folder / f"forewarn-{version}-py3-none-any.whl", "w") as wheel:
        for name, text in files.items():
            wheel.writestr(name, text)
        wheel.writestr(f"{about}/RECORD", "".join(f"{name},,\n" for name in files))
    return folder


class Range:
    """A machine without a network: a data directory, and the folder of all versions."""

    def __init__(self, root: Path) -> None:
        self.root, self.into, self.data = root, root / "opt", root / "data"
        (self.data / "live").mkdir(parents=True)
        self.fly("first")

    def fly(self, flight: str) -> None:
        with closing(sqlite3.connect(self.data / "forewarn.db")) as database:
            database.execute("CREATE TABLE IF NOT EXISTS flights (id)")
            database.execute("INSERT INTO flights (id) VALUES (?)", (flight,))
            database.commit()
        (self.data / "live" / f"{flight}.journal").write_text(flight)

    def flights(self, database: Path | None = None) -> list[str]:
        with closing(sqlite3.connect(database or self.data / "forewarn.db")) as opened:
            return [id_ for (id_,) in opened.execute("SELECT id FROM flights")]

    def journals(self) -> list[str]:
        return sorted(path.stem for path in (self.data / "live").iterdir())

    def installed(self) -> str:
        return subprocess.check_output([self.into / "forewarn"], text=True).strip()

    def has_newer_schema(self) -> bool:
        with closing(sqlite3.connect(self.data / "forewarn.db")) as database:
            columns = database.execute("SELECT name FROM pragma_table_info('flights')")
            return ("newer",) in columns.fetchall()


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Range:
    """A range with version 1 installed."""
    machine = Range(tmp_path_factory.mktemp("range"))
    install(machine.into, machine.data, "", wheelhouse(machine.root / "wheels 1", "1.0"))
    assert machine.installed() == "1.0"
    return machine


def test_an_upgrade_that_fails_changes_nothing(first: Range) -> None:
    wheels = wheelhouse(first.root / "wheels 3", "3.0", "raise ValueError('no room')")
    with pytest.raises(InstallError, match=r"3\.0 was not installed, nothing changed: .*no room"):
        install(first.into, first.data, "", wheels)
    assert first.installed() == "1.0"
    assert not (first.into / "versions" / "3.0").exists()
    assert not first.has_newer_schema()


def test_going_back_restores_program_database_and_journals(first: Range) -> None:
    newer = "database.execute('ALTER TABLE flights ADD newer')"
    install(first.into, first.data, "", wheelhouse(first.root / "wheels 2", "2.0", newer))
    assert first.installed() == "2.0"
    assert not first.has_newer_schema()
    with closing(sqlite3.connect(first.data / "forewarn.db")) as database:
        database.execute("ALTER TABLE flights ADD newer")
    first.fly("second")
    assert "back at 1.0" in go_back(first.into)
    assert first.installed() == "1.0"
    assert not first.has_newer_schema()
    assert (first.flights(), first.journals()) == (["first"], ["first"])
    (aside,) = first.data.glob("after-2.0-*")
    assert first.flights(aside / "forewarn.db") == ["first", "second"]
    assert (aside / "live" / "second.journal").read_text() == "second"
    shutil.rmtree(aside)


def test_there_is_no_way_back_from_the_first_version(first: Range) -> None:
    with pytest.raises(InstallError, match="none to go back to"):
        go_back(first.into)


def test_a_running_server_is_left_alone(first: Range) -> None:
    wheels = wheelhouse(first.root / "wheels 4", "4.0")
    with FileLock(first.data / "forewarn.lock"), pytest.raises(InstallError, match="stop it first"):
        install(first.into, first.data, "", wheels)


def test_a_folder_without_a_wheel_is_refused(first: Range) -> None:
    with pytest.raises(InstallError, match="holds 0 wheels"):
        install(first.into, None, "", first.root)
