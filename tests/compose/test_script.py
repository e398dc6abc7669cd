"""`deploy/compose.sh` with an engine that only notes what it is asked."""

import os
import subprocess
from pathlib import Path

from tests.compose.engine import REPO

ENGINE = """#!/bin/sh
echo "$(basename "$0") $*" >> "$ASKED"
case "$1" in
    compose) exit 1 ;;
    inspect) echo 3 ;;
    --file) test "$3" != ps || echo world ;;
esac
"""
"""Without compose v2."""


def test_what_other_runs_left_in_volumes_stays(tmp_path: Path) -> None:
    """`down --volumes` of docker-compose 1.29 removed the results of sweeps, too."""
    for name in ("docker", "docker-compose"):
        (tmp_path / name).write_text(ENGINE)
        (tmp_path / name).chmod(0o755)
    (script := tmp_path / "checkout" / "deploy" / "compose.sh").parent.mkdir(parents=True)
    script.write_bytes((REPO / "deploy" / "compose.sh").read_bytes())
    asked = tmp_path / "asked"
    path = os.pathsep.join([str(tmp_path), os.environ["PATH"]])
    done = subprocess.run(["sh", script], env={"PATH": path, "ASKED": str(asked)}, capture_output=True, timeout=30)
    assert done.returncode == 3, done.stderr
    assert asked.read_text().splitlines()[-2:] == [
        "docker-compose --file deploy/compose.yaml down --timeout 5",
        "docker volume rm --force deploy_secrets",
    ]
