"""The application: `uvicorn server.app:app --port 8000`, one environment for each session."""

import argparse

import uvicorn
from openenv.core.env_server.http_server import create_app

try:
    from ..models import LilgymAction, LilgymObservation
    from .plan_environment import PlanEnvironment
except ImportError:
    from models import LilgymAction, LilgymObservation
    from server.plan_environment import PlanEnvironment

app = create_app(PlanEnvironment, LilgymAction, LilgymObservation, env_name="lilgym_env", max_concurrent_envs=64)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=8000)
    args = parser.parse_args()
    uvicorn.run(app, host=args.host, port=args.port)


if __name__ == "__main__":
    main()
