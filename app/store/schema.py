"""The database's schema, upgraded by alembic to this program's revision; never downgraded."""

import glob
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

from sqlalchemy import URL, Connection, inspect
from sqlalchemy.exc import DBAPIError, IntegrityError

from app.store.database import (
    StoreError,
    broken_references,
    copy_database,
    file_of,
    is_sqlite,
    make_directory,
    make_engine,
    read_only_engine,
    reason_of,
    writing,
)
from app.store.tables import metadata

if TYPE_CHECKING:
    from alembic.config import Config
    from alembic.script import ScriptDirectory

COPY = ".before-"
"""Between the name of a database and the revision of its copy."""
_COPIES: set[Path] = set()
"""Copies made by this process, which must first start well."""
VERSION_TABLE = "alembic_version"
ONE_AT_A_TIME = Lock()
"""Alembic keeps the running migration in global variables."""


def migrations() -> Path:
    """Directory of the migrations: in the installed package or at the root of the repository."""
    here = Path(__file__).parents[1]
    for directory in (here / "alembic", here.parent / "alembic"):
        if (directory / "env.py").is_file():
            return directory
    raise StoreError(
        f"the migrations are missing beside {here}: the installation is incomplete, install again"
    )


def configuration() -> "Config":
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(migrations()).replace("%", "%%"))
    return config


@cache
def scripts(directory: Path) -> "ScriptDirectory":
    from alembic.script import ScriptDirectory

    return ScriptDirectory(directory)


def revisions(directory: Path) -> tuple[str, ...]:
    """Revisions in a directory of migrations, newest first."""
    return tuple(script.revision for script in scripts(directory).walk_revisions())


def current_revision(url: URL) -> str | None:
    """Revision of a database; None if it is new. Reads only.

    StoreError if it is not a database, belongs to another program, or cannot be read.
    """
    from alembic.migration import MigrationContext

    engine = read_only_engine(url)
    if engine is None:
        return None
    place = url.render_as_string(hide_password=True)
    try:
        with engine.connect() as connection:
            # tables first: another process may commit them and their revision in between
            tables = set(inspect(connection).get_table_names()) - {VERSION_TABLE}
            heads = MigrationContext.configure(connection).get_current_heads()
    except DBAPIError as error:
        remedy = (
            "choose a Forewarn database, or a new file"
            if is_sqlite(url)
            else "check that the database runs, exists and accepts this user"
        )
        raise StoreError(f"{place} cannot be read ({reason_of(error)}): {remedy}") from error
    finally:
        engine.dispose()
    if not heads and tables:
        names = ", ".join(sorted(tables)[:3])
        raise StoreError(
            f"{place} holds tables of another program ({names}): choose a Forewarn database, or "
            "a new file"
        )
    return ", ".join(heads) or None


def bring_up_to_date(url: URL) -> None:
    """Create a database or upgrade it to this program's schema, all or nothing.

    StoreError, with the database unchanged, if a newer program made it.
    """
    from alembic import command, util

    with ONE_AT_A_TIME:
        if not needs_upgrade(url):
            return
        keep_copy(url)
        with migrating(url) as connection:
            if not inspect(connection).get_table_names():  # another process may have made them
                create_tables(connection)
                return
            config = configuration()
            config.attributes["connection"] = connection
            try:
                command.upgrade(config, "head")
            except util.CommandError as error:
                raise StoreError(f"the schema cannot be upgraded: {error}") from error


def create_tables(connection: Connection) -> None:
    """The tables of an empty database."""
    from alembic.migration import MigrationContext

    metadata.create_all(connection, checkfirst=False)
    MigrationContext.configure(connection).stamp(scripts(migrations()), "head")


def keep_copy(url: URL) -> None:
    """Copy an SQLite database next to it before an upgrade; not a new one. StoreError."""
    current, database = current_revision(url), file_of(url)
    if current is not None and database is not None:
        copy = database.with_name(f"{database.name}{COPY}{current}")
        copy_database(url, copy, "an upgrade copies the database first, make space for the copy")
        _COPIES.add(copy)


def forget_copies(url: URL) -> None:
    """Delete copies from earlier processes, once this one has started well."""
    if (database := file_of(url)) is not None:
        for copy in database.parent.glob(f"{glob.escape(database.name)}{COPY}*"):
            if copy not in _COPIES:
                copy.unlink(missing_ok=True)


def needs_upgrade(url: URL) -> bool:
    """Whether the database is new or from an older program. StoreError if from a newer one."""
    known = revisions(migrations())
    current = current_revision(url)
    if current is None or current in known:
        return current != known[0]
    place = url.render_as_string(hide_password=True)
    if current < known[0]:
        raise StoreError(
            f"{place} has schema {current} of an unreleased Forewarn, this program opens those of "
            f"releases ({', '.join(reversed(known))}): choose another data directory; nothing was "
            "changed"
        )
    raise StoreError(
        f"{place} has schema {current}, this program reads up to {known[0]}: upgrade Forewarn; "
        "nothing was changed"
    )


@contextmanager
def migrating(url: URL) -> Iterator[Connection]:
    """One transaction in which tables are created, changed and rebuilt."""
    make_directory(url)
    engine = make_engine(url, foreign_keys=False)
    try:
        with writing(engine) as connection:
            yield connection
            if broken := broken_references(connection):
                raise _breaks("; ".join(broken[:3]))
    except IntegrityError as error:
        raise _breaks(reason_of(error)) from error
    finally:
        engine.dispose()


def _breaks(reason: str) -> StoreError:
    return StoreError(f"the migration would break references: {reason}")
