"""Why a flight ended, and the channels that an alarm is about."""

import sqlalchemy as sa
from alembic import op

revision = "0033"
down_revision = "0032"


def upgrade() -> None:
    op.add_column("flights", sa.Column("end_reason", sa.Text))
    op.add_column("alarms", sa.Column("channels", sa.JSON))
