"""manifest.json: what was run, from when to when, and how it ended."""

import json
import sys
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from protocol.files import write_whole
from world.config import WorldConfig
from world.worldfile import World


def begun(config: WorldConfig, world: World) -> dict[str, Any]:
    """Its fields that are known when a run begins."""
    return {
        "version": version("wireswarm"),
        "command_line": sys.argv,
        "config": config.model_dump(mode="json"),
        "seed": config.seed,
        "world_hash": world.hash,
        "start": _now(),
    }


def write(out: Path, fields: dict[str, Any], ended: str | None, **more: Any) -> None:
    """Write it into a run directory; ended: how, just now."""
    text = json.dumps(fields | {"end": _now(), "ended": ended} | more, indent=1)
    write_whole(out / "manifest.json", text + "\n")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
