"""`deploy/compose.sh` with an engine that only notes what it is asked."""

import os
import subprocess
from pathlib import Path

import pytest

from tests.compose.engine import REPO
from tests.disturbed import AS_TERMINAL

ENGINE = """#!/bin/sh
echo "$(basename "$0") $*" >> "$ASKED"
case "$1" in
    compose) exit 1 ;;
    inspect) echo 3 ;;
    --file)
        test "$3" != ps || echo world
        test "$3" != up || test -z "$SIGNAL" || kill "-$SIGNAL" "$PPID" ;;
esac
"""
"""Without compose v2. Who calls it gets a signal while it runs, as by Ctrl-C, if that is asked for."""


@pytest.mark.parametrize(("signal", "status"), [("", 3), ("INT", 130), ("TERM", 143), ("HUP", 129)])
def test_what_other_runs_left_in_volumes_stays(signal: str, status: int, tmp_path: Path) -> None:
    """`down --volumes` of docker-compose 1.29 removed the results of sweeps, too. dash cleaned nothing up on Ctrl-C."""
    for name in ("docker", "docker-compose"):
        (tmp_path / name).write_text(ENGINE)
        (tmp_path / name).chmod(0o755)
    (script := tmp_path / "checkout" / "deploy" / "compose.sh").parent.mkdir(parents=True)
    script.write_bytes((REPO / "deploy" / "compose.sh").read_bytes())
    asked = tmp_path / "asked"
    env = {"PATH": os.pathsep.join([str(tmp_path), os.environ["PATH"]]), "ASKED": str(asked), "SIGNAL": signal}
    done = subprocess.run([*AS_TERMINAL, "sh", script], env=env, capture_output=True, timeout=30)
    assert done.returncode == status, done.stderr
    assert asked.read_text().splitlines()[-2:] == [
        "docker-compose --file deploy/compose.yaml down --timeout 5",
        "docker volume rm --force deploy_secrets",
    ]
