"""Runs over every task of a split, metrics, analysis and reports."""
