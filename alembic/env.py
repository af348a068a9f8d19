"""Run migrations in the program's transaction, or from the command line.

`alembic check` and `alembic revision --autogenerate`, from the repository's root, compare the
database of the settings, or of `-x url=forewarn.db`, with the tables.
"""

from alembic import context
from sqlalchemy import Connection

from app.settings import read_settings
from app.store.database import address
from app.store.schema import migrating
from app.store.tables import metadata


def migrate(connection: Connection) -> None:
    """Run the requested migrations in the connection's transaction."""
    context.configure(connection=connection, target_metadata=metadata, render_as_batch=True)
    with context.begin_transaction():
        context.run_migrations()


current = context.config.attributes.get("connection")
if current is not None:
    migrate(current)
else:
    url = context.get_x_argument(as_dictionary=True).get("url")
    with migrating(address(str(url or read_settings().url))) as connection:
        migrate(connection)
