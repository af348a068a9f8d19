"""Keep of each scoring a digest of all that it says of its recording.

Why: its samples had one, but not its verdicts. Of scorings stored before there is none: they are
read as before. A migration that changes what a scoring says must set it anew, or to null.
"""

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"


def upgrade() -> None:
    """Scorings stored before have none."""
    op.add_column("scorings", sa.Column("row_digest", sa.String(64)))


def downgrade() -> None:
    """Forget them."""
    with op.batch_alter_table("scorings") as table:
        table.drop_column("row_digest")
