"""Wrappers around the environments, installed as `lilgym_mp.wrappers`: one file each."""
