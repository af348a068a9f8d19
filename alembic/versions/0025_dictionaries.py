"""Datasets and monitors of other channels than the six lateral ones."""

import sqlalchemy as sa
from alembic import op

revision = "0025"
down_revision = "0024"


def upgrade() -> None:
    """Existing rows have the lateral channels, which are stored as null."""
    for table in ("datasets", "monitors"):
        op.add_column(table, sa.Column("dictionary", sa.JSON))
