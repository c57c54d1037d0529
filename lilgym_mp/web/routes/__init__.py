"""One module a page: its HTML and the JSON that it asks for."""

from lilgym_mp.web.routes import annotate, explore, home, play, watch

ROUTERS = [home.router, play.router, annotate.router, watch.router, explore.router]
