"""One module per page, with its HTML and JSON routes."""

from lilgym_mp.web.routes import annotate, explore, game, home, play, watch

ROUTERS = [home.router, play.router, watch.router, game.router, annotate.router, explore.router]
