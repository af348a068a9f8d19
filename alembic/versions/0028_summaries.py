"""What lists show of ended flights, and the order of long lists."""

import sqlalchemy as sa
from alembic import op

revision = "0028"
down_revision = "0027"


def upgrade() -> None:
    """The program summarizes flights that have ended before, when it starts."""
    op.add_column("flights", sa.Column("summary", sa.JSON))
    for table in ("flights", "recordings"):
        op.create_index(f"ix_{table}_created", table, ["created", "id"])
