"""Keep of each alarm its kind, its level, and the exceedance that raised it.

Why: a measured exceedance is an alarm of its own. Every alarm before was of a risk above its
threshold, which asked for action: a warning.
"""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"


def upgrade() -> None:
    """What is stored are warnings of a risk."""
    for name, value in (("kind", "risk"), ("level", "warning")):
        column = sa.Column(name, sa.String(16), nullable=False, server_default=value)
        op.add_column("alarms", column)
    op.add_column("alarms", sa.Column("exceedance", sa.JSON))


def downgrade() -> None:
    """Forget them; an exceedance is then an alarm as any other."""
    with op.batch_alter_table("alarms") as table:
        for name in ("kind", "level", "exceedance"):
            table.drop_column(name)
