"""Keep of each caution why it was raised.

Why: a lost validity and a stale source are alarms of the level caution. Every alarm before was a
warning, which says by itself why.
"""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"


def upgrade() -> None:
    """What is stored are warnings."""
    op.add_column("alarms", sa.Column("reason", sa.Text))


def downgrade() -> None:
    """Forget the cautions, which an older program would take for warnings."""
    op.execute("DELETE FROM alarms WHERE level = 'caution'")
    with op.batch_alter_table("alarms") as table:
        table.drop_column("reason")
