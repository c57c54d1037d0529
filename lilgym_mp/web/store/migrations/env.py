"""What Alembic runs: the migrations on the connection it is given."""

from alembic import context

from lilgym_mp.web.store.models import Table

context.configure(connection=context.config.attributes["connection"], target_metadata=Table.metadata)
with context.begin_transaction():
    context.run_migrations()
