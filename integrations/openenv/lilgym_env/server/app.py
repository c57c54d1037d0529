"""The application: `uvicorn server.app:app --port 8000`, one environment for each session."""

import uvicorn

from lilgym_mp.contrib.adapters.openenv import make_app

app = make_app()


def main() -> None:
    uvicorn.run(app, port=8000)


if __name__ == "__main__":
    main()
