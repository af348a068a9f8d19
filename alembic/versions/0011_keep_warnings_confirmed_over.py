"""Keep the warnings that a mapping was confirmed over.

Why: a mapping that a person confirmed although the program warned stays marked as such. Of those
confirmed before it is not known, and null.
"""

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"


def upgrade() -> None:
    """Of mappings confirmed before, it is not known."""
    op.add_column("recordings", sa.Column("confirmed_over", sa.JSON))


def downgrade() -> None:
    """Forget them."""
    with op.batch_alter_table("recordings") as table:
        table.drop_column("confirmed_over")
