"""The credentials that people give to a command: a file of secrets, or a folder of certificates."""

import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from protocol.access import VIEWER, WORLD, Credentials
from protocol.certificates import RESERVED, Certificates, read_roster
from protocol.errors import InputError
from protocol.secrets import new_secrets, read_secrets, write_secrets


def of_robot(robot: str | None, secrets: Path | None, certs: Path | None) -> Credentials | None:
    """Those of one robot, or of all that a process may be. Raises InputError."""
    _one_of(secrets, certs)
    if certs is not None:
        held = [file.stem for file in certs.glob("*.key") if file.stem not in RESERVED]
        robots = sorted(held, key=lambda name: (len(name), name)) if robot is None else [robot]
        if not robots:
            raise InputError(f"--certs {certs}: it has no key of a robot, such as r1.key")
        return Certificates(certs, robots)
    if secrets is None:
        return None
    known = read_secrets(secrets, None if robot is None else [robot])
    if not known.robots:
        raise InputError(f"--secrets {secrets}: it has no line of a robot, such as r1:SECRET")
    return known


def of_viewer(secrets: Path | None, certs: Path | None) -> Credentials | None:
    """Those of a viewer. Raises InputError."""
    _one_of(secrets, certs)
    if certs is not None:
        return Certificates(certs, [VIEWER])
    return None if secrets is None else read_secrets(secrets, [VIEWER])


@contextmanager
def of_all(
    robots: Sequence[str], secrets: Path | None, certs: Path | None, *, world: bool
) -> Iterator[Credentials | None]:
    """Those of all that may connect to a world: robots and viewers, and where the router is another process, its own.

    A file of secrets is made where there is none, and removed where what is done with it raises InputError.
    """
    _one_of(secrets, certs)
    names = [*robots, VIEWER, *([WORLD] if world else [])]
    if certs is not None:
        roster = read_roster(certs)
        for robot in robots:
            if robot not in roster:
                make = f"wireswarm certs {shlex.quote(str(certs))} --robots {robot}"
                raise InputError(f"--certs {certs}: {robot} is not on its roster: make its certificate by `{make}`")
        yield Certificates(certs, names)
        return
    if secrets is None:
        yield None
        return
    try:
        if new := not secrets.exists():
            write_secrets(secrets, new_secrets(robots))
    except OSError as error:
        raise InputError(f"--secrets: {error}") from None
    try:
        yield read_secrets(secrets, names)
    except InputError:
        if new:
            secrets.unlink()
        raise


def of_router(secrets: Path | None, certs: Path | None) -> tuple[Credentials | None, dict[str, object]]:
    """Those of all in a file or folder, and the settings with which a router finds them there. Raises InputError."""
    _one_of(secrets, certs)
    if certs is not None:
        known = Certificates(certs, list(read_roster(certs)))
        return known, known.listening_by_folder()
    if secrets is None:
        return None, {}
    names = [*read_secrets(secrets, None), VIEWER, WORLD]
    return (found := read_secrets(secrets, names)), found.listening_by(secrets.absolute())


def _one_of(secrets: Path | None, certs: Path | None) -> None:
    if secrets is not None and certs is not None:
        raise InputError("--secrets and --certs: give one of them")
