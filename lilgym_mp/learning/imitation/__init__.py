"""Imitation of sets of optimal actions by one network, from images and words. docs/imitation.md describes it."""
