"""The schema of version 0.1.0."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = None


def upgrade() -> None:
    """Make the tables."""
    op.create_table(
        "datasets",
        sa.Column("id", sa.String(12), primary_key=True),
        sa.Column("name", sa.Text, nullable=False),
        sa.Column("created", sa.String(27), nullable=False),
        sa.Column("complete", sa.Boolean, nullable=False),
        sa.Column("digest", sa.String(64), nullable=False, index=True),
        sa.Column("seed", sa.String),
        sa.Column("version", sa.Text, nullable=False),
        sa.Column("recipe", sa.JSON, nullable=False),
        sa.Column("dt", sa.Float, nullable=False),
        sa.Column("n_unsafe", sa.Integer, nullable=False),
        sa.Column("n_safe", sa.Integer, nullable=False),
        sa.Column("n_safe_met", sa.BigInteger, nullable=False),
        sa.Column("n_samples", sa.Integer, nullable=False),
        sa.Column("n_obs", sa.Integer, nullable=False),
        sa.Column("unsafe_rate", sa.Float),
        sa.Column("theta_names", sa.JSON, nullable=False),
        sa.Column("peaks", sa.JSON, nullable=False),
    )
    op.create_table(
        "dataset_blocks",
        sa.Column(
            "dataset_id",
            sa.String(12),
            sa.ForeignKey("datasets.id", ondelete="CASCADE"),
            primary_key=True,
        ),
        sa.Column("name", sa.String(16), primary_key=True),
        sa.Column("first_row", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("content", sa.LargeBinary, nullable=False),
    )
    op.create_table(
        "monitors",
        sa.Column("id", sa.String(12), primary_key=True),
        sa.Column("name", sa.Text, nullable=False),
        sa.Column("created", sa.String(27), nullable=False),
        sa.Column("complete", sa.Boolean, nullable=False),
        sa.Column("digest", sa.String(64), nullable=False),
        sa.Column(
            "dataset_id",
            sa.String(12),
            sa.ForeignKey("datasets.id", ondelete="RESTRICT"),
            index=True,
        ),
        sa.Column("dataset_digest", sa.String(64), nullable=False),
        sa.Column("dataset_recipe", sa.JSON, nullable=False),
        sa.Column("recipe", sa.JSON, nullable=False),
        sa.Column("seed", sa.String),
        sa.Column("version", sa.Text, nullable=False),
        sa.Column("dt", sa.Float, nullable=False),
        sa.Column("h", sa.Integer, nullable=False),
        sa.Column("lead", sa.Float, nullable=False),
        sa.Column("n_unsafe", sa.Integer, nullable=False),
        sa.Column("n_early", sa.Integer, nullable=False),
        sa.Column("smallest_epsilon", sa.Float, nullable=False),
        sa.Column("epsilon", sa.Float, nullable=False),
        sa.Column("evaluation", sa.JSON),
    )
    op.create_table(
        "monitor_parts",
        sa.Column(
            "monitor_id",
            sa.String(12),
            sa.ForeignKey("monitors.id", ondelete="CASCADE"),
            primary_key=True,
        ),
        sa.Column("part", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("content", sa.LargeBinary, nullable=False),
    )
    op.create_table(
        "jobs",
        sa.Column("id", sa.String(12), primary_key=True),
        sa.Column("kind", sa.Text, nullable=False),
        sa.Column("request", sa.JSON, nullable=False),
        sa.Column("status", sa.String(16), nullable=False, index=True),
        sa.Column("progress", sa.Float),
        sa.Column("total", sa.Float),
        sa.Column("message", sa.Text, nullable=False),
        sa.Column("result", sa.JSON),
        sa.Column("error", sa.JSON),
        sa.Column("created", sa.String(27), nullable=False),
        sa.Column("started", sa.String(27)),
        sa.Column("ended", sa.String(27)),
    )
    op.create_table(
        "flights",
        sa.Column("id", sa.String(12), primary_key=True),
        sa.Column("source", sa.JSON, nullable=False),
        sa.Column(
            "monitor_id",
            sa.String(12),
            sa.ForeignKey("monitors.id", ondelete="RESTRICT"),
            nullable=False,
            index=True,
        ),
        sa.Column("epsilon", sa.Float, nullable=False),
        sa.Column("status", sa.String(16), nullable=False, index=True),
        sa.Column("created", sa.String(27), nullable=False),
        sa.Column("ended", sa.String(27)),
    )
    op.create_table(
        "assessment_chunks",
        sa.Column(
            "flight_id",
            sa.String(12),
            sa.ForeignKey("flights.id", ondelete="CASCADE"),
            primary_key=True,
        ),
        sa.Column("first_seq", sa.BigInteger, primary_key=True, autoincrement=False),
        sa.Column("last_seq", sa.BigInteger, nullable=False),
        sa.Column("content", sa.LargeBinary, nullable=False),
        sa.Column("reasons", sa.JSON),
    )
    op.create_table(
        "alarms",
        sa.Column("id", sa.String(12), primary_key=True),
        sa.Column(
            "flight_id",
            sa.String(12),
            sa.ForeignKey("flights.id", ondelete="CASCADE"),
            nullable=False,
        ),
        sa.Column("number", sa.Integer, nullable=False),
        sa.Column("seq", sa.BigInteger, nullable=False),
        sa.Column("t", sa.Float, nullable=False),
        sa.Column("p_value", sa.Float),
        sa.Column("raised", sa.String(27), nullable=False),
        sa.Column("acknowledged", sa.String(27)),
        sa.Column("by", sa.Text),
        sa.UniqueConstraint("flight_id", "number"),
    )
    op.create_table(
        "recordings",
        sa.Column("id", sa.String(12), primary_key=True),
        sa.Column("name", sa.Text, nullable=False),
        sa.Column("created", sa.String(27), nullable=False),
        sa.Column("complete", sa.Boolean, nullable=False),
        sa.Column("size", sa.BigInteger, nullable=False),
        sa.Column("digest", sa.String(64), nullable=False, index=True),
        sa.Column("format", sa.Text, nullable=False),
        sa.Column("aircraft", sa.Text),
        sa.Column("duration", sa.Float),
        sa.Column("mapping", sa.JSON, nullable=False),
        sa.Column("mapping_state", sa.String(16), nullable=False),
        sa.Column("proposal", sa.JSON, nullable=False),
        sa.Column("quality", sa.JSON),
        sa.Column("problem", sa.Text),
        sa.Column("statistics", sa.JSON, nullable=False),
    )
    op.create_table(
        "channel_maps",
        sa.Column("id", sa.String(12), primary_key=True),
        sa.Column("aircraft", sa.Text, nullable=False),
        sa.Column("signature", sa.String(64), nullable=False, index=True),
        sa.Column("saved", sa.String(27), nullable=False),
        sa.Column("mapping", sa.JSON, nullable=False),
        sa.UniqueConstraint("aircraft", "signature"),
    )
    op.create_table(
        "scorings",
        sa.Column("id", sa.String(12), primary_key=True),
        _refers_to("recording", "CASCADE"),
        _refers_to("monitor", "RESTRICT"),
        sa.Column("monitor_digest", sa.String(64), nullable=False),
        sa.Column("order_digest", sa.String(64), nullable=False),
        sa.Column("digest", sa.String(64), nullable=False),
        sa.Column("created", sa.String(27), nullable=False),
        sa.Column("version", sa.Text, nullable=False),
        sa.Column("epsilon", sa.Float, nullable=False),
        sa.Column("lead", sa.Float, nullable=False),
        sa.Column("dt", sa.Float, nullable=False),
        sa.Column("order", sa.JSON, nullable=False),
        sa.Column("mapping", sa.JSON, nullable=False),
        sa.Column("n_samples", sa.BigInteger, nullable=False),
        sa.Column("start", sa.Float, nullable=False),
        sa.Column("end", sa.Float, nullable=False),
        sa.Column("notes", sa.JSON, nullable=False),
        sa.Column("quality", sa.JSON),
        sa.Column("stretches", sa.JSON, nullable=False),
        sa.Column("outside", sa.JSON, nullable=False),
        sa.UniqueConstraint("recording_id", "order_digest"),
    )
    op.create_table(
        "markers",
        sa.Column("id", sa.String(12), primary_key=True),
        _refers_to("recording", "CASCADE"),
        sa.Column("created", sa.String(27), nullable=False),
        sa.Column("kind", sa.String(16), nullable=False),
        sa.Column("t", sa.Float, nullable=False),
        sa.Column("end", sa.Float),
        sa.Column("text", sa.Text, nullable=False),
    )


def _refers_to(what: str, ondelete: str) -> sa.Column[str]:
    row = sa.ForeignKey(f"{what}s.id", ondelete=ondelete)
    return sa.Column(f"{what}_id", sa.String(12), row, nullable=False, index=True)
