"""Keep flights: every assessment in chunks, and alarms with their acknowledgement.

Why: what the crew was told must be there to replay, to backfill a display that reconnects, and to
report. A row for each sample costs a hundred times a chunk's share.
"""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Make the three tables."""
    op.create_table(
        "flights",
        sa.Column("id", sa.String(12), primary_key=True),
        sa.Column("source", sa.JSON, nullable=False),
        sa.Column(
            "monitor_id",
            sa.String(12),
            sa.ForeignKey("monitors.id", ondelete="RESTRICT"),
            nullable=False,
            index=True,
        ),
        sa.Column("epsilon", sa.Float, nullable=False),
        sa.Column("status", sa.String(16), nullable=False, index=True),
        sa.Column("created", sa.String(27), nullable=False),
        sa.Column("ended", sa.String(27)),
    )
    op.create_table(
        "assessment_chunks",
        sa.Column(
            "flight_id",
            sa.String(12),
            sa.ForeignKey("flights.id", ondelete="CASCADE"),
            primary_key=True,
        ),
        sa.Column("first_seq", sa.BigInteger, primary_key=True, autoincrement=False),
        sa.Column("last_seq", sa.BigInteger, nullable=False),
        sa.Column("content", sa.LargeBinary, nullable=False),
    )
    op.create_table(
        "alarms",
        sa.Column("id", sa.String(12), primary_key=True),
        sa.Column(
            "flight_id",
            sa.String(12),
            sa.ForeignKey("flights.id", ondelete="CASCADE"),
            nullable=False,
        ),
        sa.Column("number", sa.Integer, nullable=False),
        sa.Column("seq", sa.BigInteger, nullable=False),
        sa.Column("t", sa.Float, nullable=False),
        sa.Column("p_value", sa.Float),
        sa.Column("raised", sa.String(27), nullable=False),
        sa.Column("acknowledged", sa.String(27)),
        sa.Column("by", sa.Text),
        sa.UniqueConstraint("flight_id", "number"),
    )


def downgrade() -> None:
    """Forget flights."""
    for table in ("alarms", "assessment_chunks", "flights"):
        op.drop_table(table)
