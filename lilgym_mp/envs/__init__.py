"""Environments over one core: single, batched, workers, and two agents sharing one MDP."""
