"""Policies, models and training loops; torch only from here on."""
