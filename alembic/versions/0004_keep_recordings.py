"""Keep recordings, the mapping of their channels, scorings and markers.

Why: a score is trusted only with what it was made of: the file by its digest, the mapping, the
monitor by its digest. Files, columns and samples lie in the data directory, since they may be
larger than a database should be; `complete` is set once a recording's folder is whole and taken
back before it goes, so that no row promises content that is not there.
"""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"


def upgrade() -> None:
    """Make the four tables."""
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


def downgrade() -> None:
    """Forget recordings; their folders stay."""
    for table in ("markers", "scorings", "channel_maps", "recordings"):
        op.drop_table(table)
