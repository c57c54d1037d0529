"""Downloading, verifying and installing the official release."""
