"""Name what is stored of recordings and scorings by the field's words.

Why: a limit is exceeded, a sensor has a bias, a recording has faults, a proposal its rationales,
and trim is the mean of a trim segment, in the database as in the code and on the wire. Samples are
not touched, so their digests stay true.
"""

from collections.abc import Callable
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"

Rename = Callable[[Any, dict[str, str]], Any]
WORDS = {
    "crossing": "exceedance",
    "spans": "faults",
    "offset": "bias",
    "guesses": "rationales",
    "lead_in": "trim_segment",
}
OUTSIDE = "outside", "outside_exceedances"


def _mapping(mapping: Any, words: dict[str, str]) -> Any:
    channels = {key: _named(entry, words) for key, entry in mapping.get("channels", {}).items()}
    return mapping | ({"channels": channels} if channels else {})


def _request(request: Any, words: dict[str, str]) -> Any:
    trim = request.get("trim")
    return request | {"trim": words.get(trim, trim)} if isinstance(trim, str) else request


def _manoeuvres(manoeuvres: Any, words: dict[str, str]) -> Any:
    return [_named(manoeuvre, words) for manoeuvre in manoeuvres]


def _named(plain: Any, words: dict[str, str]) -> Any:
    return {words.get(key, key): value for key, value in plain.items()}


RENAMES: dict[str, dict[str, Rename]] = {
    "recordings": {"mapping": _mapping, "proposal": _named, "quality": _named},
    "mappings": {"mapping": _mapping},
    "scorings": {
        "mapping": _mapping,
        "quality": _named,
        "request": _request,
        "manoeuvres": _manoeuvres,
    },
}


def upgrade() -> None:
    """Rename; every row stays."""
    op.alter_column("scorings", OUTSIDE[0], new_column_name=OUTSIDE[1])
    _rename(WORDS)


def downgrade() -> None:
    """Rename back; every row stays."""
    _rename({new: old for old, new in WORDS.items()})
    op.alter_column("scorings", OUTSIDE[1], new_column_name=OUTSIDE[0])


def _rename(words: dict[str, str]) -> None:
    connection = op.get_bind()
    for name, columns in RENAMES.items():
        json = [sa.column(column, sa.JSON(none_as_null=True)) for column in columns]
        table = sa.table(name, sa.column("id"), *json)
        for (row_id,) in connection.execute(sa.select(table.c.id)).all():
            this = table.c.id == row_id
            row = connection.execute(sa.select(table).where(this)).mappings().one()
            change = {
                column: rename(row[column], words)
                for column, rename in columns.items()
                if row[column] is not None
            }
            connection.execute(table.update().where(this).values(**change))
