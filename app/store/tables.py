"""The tables of the database.

Ids are random, times are UTC in ISO 8601, numbers are SI. Large content has its own tables, in
parts that a short transaction can write. Every change here needs a migration in `alembic/`.
"""

import secrets
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import (
    DDL,
    JSON,
    BigInteger,
    Boolean,
    Column,
    Dialect,
    Float,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    TypeDecorator,
    UniqueConstraint,
    event,
    false,
)

ID_BYTES = 6

metadata = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s_%(referred_table_name)s",
        "pk": "pk_%(table_name)s",
    }
)


def new_id() -> str:
    """Random id of 12 hexadecimal digits."""
    return secrets.token_hex(ID_BYTES)


def now() -> str:
    """Present time, UTC in ISO 8601, so that text order is time order."""
    return time_text(datetime.now(UTC))


def time_text(utc: datetime) -> str:
    return utc.isoformat(timespec="microseconds").replace("+00:00", "Z")


class WholeNumber(TypeDecorator[int]):
    """An integer of any size: a seed may have more bits than a database's integer."""

    impl = String
    cache_ok = True

    def process_bind_param(self, value: int | None, dialect: Dialect) -> str | None:
        return None if value is None else str(value)

    def process_result_value(self, value: Any, dialect: Dialect) -> int | None:
        return None if value is None else int(value)


def _id() -> Column[str]:
    return Column("id", String(2 * ID_BYTES), primary_key=True)


def _part_of(table: str) -> Column[str]:
    """Part of the primary key that refers to the owner; deleted with the owner."""
    row = ForeignKey(f"{table}.id", ondelete="CASCADE")
    return Column(f"{table.removesuffix('s')}_id", String(2 * ID_BYTES), row, primary_key=True)


def _refers_to(
    table: str, ondelete: str, *, index: bool = True, nullable: bool = False
) -> Column[str]:
    """Reference to another table's row, which this row needs (RESTRICT) or belongs to (CASCADE)."""
    row = ForeignKey(f"{table}.id", ondelete=ondelete)
    name = f"{table.removesuffix('s')}_id"
    return Column(name, String(2 * ID_BYTES), row, nullable=nullable, index=index)


def _time(name: str, *, nullable: bool = True) -> Column[str]:
    return Column(name, String(27), nullable=nullable)


def _plain(name: str, *, nullable: bool = False) -> Column[Any]:
    return Column(name, JSON(none_as_null=True), nullable=nullable)


def _named() -> Iterator[Column[str]]:
    yield from (_id(), Column("name", Text, nullable=False), _time("created", nullable=False))


def _called() -> Iterator[Column[Any]]:
    """Sample of a flight, time and author of an action."""
    yield Column("seq", BigInteger, nullable=False)
    yield Column("t", Float, nullable=False)
    yield _time("created", nullable=False)
    yield Column("by", Text, nullable=False)


datasets = Table(
    "datasets",
    metadata,
    *_named(),
    Column("complete", Boolean, nullable=False),
    Column("digest", String(64), nullable=False, index=True),
    Column("seed", WholeNumber),
    Column("version", Text, nullable=False),
    _plain("recipe"),
    Column("dt", Float, nullable=False),
    Column("n_unsafe", Integer, nullable=False),
    Column("n_safe", Integer, nullable=False),
    Column("n_safe_met", BigInteger, nullable=False),
    Column("n_samples", Integer, nullable=False),
    Column("n_obs", Integer, nullable=False),
    Column("unsafe_rate", Float),
    _plain("theta_names"),
    _plain("peaks"),
    _plain("specification", nullable=True),
    _plain("dictionary", nullable=True),
    _plain("findings", nullable=True),
)

dataset_blocks = Table(
    "dataset_blocks",
    metadata,
    _part_of("datasets"),
    Column("name", String(16), primary_key=True),
    Column("first_row", Integer, primary_key=True, autoincrement=False),
    Column("content", LargeBinary, nullable=False),
)

monitors = Table(
    "monitors",
    metadata,
    *_named(),
    Column("complete", Boolean, nullable=False),
    Column("digest", String(64), nullable=False),
    _refers_to("datasets", "RESTRICT", nullable=True),
    Column("dataset_digest", String(64), nullable=False),
    _plain("dataset_recipe"),
    _plain("recipe"),
    Column("seed", WholeNumber),
    Column("version", Text, nullable=False),
    Column("dt", Float, nullable=False),
    Column("h", Integer, nullable=False),
    Column("lead", Float, nullable=False),
    Column("n_unsafe", Integer, nullable=False),
    Column("n_early", Integer, nullable=False),
    Column("smallest_epsilon", Float, nullable=False),
    Column("epsilon", Float, nullable=False),
    _plain("evaluation", nullable=True),
    _plain("specification", nullable=True),
    _plain("dictionary", nullable=True),
)

