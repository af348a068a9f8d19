"""Name by the field's words which manoeuvres of a recording were asked to be scored.

Why: manoeuvres are detected, and the entire recording is scored as one, in requests as in words.
"""

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"

WORDS = {"found": "detected", "whole": "entire"}


def upgrade() -> None:
    """Rename; every row stays."""
    _rename(WORDS)


def downgrade() -> None:
    """Rename back; every row stays."""
    _rename({new: old for old, new in WORDS.items()})


def _rename(words: dict[str, str]) -> None:
    connection = op.get_bind()
    table = sa.table("scorings", sa.column("id"), sa.column("request", sa.JSON))
    for row_id, request in connection.execute(sa.select(table.c.id, table.c.request)).all():
        marked = request.get("manoeuvres")
        if isinstance(marked, str):
            change = {"request": request | {"manoeuvres": words.get(marked, marked)}}
            connection.execute(table.update().where(table.c.id == row_id).values(**change))
