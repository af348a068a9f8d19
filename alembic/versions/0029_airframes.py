"""Aircraft of the users' own, for the scenes of a monitor."""

from alembic import op

from app.store.tables import airframes

revision = "0029"
down_revision = "0028"


def upgrade() -> None:
    """A new table only; a database of 0.1.0 has it from a migration before."""
    airframes.create(op.get_bind(), checkfirst=True)
