"""One module per page, with its HTML and JSON routes."""

from lilgym_mp.web.routes import annotate, explore, game, home, organise, play, watch

ROUTERS = [
    route.router for route in (home, play, watch, game, organise, annotate, explore)
]  # /annotate/organise is looked up before /annotate/{assignment_id}
