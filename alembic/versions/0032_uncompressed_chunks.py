"""PostgreSQL stores assessments as they are, without trying to compress them."""

from alembic import op

from app.store.tables import UNCOMPRESSED

revision = "0032"
down_revision = "0031"


def upgrade() -> None:
    if op.get_bind().dialect.name == "postgresql":
        op.execute(UNCOMPRESSED)
