"""Keep limit sets in versions, and which of them each flight was held against, from when, by whom.

Why: limits differ by flight condition and are changed in flight, and a record says which held.
"""

import sqlalchemy as sa
from alembic import op

revision = "0021"
down_revision = "0020"


def upgrade() -> None:
    """Make the tables; the flights so far were held against their monitors' limits."""
    op.create_table(
        "limit_sets",
        sa.Column("id", sa.String(12), primary_key=True),
        sa.Column("name", sa.Text, nullable=False),
        sa.Column("created", sa.String(27), nullable=False),
    )
    op.create_table(
        "limit_set_versions",
        sa.Column(
            "limit_set_id",
            sa.String(12),
            sa.ForeignKey("limit_sets.id", ondelete="CASCADE"),
            primary_key=True,
        ),
        sa.Column("version", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("created", sa.String(27), nullable=False),
        sa.Column("by", sa.Text, nullable=False),
        sa.Column("text", sa.Text),
        sa.Column("cases", sa.JSON, nullable=False),
    )
    op.create_table(
        "flight_limits",
        sa.Column(
            "flight_id",
            sa.String(12),
            sa.ForeignKey("flights.id", ondelete="CASCADE"),
            primary_key=True,
        ),
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column(
            "limit_set_id",
            sa.String(12),
            sa.ForeignKey("limit_sets.id", ondelete="RESTRICT"),
            nullable=False,
        ),
        sa.Column("version", sa.Integer, nullable=False),
        sa.Column("fixed", sa.JSON, nullable=False),
        sa.Column("seq", sa.BigInteger, nullable=False),
        sa.Column("t", sa.Float, nullable=False),
        sa.Column("created", sa.String(27), nullable=False),
        sa.Column("by", sa.Text, nullable=False),
    )
    op.create_index("ix_flight_limits_limit_set_id", "flight_limits", ["limit_set_id"])


def downgrade() -> None:
    """Forget them."""
    op.drop_table("flight_limits")
    op.drop_table("limit_set_versions")
    op.drop_table("limit_sets")
