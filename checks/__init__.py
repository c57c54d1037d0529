"""Attacks on the package, bounded in time and count. Each module is a command, and the tests run it shortened."""
