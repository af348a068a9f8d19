"""How migrations reach the database: in the program's transaction, or by hand.

By hand, from the repository's root: `alembic -x url=forewarn.db upgrade head`; the database of the
settings without `-x`.
"""

from alembic import context
from sqlalchemy import Connection

from app.settings import read_settings
from app.store.database import address
from app.store.schema import migrating
from app.store.tables import metadata


def migrate(connection: Connection) -> None:
    """Run what was asked for, in the transaction that the connection is in."""
    context.configure(connection=connection, target_metadata=metadata, render_as_batch=True)
    with context.begin_transaction():
        context.run_migrations()


given = context.config.attributes.get("connection")
if given is not None:
    migrate(given)
else:
    named = context.get_x_argument(as_dictionary=True).get("url")
    with migrating(address(str(named or read_settings().url))) as opened:
        migrate(opened)
