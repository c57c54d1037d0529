"""The browser suite that `lilgym-mp serve` runs: play, watch, sit in a seat, annotate, explore.

An adapter: rules, truth, legality and pictures come from the package; here are pages, JSON and a database. Needs the
extra `web`.
"""

from lilgym_mp.web.app import create_app
from lilgym_mp.web.options import ServeOptions

__all__ = ["ServeOptions", "create_app"]
