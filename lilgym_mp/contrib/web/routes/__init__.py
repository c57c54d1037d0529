"""One module per page, with its HTML and JSON routes."""

from lilgym_mp.contrib.web.routes import annotate, beat, explore, game, play, sentence, watch
from lilgym_mp.submodules import submodule_getter

PAGES = (play, beat, watch, game, annotate, explore, sentence)
ROUTERS = [router for page in PAGES for router in (page.router, page.api)]

__getattr__ = submodule_getter(__name__)
