"""One module per page, with its HTML and JSON routes."""

from lilgym_mp.contrib.web.routes import annotate, beat, explore, game, play, sentence, watch

PAGES = (play, beat, watch, game, annotate, explore, sentence)
ROUTERS = [router for page in PAGES for router in (page.router, page.api)]
