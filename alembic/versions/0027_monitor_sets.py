"""Monitor sets, and the flights that use one."""

from alembic import op

from app.store.tables import flight_monitor_sets, monitor_set_cases, monitor_sets

revision = "0027"
down_revision = "0026"


def upgrade() -> None:
    """New tables only; a database of 0.1.0 has them from the migration before."""
    for table in (monitor_sets, monitor_set_cases, flight_monitor_sets):
        table.create(op.get_bind(), checkfirst=True)
