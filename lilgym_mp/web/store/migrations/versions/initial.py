"""Creates all tables as the models describe them.

The first release replaces this by the operations that create them, so that later models do not change it.
"""

from alembic import op

from lilgym_mp.web.store.models import Base

revision = "initial"
down_revision = None


def upgrade() -> None:
    Base.metadata.create_all(op.get_bind())
