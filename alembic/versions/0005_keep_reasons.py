"""Keep why samples of a flight were not assessed, where their state alone does not say it.

Why: a monitor's word may be withdrawn, or a replayed recording lie between its manoeuvres. A record
that called such samples "not finite" would tell another story than the crew was told.
"""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"


def upgrade() -> None:
    """Add the reasons, run by run."""
    op.add_column("assessment_chunks", sa.Column("reasons", sa.JSON))


def downgrade() -> None:
    """Forget the reasons."""
    with op.batch_alter_table("assessment_chunks") as table:
        table.drop_column("reasons")
