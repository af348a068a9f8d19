"""Name by the field's words which manoeuvres of a recording were asked to be scored.

Why: manoeuvres are detected, and the entire recording is scored as one, in requests as in words.
A digest of what was said before does not fit any more and is forgotten.
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
    columns = sa.column("id"), sa.column("request", sa.JSON), sa.column("row_digest")
    table = sa.table("scorings", *columns)
    for row_id, request in connection.execute(sa.select(table.c.id, table.c.request)).all():
        marked = request.get("manoeuvres")
        if isinstance(marked, str):
            renamed = request | {"manoeuvres": words.get(marked, marked)}
            change = table.update().where(table.c.id == row_id)
            connection.execute(change.values(request=renamed, row_digest=None))
