"""What the server keeps: tables, their migrations, and the one way to a database."""

from lilgym_mp.web.store.database import Database, DatabaseError, open_database

__all__ = ["Database", "DatabaseError", "open_database"]
