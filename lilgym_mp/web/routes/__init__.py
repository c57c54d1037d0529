"""One module per page, with its HTML and JSON routes."""

from lilgym_mp.web.routes import annotate, explore, game, home, organise, play, review, tutorial, watch

# /annotate/{assignment_id} comes after the other pages below /annotate.
PAGES = (home, play, watch, game, organise, tutorial, annotate, explore)
ROUTERS = [*(page.router for page in PAGES), *(page.api for page in (*PAGES, review))]
