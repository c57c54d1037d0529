"""Data files of the package: the builtin corpus and its source, generated tables, checksums."""
