"""The application: `uvicorn server.app:app --port 8000`, one environment for each session."""

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
    uvicorn.run(app, port=8000)


if __name__ == "__main__":
    main()
