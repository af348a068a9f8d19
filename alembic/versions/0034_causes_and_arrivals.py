"""Of an alarm: why a monitor was not applicable, when its sample arrived, and its manoeuvre."""

import sqlalchemy as sa
from alembic import op

revision = "0034"
down_revision = "0033"


def upgrade() -> None:
    op.add_column("alarms", sa.Column("cause", sa.String(32)))
    op.add_column("alarms", sa.Column("arrived", sa.Float))
    op.add_column("alarms", sa.Column("manoeuvre", sa.Integer))
