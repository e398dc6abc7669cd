"""`python -m tests.launch_tiny FOLDER MIND JSON`: launch a run in the tiny world, for tests that kill processes.

Prints each progress as a line of JSON, last the result; exits with its status.
"""

import json
import sys
from pathlib import Path

from deploy.launch.launcher import launch
from protocol.messages import Progress
from tests import wanderer
from tests.tiny import tiny_config


def show(progress: Progress) -> None:
    print(progress.model_dump_json(), flush=True)


if __name__ == "__main__":
    folder, mind = Path(sys.argv[1]), getattr(wanderer, sys.argv[2])
    config = tiny_config(folder, **json.loads(sys.argv[3]))
    result = launch(config, folder / "out", show=show, make_mind=mind)
    print(json.dumps({"status": result.status, "ended": result.ended, "errors": result.errors}), flush=True)
    sys.exit(result.status)
