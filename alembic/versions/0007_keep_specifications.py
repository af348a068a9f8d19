"""Keep what unsafe means beside each dataset and monitor, not only in the recipe behind them.

Why: a monitor is judged by its own limits. One that was trained on trajectories without a recipe
had none that could be found, and was judged by limits it never knew.
"""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
RECIPES = {"datasets": "recipe", "monitors": "dataset_recipe"}


def upgrade() -> None:
    """Take the specification from the recipe; it stays unknown where that does not say."""
    for name, recipe in RECIPES.items():
        op.add_column(name, sa.Column("specification", sa.JSON))
        table = sa.table(
            name, sa.column("id"), sa.column(recipe, sa.JSON), sa.column("specification", sa.JSON)
        )
        connection = op.get_bind()
        for row in connection.execute(sa.select(table.c.id, table.c[recipe])).all():
            known = row[1].get("specification") or sa.null()
            change = table.update().where(table.c.id == row.id).values(specification=known)
            connection.execute(change)


def downgrade() -> None:
    """Forget it; the recipes still hold it."""
    for name in RECIPES:
        with op.batch_alter_table(name) as table:
            table.drop_column("specification")
