"""One module per page, with its HTML and JSON routes."""

from lilgym_mp.web.routes import annotate, explore, game, home, organise, play, review, tutorial, watch

# /annotate/{assignment_id} comes after the other pages below /annotate.
ROUTERS = [page.router for page in (home, play, watch, game, organise, review, tutorial, annotate, explore)]
