"""The program: an HTTP server with OpenEnv's routes.

    server --host 127.0.0.1 --port 8000

or ``uvicorn server.app:app`` in this folder.
"""

import argparse

import uvicorn

from openenv.core.env_server.http_server import create_app

try:
    from ..models import GraspAction, GraspObservation, GraspState
    from .grasp_environment import GraspEnvironment
    from .settings import ServerSettings
except ImportError:  # the folder itself is on the path
    from models import GraspAction, GraspObservation, GraspState
    from server.grasp_environment import GraspEnvironment
    from server.settings import ServerSettings

__all__ = ["app", "main"]

app = create_app(
    GraspEnvironment,
    GraspAction,
    GraspObservation,
    env_name="graspbox_openenv",
    max_concurrent_envs=ServerSettings.from_environment().sessions,
    state_cls=GraspState,
)


def main() -> None:
    """Serve until interrupted."""
    parser = argparse.ArgumentParser(description="graspbox as an OpenEnv environment")
    parser.add_argument("--host", default="127.0.0.1", help="0.0.0.0 for all addresses of this machine: no login")
    parser.add_argument("--port", type=int, default=8000)
    arguments = parser.parse_args()
    uvicorn.run(app, host=arguments.host, port=arguments.port)


if __name__ == "__main__":
    main()