monitor_parts = Table(
    "monitor_parts",
    metadata,
    _part_of("monitors"),
    Column("part", Integer, primary_key=True, autoincrement=False),
    Column("content", LargeBinary, nullable=False),
)

airframes = Table(
    "airframes",
    metadata,
    _part_of("monitors"),
    Column("created", String(27), nullable=False),
    Column("by", Text, nullable=False),
    Column("digest", String(64), nullable=False),
    Column("content", LargeBinary, nullable=False),
)

jobs = Table(
    "jobs",
    metadata,
    _id(),
    Column("kind", Text, nullable=False),
    _plain("request"),
    Column("status", String(16), nullable=False, index=True),
    Column("progress", Float),
    Column("total", Float),
    Column("message", Text, nullable=False),
    _plain("result", nullable=True),
    _plain("error", nullable=True),
    _time("created", nullable=False),
    _time("started"),
    _time("ended"),
)

flights = Table(
    "flights",
    metadata,
    _id(),
    _plain("source"),
    _refers_to("monitors", "RESTRICT"),
    Column("epsilon", Float, nullable=False),
    Column("status", String(16), nullable=False, index=True),
    _time("created", nullable=False),
    _time("ended"),
    Column("exceeded_t", Float),
    _plain("exceedances", nullable=True),
    _plain("limits_held", nullable=True),
    _plain("summary", nullable=True),
    Column("keep", Boolean, nullable=False, server_default=false()),
    Column("recording_id", String(2 * ID_BYTES), index=True),
    Column("journal_digest", String(64)),
    Column("end_reason", Text),
    Index(None, "created", "id"),
)

display_monitors = Table(
    "display_monitors",
    metadata,
    _part_of("flights"),
    Column("position", Integer, primary_key=True, autoincrement=False),
    _refers_to("monitors", "RESTRICT"),
    Column("epsilon", Float, nullable=False),
)

assessment_chunks = Table(
    "assessment_chunks",
    metadata,
    _part_of("flights"),
    Column("first_seq", BigInteger, primary_key=True, autoincrement=False),
    Column("last_seq", BigInteger, nullable=False),
    Column("content", LargeBinary, nullable=False),
    _plain("reasons", nullable=True),
    Column("display", LargeBinary),
    _plain("display_reasons", nullable=True),
)

UNCOMPRESSED = DDL(
    "ALTER TABLE assessment_chunks ALTER COLUMN content SET STORAGE EXTERNAL, "
    "ALTER COLUMN display SET STORAGE EXTERNAL"
).execute_if(dialect="postgresql")
"""Doubles barely shrink, and PostgreSQL spends most of the time of a large chunk in trying."""
event.listen(assessment_chunks, "after_create", UNCOMPRESSED)

alarms = Table(
    "alarms",
    metadata,
    _id(),
    _refers_to("flights", "CASCADE", index=False),
    Column("number", Integer, nullable=False),
    Column("seq", BigInteger, nullable=False),
    Column("t", Float, nullable=False),
    Column("p_value", Float),
    Column("kind", String(16), nullable=False, server_default="risk"),
    Column("level", String(16), nullable=False, server_default="warning"),
    _plain("exceedance", nullable=True),
    Column("reason", Text),
    _plain("channels", nullable=True),
    Column("cause", String(32)),
    Column("arrived", Float),
    Column("manoeuvre", Integer),
    _time("raised", nullable=False),
    _time("acknowledged"),
    Column("by", Text),
    UniqueConstraint("flight_id", "number"),
)

flight_markers = Table(
    "flight_markers",
    metadata,
    _id(),
    _refers_to("flights", "CASCADE", index=False),
    Column("number", Integer, nullable=False),
    Column("kind", String(16), nullable=False),
    *_called(),
    Column("text", Text),
    UniqueConstraint("flight_id", "number"),
)

limit_sets = Table(
    "limit_sets",
    metadata,
    *_named(),
)

limit_set_versions = Table(
    "limit_set_versions",
    metadata,
    _part_of("limit_sets"),
    Column("version", Integer, primary_key=True, autoincrement=False),
    _time("created", nullable=False),
    Column("by", Text, nullable=False),
    Column("text", Text),
    _plain("cases"),
)

