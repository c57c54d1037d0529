"""Creates the tables of secrets, people, visitors and played episodes."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    op.create_table(
        "secrets",
        sa.Column("name", sa.String(40), primary_key=True),
        sa.Column("value", sa.String(200), nullable=False),
    )
    op.create_table(
        "people",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("name", sa.String(80), nullable=False, unique=True),
        sa.Column("role", sa.String(20), nullable=False),
        sa.Column("token_hash", sa.String(64), unique=True),
        sa.Column("created", sa.DateTime(timezone=True), nullable=False),
    )
    op.create_table(
        "visitors",
        sa.Column("id", sa.String(43), primary_key=True),
        sa.Column("nickname", sa.String(40)),
        sa.Column("person_id", sa.Integer, sa.ForeignKey("people.id")),
        sa.Column("created", sa.DateTime(timezone=True), nullable=False),
    )
    op.create_table(
        "played_episodes",
        sa.Column("id", sa.String(22), primary_key=True),
        sa.Column("visitor_id", sa.String(43), sa.ForeignKey("visitors.id"), nullable=False, index=True),
        sa.Column("corpus", sa.String(500), nullable=False),
        sa.Column("configuration", sa.String(40), nullable=False),
        sa.Column("split", sa.String(10), nullable=False),
        sa.Column("rules", sa.String(20), nullable=False),
        sa.Column("strict", sa.Boolean, nullable=False),
        sa.Column("task_id", sa.String(200), nullable=False),
        sa.Column("actions", sa.JSON, nullable=False),
        sa.Column("reward", sa.Float, nullable=False),
        sa.Column("outcome", sa.String(20), index=True),
        sa.Column("shown_solution", sa.Boolean, nullable=False),
        sa.Column("created", sa.DateTime(timezone=True), nullable=False),
        sa.Column("changed", sa.DateTime(timezone=True), nullable=False),
    )
