"""From the schema of version 0.1.0 to the first one of 0.2.0."""

from collections.abc import Callable
from typing import Any

import sqlalchemy as sa
from alembic import op

from app.store.tables import metadata

revision = "0024"
down_revision = "0005"

RECIPES = {"datasets": "recipe", "monitors": "dataset_recipe"}
RENAMED_COLUMNS = {
    "order": "request",
    "order_digest": "request_digest",
    "stretches": "manoeuvres",
    "outside": "outside_exceedances",
}
RENAMED_KEYS = {
    "crossing": "exceedance",
    "spans": "faults",
    "offset": "bias",
    "guesses": "rationales",
    "lead_in": "trim_segment",
}
RENAMED_CHOICES = {
    "trim": {"lead_in": "trim_segment"},
    "manoeuvres": {"found": "detected", "whole": "entire"},
}
NEW_COLUMNS: dict[str, tuple[sa.Column[Any], ...]] = {
    "alarms": (
        # every alarm of 0.1.0 is a warning of a risk
        sa.Column("kind", sa.String(16), nullable=False, server_default="risk"),
        sa.Column("level", sa.String(16), nullable=False, server_default="warning"),
        sa.Column("exceedance", sa.JSON),
        sa.Column("reason", sa.Text),
    ),
    "assessment_chunks": (
        sa.Column("display", sa.LargeBinary),
        sa.Column("display_reasons", sa.JSON),
    ),
    "flights": (
        sa.Column("exceeded_t", sa.Float),
        sa.Column("keep", sa.Boolean, nullable=False, server_default=sa.false()),
        sa.Column("recording_id", sa.String(12)),
        sa.Column("exceedances", sa.JSON),
        sa.Column("limits_held", sa.JSON),
    ),
    "recordings": (
        sa.Column("confirmed_over", sa.JSON),
        sa.Column("keep", sa.Boolean, nullable=False, server_default=sa.false()),
    ),
    "scorings": (
        sa.Column("row_digest", sa.String(64)),
        sa.Column("limits_in_force", sa.JSON),
    ),
}


def upgrade() -> None:
    """Change the tables of 0.1.0 and add the new ones; every row stays."""
    rename_columns_of_scorings()
    # the new tables; a later migration that changes one must write it out here as it is now
    metadata.create_all(op.get_bind())
    copy_channel_maps()
    for table, columns in NEW_COLUMNS.items():
        for column in columns:
            op.add_column(table, column)
    op.create_index("ix_flights_recording_id", "flights", ["recording_id"])
    copy_specifications()
    rename_inside_json()


def rename_columns_of_scorings() -> None:
    with op.batch_alter_table("scorings") as table:
        table.drop_constraint("uq_scorings_recording_id_order_digest", type_="unique")
    for old, new in RENAMED_COLUMNS.items():
        op.alter_column("scorings", old, new_column_name=new)
    with op.batch_alter_table("scorings") as table:
        unique = ["recording_id", "request_digest"]
        table.create_unique_constraint("uq_scorings_recording_id_request_digest", unique)


def copy_channel_maps() -> None:
    """Copy the rows: indices and constraints are named after their table."""
    columns = "id, aircraft, signature, saved, mapping"
    op.execute(f"INSERT INTO mappings ({columns}) SELECT {columns} FROM channel_maps")
    op.drop_table("channel_maps")


def copy_specifications() -> None:
    """Limits stand beside the recipe too; unknown where the recipe does not give them."""
    connection = op.get_bind()
    for name, recipe in RECIPES.items():
        op.add_column(name, sa.Column("specification", sa.JSON))
        columns = sa.column("id"), sa.column(recipe, sa.JSON), sa.column("specification", sa.JSON)
        table = sa.table(name, *columns)
        for row in connection.execute(sa.select(table.c.id, table.c[recipe])).all():
            known = row[1].get("specification") or sa.null()
            change = table.update().where(table.c.id == row.id)
            connection.execute(change.values(specification=known))


def rename_inside_json() -> None:
    renames: dict[str, dict[str, Callable[[Any], Any]]] = {
        "recordings": {"mapping": in_mapping, "proposal": in_keys, "quality": in_keys},
        "mappings": {"mapping": in_mapping},
        "scorings": {
            "mapping": in_mapping,
            "quality": in_keys,
            "request": in_request,
            "manoeuvres": lambda manoeuvres: [in_keys(plain) for plain in manoeuvres],
        },
    }
    connection = op.get_bind()
    for name, columns in renames.items():
        json = [sa.column(column, sa.JSON(none_as_null=True)) for column in columns]
        table = sa.table(name, sa.column("id"), *json)
        for (row_id,) in connection.execute(sa.select(table.c.id)).all():
            row = connection.execute(sa.select(table).where(table.c.id == row_id)).mappings().one()
            change = {
                column: rename(row[column])
                for column, rename in columns.items()
                if row[column] is not None
            }
            connection.execute(table.update().where(table.c.id == row_id).values(**change))


def in_keys(plain: dict[str, Any]) -> dict[str, Any]:
    return {RENAMED_KEYS.get(key, key): value for key, value in plain.items()}


def in_mapping(mapping: dict[str, Any]) -> dict[str, Any]:
    channels = {key: in_keys(entry) for key, entry in mapping.get("channels", {}).items()}
    return mapping | ({"channels": channels} if channels else {})


def in_request(request: dict[str, Any]) -> dict[str, Any]:
    choices = {
        key: words.get(request[key], request[key])
        for key, words in RENAMED_CHOICES.items()
        if isinstance(request.get(key), str)
    }
    return request | choices
