"""Proximal policy optimisation from rewards alone, with the paper's stop forcing (PPO+SF)."""
