"""What was found implausible in flights that a dataset was made of."""

import sqlalchemy as sa
from alembic import op

revision = "0026"
down_revision = "0025"


def upgrade() -> None:
    """Existing datasets were simulated here, without findings."""
    op.add_column("datasets", sa.Column("findings", sa.JSON))
