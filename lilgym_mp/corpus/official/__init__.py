"""The official release: downloading, checking, installing it."""
