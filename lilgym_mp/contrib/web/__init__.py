"""Web application behind `lilgym-mp serve`: play, watch, take a seat in a game, annotate, explore.

An adapter: rules, truth values, legality and rendering come from the package; this layer adds pages, a JSON API and a
database. Needs the extra `web`. `app.create_app(ServeOptions(...))` returns the ASGI application.
"""

from lilgym_mp.submodules import submodule_getter

__getattr__ = submodule_getter(__name__)
