"""One module a page: its HTML and the JSON that it asks for."""

from lilgym_mp.web.routes import annotate, explore, game, home, play, watch

ROUTERS = [home.router, play.router, watch.router, game.router, annotate.router, explore.router]
