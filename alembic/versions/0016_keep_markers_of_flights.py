"""Keep what was called in a flight: ABORT and KNOCK IT OFF, when and by whom.

Why: the record of a flight says that it was stopped, and for what.
"""

import sqlalchemy as sa
from alembic import op

revision = "0016"
down_revision = "0015"


def upgrade() -> None:
    """Make the table."""
    op.create_table(
        "flight_markers",
        sa.Column("id", sa.String(12), primary_key=True),
        sa.Column(
            "flight_id",
            sa.String(12),
            sa.ForeignKey("flights.id", ondelete="CASCADE"),
            nullable=False,
        ),
        sa.Column("number", sa.Integer, nullable=False),
        sa.Column("kind", sa.String(16), nullable=False),
        sa.Column("seq", sa.BigInteger, nullable=False),
        sa.Column("t", sa.Float, nullable=False),
        sa.Column("created", sa.String(27), nullable=False),
        sa.Column("by", sa.Text, nullable=False),
        sa.Column("text", sa.Text),
        sa.UniqueConstraint("flight_id", "number"),
    )


def downgrade() -> None:
    """Forget them."""
    op.drop_table("flight_markers")
