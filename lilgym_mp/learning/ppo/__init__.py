"""Proximal policy optimisation from rewards, with the paper's stop forcing (PPO+SF).

By default programs are read too, to exchange colours; without `recolour` it learns from rewards alone.
"""