flight_limits = Table(
    "flight_limits",
    metadata,
    _part_of("flights"),
    Column("number", Integer, primary_key=True, autoincrement=False),
    _refers_to("limit_sets", "RESTRICT"),
    Column("version", Integer, nullable=False),
    _plain("fixed"),
    *_called(),
)

monitor_sets = Table(
    "monitor_sets",
    metadata,
    *_named(),
    Column("by", Text, nullable=False),
    Column("text", Text),
)

monitor_set_cases = Table(
    "monitor_set_cases",
    metadata,
    _part_of("monitor_sets"),
    Column("position", Integer, primary_key=True, autoincrement=False),
    Column("name", Text, nullable=False),
    _plain("ranges"),
    _refers_to("monitors", "RESTRICT"),
)

flight_monitor_sets = Table(
    "flight_monitor_sets",
    metadata,
    _part_of("flights"),
    _refers_to("monitor_sets", "RESTRICT"),
    _plain("fixed"),
)

recordings = Table(
    "recordings",
    metadata,
    *_named(),
    Column("complete", Boolean, nullable=False),
    Column("size", BigInteger, nullable=False),
    Column("digest", String(64), nullable=False, index=True),
    Column("format", Text, nullable=False),
    Column("aircraft", Text),
    Column("duration", Float),
    _plain("mapping"),
    Column("mapping_state", String(16), nullable=False),
    _plain("confirmed_over", nullable=True),
    _plain("proposal"),
    _plain("quality", nullable=True),
    Column("problem", Text),
    _plain("statistics"),
    Column("keep", Boolean, nullable=False, server_default=false()),
    Index(None, "created", "id"),
)

mappings = Table(
    "mappings",
    metadata,
    _id(),
    Column("aircraft", Text, nullable=False),
    Column("signature", String(64), nullable=False, index=True),
    _time("saved", nullable=False),
    _plain("mapping"),
    UniqueConstraint("aircraft", "signature"),
)

scorings = Table(
    "scorings",
    metadata,
    _id(),
    _refers_to("recordings", "CASCADE"),
    _refers_to("monitors", "RESTRICT"),
    Column("monitor_digest", String(64), nullable=False),
    Column("request_digest", String(64), nullable=False),
    Column("digest", String(64), nullable=False),
    Column("row_digest", String(64)),
    _time("created", nullable=False),
    Column("version", Text, nullable=False),
    Column("epsilon", Float, nullable=False),
    Column("lead", Float, nullable=False),
    Column("dt", Float, nullable=False),
    _plain("request"),
    _plain("mapping"),
    Column("n_samples", BigInteger, nullable=False),
    Column("start", Float, nullable=False),
    Column("end", Float, nullable=False),
    _plain("notes"),
    _plain("quality", nullable=True),
    _plain("manoeuvres"),
    _plain("outside_exceedances"),
    _plain("limits_in_force", nullable=True),
    UniqueConstraint("recording_id", "request_digest"),
)

markers = Table(
    "markers",
    metadata,
    _id(),
    _refers_to("recordings", "CASCADE"),
    _time("created", nullable=False),
    Column("kind", String(16), nullable=False),
    Column("t", Float, nullable=False),
    Column("end", Float),
    Column("text", Text, nullable=False),
)

campaigns = Table(
    "campaigns",
    metadata,
    *_named(),
    _time("changed", nullable=False),
    Column("revision", Integer, nullable=False),
    _plain("content"),
)

answers = Table(
    "answers",
    metadata,
    Column("path", Text, primary_key=True),
    Column("key", Text, primary_key=True),
    Column("created", String(27), nullable=False, index=True),
    Column("fingerprint", String(64), nullable=False),
    Column("status", Integer),
    _plain("headers", nullable=True),
    Column("body", LargeBinary),
)

tokens = Table(
    "tokens",
    metadata,
    _id(),
    Column("name", Text, nullable=False),
    Column("role", String(16), nullable=False),
    Column("digest", String(64), nullable=False, unique=True),
    _time("created", nullable=False),
    _time("expires"),
    _time("revoked"),
    _time("last_used"),
    Column("link", String(64)),
    _time("link_expires"),
)

sessions = Table(
    "sessions",
    metadata,
    Column("digest", String(64), primary_key=True),
    Column("token", String(64), nullable=False),
    Column("ends", Float, nullable=False),
)

audit = Table(
    "audit",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("time", String(27), nullable=False, index=True),
    Column("who", Text, nullable=False),
    Column("role", String(16), nullable=False),
    Column("address", Text, nullable=False),
    Column("method", String(16), nullable=False),
    Column("path", Text, nullable=False),
    Column("status", Integer, nullable=False),
)
