"""Keep datasets and monitors.

Why: a monitor's guarantee holds for what it was trained on, so both are kept with recipe, seed,
digest and program version, and a dataset stays as long as a monitor needs it. Arrays and monitor
files lie in parts, so that a large one blocks no other writer for long; `complete` is set last.
"""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Make the four tables."""
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


def downgrade() -> None:
    """Forget datasets and monitors."""
    for table in ("monitor_parts", "monitors", "dataset_blocks", "datasets"):
        op.drop_table(table)
