"""Episodes of people, as the browser keeps them."""

import pytest


def save_played(path, *rows, **fields):
    """Saves rows of a new database with ids 0, 1, ...; `fields`: what they have in common."""
    database = pytest.importorskip("lilgym_mp.contrib.web.database")
    with database.Database(path).write() as connection:
        for index, row in enumerate(rows):
            database.save_episode(connection, database.PlayedEpisode(id=str(index), **fields, **row))
