"""Migrations: from the oldest release with its data; all or nothing, never past the program."""

import shutil
import signal
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.config import main as alembic
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Column, Integer, MetaData, Table, insert, inspect, select

from app.store import schema
from app.store.database import address, is_sqlite, make_engine, reading, writing
from app.store.schema import configuration, current_revision
from app.store.store import StoreError, open_store
from app.store.tables import dataset_blocks, datasets, jobs, metadata
from core.dataset import Dataset
from core.monitor import train
from tests.support.api import api
from tests.support.places import DATA, ROOT
from tests.support.postgresql import PostgreSQL
from tests.support.store_writer import add_a_job, open_by_migrations, remaining, start
from tests.support.stored import move

REVISIONS = [
    script.revision for script in ScriptDirectory.from_config(configuration()).walk_revisions()
][::-1]

OLDEST = REVISIONS[0]
OLD_DATABASE = DATA / "version_0_1_0" / "data" / "forewarn.db"

NEXT = """
'''One change more.'''
import os
import signal
import sqlalchemy as sa
from alembic import op
revision, down_revision = "next", "{newest}"

def upgrade():
    op.create_table("extra", sa.Column("id", sa.Integer, primary_key=True))
    {change}

def downgrade():
    op.drop_table("extra")
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "forewarn.db"


def old_database(path: Path) -> Path:
    """A database that version 0.1.0 wrote."""
    return Path(shutil.copy(OLD_DATABASE, path))


def old_store(url: str, path: Path) -> str:
    """The same in a database of any kind.   path: of one with SQLite."""
    old_database(path)
    if is_sqlite(address(url)):
        return url
    old, given = make_engine(address(path)), MetaData()
    engine = make_engine(address(url))
    with reading(old) as rows, writing(engine) as connection:
        given.reflect(rows)
        for table in given.sorted_tables:
            for column in table.columns:
                column.type = column.type.as_generic()
        given.create_all(connection)
        for table in given.sorted_tables:
            for row in rows.execute(select(table)):
                connection.execute(insert(table).values(**row._mapping))
    old.dispose()
    engine.dispose()
    return url


def tables(path: Path | str) -> set[str]:
    engine = make_engine(address(path))
    names = set(inspect(engine).get_table_names())
    engine.dispose()
    return names


def described(path: Path | str) -> dict[str, dict[str, list[str]]]:
    """All that a database says of its tables; the order of columns is no matter."""
    engine = make_engine(address(path))
    looked = inspect(engine)
    kinds = ("columns", "pk_constraint", "foreign_keys", "indexes", "unique_constraints")
    looks = {kind: getattr(looked, f"get_multi_{kind}")() for kind in (*kinds, "check_constraints")}
    engine.dispose()
    return {
        kind: {
            name: sorted(map(repr, found if isinstance(found, list) else [found]))
            for (_, name), found in tables_of.items()
        }
        for kind, tables_of in looks.items()
    }


def newer_program(directory: Path, change: str = "") -> Path:
    """Migrations of a program that is one revision ahead."""
    ahead = Path(shutil.copytree(schema.migrations(), directory / "ahead"))
    (ahead / "versions" / "next.py").write_text(NEXT.format(change=change, newest=REVISIONS[-1]))
    return ahead


def configured(directory: Path) -> Config:
    config = Config()
    config.set_main_option("script_location", str(directory))
    return config


def test_migrations_make_the_tables_that_the_program_uses(url: str, path: Path) -> None:
    open_store(old_store(url, path)).close()
    engine = make_engine(address(url))
    with engine.connect() as connection:
        context = MigrationContext.configure(
            connection, opts={"compare_type": True, "compare_server_default": True}
        )
        assert compare_metadata(context, metadata) == []
    engine.dispose()


@pytest.mark.parametrize("revision", REVISIONS)
def test_a_store_of_each_revision_is_upgraded_with_its_rows(
    url: str, path: Path, revision: str
) -> None:
    move(old_store(url, path), revision)
    store = open_store(url)
    assert store.revision() == REVISIONS[-1]
    assert len(store.flights.all()) == len(store.recordings.all()) == 1
    store.close()


@pytest.mark.services
def test_postgresql_stores_assessments_as_they_are(postgresql: PostgreSQL) -> None:
    url = postgresql.new_database()
    open_store(url).close()
    stored = postgresql.run(
        "SELECT attname FROM pg_attribute WHERE attrelid = 'assessment_chunks'::regclass "
        "AND attstorage = 'e' ORDER BY attname",
        url,
    )
    assert stored == [("content",), ("display",)]


def test_journals_that_became_recordings_have_their_digest(url: str, path: Path) -> None:
    move(old_store(url, path), "0024")
    engine = make_engine(address(url))
    with writing(engine) as connection:
        connection.exec_driver_sql("UPDATE flights SET recording_id = (SELECT id FROM recordings)")
    engine.dispose()
    store = open_store(url)
    (flight,), (recording,) = store.flights.all(), store.recordings.all()
    assert flight.journal_digest == recording.digest
    store.close()


def test_no_migration_forces_a_rebuild() -> None:
    """PostgreSQL alters tables; it cannot drop one that others refer to."""
    for file in (schema.migrations() / "versions").glob("*.py"):
        assert "recreate=" not in file.read_text(), file


def test_a_new_store_has_the_schema_that_migrations_make(path: Path, tmp_path: Path) -> None:
    migrated = old_database(tmp_path / "migrated.db")
    open_store(migrated).close()
    open_store(path).close()
    assert described(path) == described(migrated)
    assert current_revision(address(path)) == REVISIONS[-1]


def test_a_store_of_an_older_program_is_upgraded_when_it_opens(path: Path) -> None:
    old_database(path)
    engine = make_engine(address(path))
    row = {"id": "a", "kind": "collect", "request": {}, "status": "done", "message": ""}
    with writing(engine) as connection:
        connection.execute(insert(jobs).values(**row, created="2026-01-01T00:00:00Z"))
    engine.dispose()
    store = open_store(path)
    assert store.revision() == REVISIONS[-1]
    assert "a" in [job.id for job in store.jobs.all()]
    store.close()


def test_a_store_of_an_unreleased_program_is_refused_untouched(path: Path) -> None:
    old_database(path)
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '0013'")
    connection.close()
    before = path.read_bytes()
    with pytest.raises(StoreError, match=r"schema 0013 .* unreleased"):
        open_store(path)
    assert path.read_bytes() == before


def test_a_store_of_a_newer_program_is_refused_untouched(path: Path, tmp_path: Path) -> None:
    store = open_store(path)
    store.jobs.update(store.jobs.add("collect", {}), "running")
    store.close()
    move(path, "head", configured(newer_program(tmp_path)))
    before = path.read_bytes()
    with pytest.raises(
        StoreError, match=f"has schema next, this program reads up to {REVISIONS[-1]}"
    ):
        open_store(path)
    assert path.read_bytes() == before
    with sqlite3.connect(path) as connection:
        assert connection.execute("SELECT status FROM jobs").fetchall() == [("running",)]
    connection.close()


def test_a_database_of_another_program_is_refused_untouched(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE recipes (cake TEXT)")
    connection.close()
    before = path.read_bytes()
    with pytest.raises(StoreError, match=r"tables of another program \(recipes\)"):
        open_store(path)
    assert path.read_bytes() == before


@pytest.mark.parametrize("content", [b"t,beta,p\n0,0,0\n" * 1000, b"x"])
def test_a_file_that_is_no_database_is_refused_untouched(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(StoreError, match=r"\((it|file) is not a database\)"):
        open_store(path)
    assert path.read_bytes() == content


def test_a_directory_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StoreError, match=r"FOREWARN_DATA_DIR|cannot be read"):
        open_store(tmp_path / "file" / "inside" / "forewarn.db")


def test_a_new_directory_is_the_owners_alone(tmp_path: Path) -> None:
    open_store(tmp_path / "data" / "forewarn.db").close()
    assert (tmp_path / "data").stat().st_mode & 0o777 == 0o700


def test_rebuilding_a_table_keeps_the_rows_that_refer_to_it(
    url: str, tmp_path: Path, dataset: Dataset
) -> None:
    store = open_store(url)
    info = store.datasets.add(dataset, "d")
    store.monitors.add(train(dataset), "m", info.id)
    store.close()
    rebuild = (
        'with op.batch_alter_table("datasets") as batch:\n'
        '        batch.alter_column("version", nullable=True)'  # SQLite copies the table for it
    )
    move(url, "head", configured(newer_program(tmp_path, rebuild)))
    columns = described(url)["columns"]["datasets"]
    assert any("'name': 'version'" in column and "'nullable': True" in column for column in columns)
    engine = make_engine(address(url))
    with reading(engine) as connection:
        assert [row.name for row in connection.execute(select(datasets))] == ["d"]
        assert len(connection.execute(select(dataset_blocks.c.name)).all()) >= 6
    engine.dispose()


def test_a_migration_that_breaks_references_is_undone(
    url: str, tmp_path: Path, dataset: Dataset
) -> None:
    store = open_store(url)
    info = store.datasets.add(dataset, "d")
    store.monitors.add(train(dataset), "m", info.id)
    store.close()
    ahead = configured(newer_program(tmp_path, 'op.execute("DELETE FROM datasets")'))
    with pytest.raises(StoreError, match=r"would break references: .*(dataset_blocks|monitors)"):
        move(url, "head", ahead)
    store = open_store(url)
    assert store.datasets.get(info.id).digest() == dataset.digest()
    store.close()


def test_a_migration_that_fails_half_way_is_undone(url: str, tmp_path: Path) -> None:
    open_store(url).close()
    ahead = configured(newer_program(tmp_path, 'raise RuntimeError("half way")'))
    with pytest.raises(RuntimeError, match="half way"):
        move(url, "head", ahead)
    assert current_revision(address(url)) == REVISIONS[-1]
    assert "extra" not in tables(url)


def test_a_program_killed_in_the_middle_of_a_migration_leaves_the_old_schema(
    path: Path, tmp_path: Path
) -> None:
    store = open_store(path)
    job = store.jobs.add("collect", {})
    store.close()
    die = 'op.execute("DELETE FROM jobs")\n    os.kill(os.getpid(), signal.SIGKILL)'
    killed, reports = start(open_by_migrations, path, newer_program(tmp_path, die))
    assert remaining(killed, reports) == []
    assert killed.exitcode == -signal.SIGKILL
    store = open_store(path)
    assert store.jobs.info(job).status == "interrupted"
    assert store.damage() == []
    store.close()
    assert "extra" not in tables(path)


def test_processes_that_open_a_new_store_at_once_make_one(url: str) -> None:
    opening = [start(add_a_job, url) for _ in range(3)]
    assert [remaining(*process) for process in opening] == [[], [], []]
    assert [process.exitcode for process, _ in opening] == [0, 0, 0]
    store = open_store(url)
    assert len(store.jobs.all()) == 3
    store.close()


def test_threads_that_open_a_new_store_at_once_make_one(url: str) -> None:
    with ThreadPoolExecutor(4) as pool:
        stores = list(pool.map(open_store, [url] * 4))
    for store in stores:
        store.jobs.add("a", {})
    assert len(stores[0].jobs.all()) == 4
    for store in stores:
        store.close()


def test_the_library_wins_over_the_directory_of_migrations() -> None:
    code = (
        "import alembic, app.store.schema; print(alembic.__file__); "
        "print(app.store.schema.migrations())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    library, migrations = map(Path, done.stdout.split("\n")[:2])
    assert library.name == "__init__.py"
    assert library.parent != ROOT / "alembic"
    assert (migrations / "versions").is_dir()
    assert not list(schema.migrations().rglob("__init__.py"))


def test_the_command_alembic_finds_its_configuration(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("FOREWARN_DATABASE_URL", f"sqlite:///{path}")
    old_database(path)
    alembic(["upgrade", "head"])
    assert current_revision(address(path)) == REVISIONS[-1]
    alembic(["check"])
    more = Table("more", metadata, Column("id", Integer, primary_key=True))
    try:
        with pytest.raises(SystemExit):
            alembic(["check"])
    finally:
        metadata.remove(more)
    monkeypatch.delenv("FOREWARN_DATABASE_URL")
    another = old_database(path.with_name("another.db"))
    alembic(["-x", f"url={another}", "upgrade", "head"])
    assert current_revision(address(another)) == REVISIONS[-1]


def test_a_migration_keeps_a_copy_until_the_next_good_start(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old_database(path)
    before = sorted(tables(path))
    with api(path.parent, database_url=f"sqlite:///{path}"):
        pass
    copy = path.with_name(f"{path.name}.before-{OLDEST}")
    assert current_revision(address(path)) == REVISIONS[-1]
    assert current_revision(address(copy)) == OLDEST
    assert sorted(tables(copy)) == before
    monkeypatch.setattr(schema, "_COPIES", set())  # as another process has it
    with api(path.parent, database_url=f"sqlite:///{path}"):
        pass
    assert not copy.exists()


def test_a_database_that_cannot_be_copied_is_not_migrated(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old_database(path)
    path.with_name(f"{path.name}.before-{OLDEST}.part").mkdir()
    with pytest.raises(StoreError, match="make space for the copy"):
        open_store(path)
    assert current_revision(address(path)) == OLDEST
