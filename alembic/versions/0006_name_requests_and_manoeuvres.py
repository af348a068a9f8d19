"""Name the columns of a scoring, and the table of mappings, by the field's words.

Why: what was asked for is a request, each part that was scored is a manoeuvre, and what says which
signal is which channel is a mapping, in the code, the pages and the database alike.
"""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"

WORDS = {"order": "request", "order_digest": "request_digest", "stretches": "manoeuvres"}
TABLES = "channel_maps", "mappings"
COLUMNS = "id", "aircraft", "signature", "saved", "mapping"


def upgrade() -> None:
    """Rename; every row stays."""
    _rename_columns(WORDS)
    _rename_table(*TABLES)


def downgrade() -> None:
    """Rename back; every row stays."""
    _rename_columns({new: old for old, new in WORDS.items()})
    _rename_table(*reversed(TABLES))


def _rename_columns(names: dict[str, str]) -> None:
    digest = next(name for name in names if name.endswith("_digest"))
    with op.batch_alter_table("scorings") as table:
        table.drop_constraint(f"uq_scorings_recording_id_{digest}", type_="unique")
    for old, new in names.items():
        op.alter_column("scorings", old, new_column_name=new)
    with op.batch_alter_table("scorings") as table:
        unique = ["recording_id", names[digest]]
        table.create_unique_constraint(f"uq_scorings_{'_'.join(unique)}", unique)


def _rename_table(old: str, new: str) -> None:
    """Copy the rows, so that indices and constraints are named after their table."""
    op.create_table(
        new,
        sa.Column("id", sa.String(12), primary_key=True),
        sa.Column("aircraft", sa.Text, nullable=False),
        sa.Column("signature", sa.String(64), nullable=False, index=True),
        sa.Column("saved", sa.String(27), nullable=False),
        sa.Column("mapping", sa.JSON, nullable=False),
        sa.UniqueConstraint("aircraft", "signature"),
    )
    columns = ", ".join(COLUMNS)
    op.execute(f"INSERT INTO {new} ({columns}) SELECT {columns} FROM {old}")
    op.drop_table(old)
