"""Creates the annotation tables: statements, batches, assignments, submissions, reviews and tutorial answers."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def _foreign_key(name: str, target: str, *, index: bool = False) -> sa.Column[int]:
    return sa.Column(name, sa.Integer, sa.ForeignKey(target), nullable=False, index=index)


def _created() -> sa.Column[object]:
    return sa.Column("created", sa.DateTime(timezone=True), nullable=False)


def upgrade() -> None:
    op.create_table(
        "statements",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("name", sa.String(200), nullable=False, unique=True),
        sa.Column("text", sa.Text, nullable=False),
        sa.Column("appearance", sa.String(20), nullable=False),
        sa.Column("split", sa.String(10), nullable=False),
        _created(),
    )
    op.create_table(
        "statement_scenes",
        sa.Column("id", sa.Integer, primary_key=True),
        _foreign_key("statement_id", "statements.id", index=True),
        sa.Column("position", sa.Integer, nullable=False),
        sa.Column("scene", sa.JSON, nullable=False),
        sa.Column("label", sa.Boolean, nullable=False),
    )
    op.create_table(
        "batches",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("name", sa.String(80), nullable=False, unique=True),
        _created(),
    )
    op.create_table(
        "assignments",
        sa.Column("id", sa.Integer, primary_key=True),
        _foreign_key("batch_id", "batches.id", index=True),
        _foreign_key("statement_id", "statements.id", index=True),
        _foreign_key("person_id", "people.id", index=True),
        sa.Column("shown", sa.Integer, nullable=False),
        sa.Column("state", sa.String(10), nullable=False),
        sa.Column("draft", sa.Text, nullable=False),
        sa.Column("draft_version", sa.Integer, nullable=False),
        sa.Column("opened", sa.DateTime(timezone=True)),
        _created(),
        sa.UniqueConstraint("statement_id", "person_id"),
    )
    op.create_table(
        "submissions",
        sa.Column("id", sa.Integer, primary_key=True),
        _foreign_key("assignment_id", "assignments.id", index=True),
        sa.Column("key", sa.String(64), nullable=False),
        sa.Column("verdict", sa.String(10), nullable=False),
        sa.Column("program", sa.Text, nullable=False),
        sa.Column("confidence", sa.Integer),
        sa.Column("reason", sa.Text, nullable=False),
        sa.Column("comment", sa.Text, nullable=False),
        sa.Column("question", sa.Text, nullable=False),
        sa.Column("seconds", sa.Float, nullable=False),
        _created(),
        sa.UniqueConstraint("assignment_id", "key"),
    )
    op.create_table(
        "reviews",
        sa.Column("id", sa.Integer, primary_key=True),
        _foreign_key("submission_id", "submissions.id", index=True),
        _foreign_key("reviewer_id", "people.id"),
        sa.Column("verdict", sa.String(10), nullable=False),
        sa.Column("note", sa.Text, nullable=False),
        _created(),
    )
    op.create_table(
        "tutorial_answers",
        sa.Column("person_id", sa.Integer, sa.ForeignKey("people.id"), primary_key=True),
        sa.Column("task", sa.String(40), primary_key=True),
        sa.Column("program", sa.Text, nullable=False),
        _created(),
    )
