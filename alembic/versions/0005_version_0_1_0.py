"""The schema of version 0.1.0, from which migrations start; new databases need none."""

revision = "0005"
down_revision = None


def upgrade() -> None:
    raise NotImplementedError("open a new database with Forewarn, which creates its tables")
