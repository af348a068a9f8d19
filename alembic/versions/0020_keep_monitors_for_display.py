"""Keep the monitors that a flight is shown by beside the one that raises its alarms.

Why: several warning lead times are watched at once, and a record shows what was shown.
"""

import sqlalchemy as sa
from alembic import op

revision = "0020"
down_revision = "0019"


def upgrade() -> None:
    """Add the table and the columns; the flights so far have one monitor each."""
    op.create_table(
        "display_monitors",
        sa.Column(
            "flight_id",
            sa.String(12),
            sa.ForeignKey("flights.id", ondelete="CASCADE"),
            primary_key=True,
        ),
        sa.Column("position", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column(
            "monitor_id",
            sa.String(12),
            sa.ForeignKey("monitors.id", ondelete="RESTRICT"),
            nullable=False,
        ),
        sa.Column("epsilon", sa.Float, nullable=False),
    )
    op.create_index("ix_display_monitors_monitor_id", "display_monitors", ["monitor_id"])
    op.add_column("assessment_chunks", sa.Column("display", sa.LargeBinary))
    op.add_column("assessment_chunks", sa.Column("display_reasons", sa.JSON))


def downgrade() -> None:
    """Drop them."""
    op.drop_column("assessment_chunks", "display_reasons")
    op.drop_column("assessment_chunks", "display")
    op.drop_table("display_monitors")
