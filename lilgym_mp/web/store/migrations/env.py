"""Alembic environment: runs the migrations on the connection passed in the configuration's attributes."""

from alembic import context

from lilgym_mp.web.store.models import Base

context.configure(connection=context.config.attributes["connection"], target_metadata=Base.metadata)
with context.begin_transaction():
    context.run_migrations()
