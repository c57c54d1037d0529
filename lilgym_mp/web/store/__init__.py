"""Persistence: ORM models, schema migrations, and database access."""

from lilgym_mp.web.store.database import Database, DatabaseError, open_database

__all__ = ["Database", "DatabaseError", "open_database"]
