"""Persistence: ORM models, schema migrations, and database access."""
