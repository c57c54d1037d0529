"""Stress tests of the package, bounded in time and count. Each module is a command that the tests run shortened."""
