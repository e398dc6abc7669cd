"""manifest.json: what was run, from when to when, and how it ended."""

import json
import shlex
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from protocol.document import read_text
from protocol.errors import InputError
from protocol.files import UnwritableError, write_whole
from protocol.settings import Config
from protocol.status import Status
from world.checkpoint import is_left
from world.config import WorldConfig
from world.worldfile import World

FILE = "manifest.json"


def begun(config: WorldConfig, world: World) -> dict[str, Any]:
    """Its fields that are known before a run begins."""
    config_fields = {"config": config.model_dump(mode="json"), "seed": config.seed, "world_hash": world.hash}
    return _command() | config_fields | {"start": _now()}


def of_logs(config: Config, logs: Sequence[str]) -> dict[str, Any]:
    """The same where recorded logs are mapped. `logs` says to readers of the directory that it has no world."""
    return _command() | {"config": config.model_dump(mode="json"), "logs": list(logs), "start": _now()}


def _command() -> dict[str, Any]:
    """Who writes the directory."""
    return {"version": version("wireswarm"), "command_line": sys.argv}


def begin(out: Path, fields: dict[str, Any]) -> None:
    """Write it into the directory of a run that begins. Raises UnwritableError."""
    _write(out, fields | {"end": None, "ended": None})


def resume(out: Path) -> None:
    """Take back how the run had ended, as it goes on. Raises as `begin` and `read` do."""
    begin(out, {name: value for name, value in read(out).items() if name not in ("exit_status", "errors")})


def finish(out: Path, **more: Any) -> None:
    """Add to it what is known now that the run has ended. Raises UnwritableError, also where it is gone or damaged."""
    try:
        begun = read(out)
    except InputError as error:
        raise UnwritableError((out / FILE, str(error))) from None
    _write(out, begun | {"end": _now()} | more)


def is_of_logs(out: Path) -> bool:
    """Whether recorded logs were mapped, as far as anybody says."""
    try:
        return "logs" in read(out)
    except InputError:
        return False


def ended(out: Path) -> str | None:
    """How a run ended; None where nobody has said so yet, or it is gone or damaged."""
    try:
        return read(out).get("ended")
    except InputError:
        return None


def unfinished(out: Path) -> str | None:
    """Why a run directory has not all of its files yet, as far as anybody says; None where its run has ended."""
    if is_left(out):
        return f"its world was killed; `wireswarm finish {shlex.quote(str(out))}` ends it"
    try:
        return "its run has not ended" if read(out).get("ended", "") is None else None
    except (OSError, InputError):
        return None


def interrupt(out: Path, why: str) -> None:
    """Say that somebody stopped the command, after the run or before its end. Raises as `finish` and `read` do."""
    told = read(out)
    errors = [*told.get("errors", []), why]
    finish(out, ended=told.get("ended") or "interrupted", exit_status=Status.INTERRUPTED, errors=errors)


def withdraw(out: Path) -> None:
    """Remove it, where the run could not begin."""
    (out / FILE).unlink(missing_ok=True)


def read(out: Path) -> dict[str, Any]:
    """Its fields. Raises InputError, without the file's name, where there is none or it is damaged."""
    try:
        fields = json.loads(read_text(out / FILE))
    except (ValueError, RecursionError) as error:
        raise InputError(str(error)) from None
    if not isinstance(fields, dict):
        raise InputError("it holds no JSON object")
    return fields


def _write(out: Path, fields: dict[str, Any]) -> None:
    write_whole(out / FILE, json.dumps(fields, indent=1) + "\n")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
