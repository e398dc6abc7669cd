"""A secret for each robot and run: who has it may connect by its name."""

import hashlib
import os
import re
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from protocol.access import VIEWER, WORLD, access_control, zenoh_id
from protocol.document import read_text
from protocol.errors import InputError
from protocol.files import write_whole

_LINE = re.compile(r"([a-z][a-z0-9_-]{0,15}):([A-Za-z0-9_-]{16,200})")


class Secrets(dict[str, str]):
    """Secrets by name: robots, VIEWER, and WORLD where the router is another process. Credentials of `protocol.access`.

    Zenoh shows that it has a secret without sending it, but encrypts nothing by it.
    """

    encrypted = False

    @property
    def robots(self) -> list[str]:
        """Robots among these names."""
        return [name for name in self if name not in (VIEWER, WORLD)]

    def subjects(self) -> dict[str, dict[str, list[str]]]:
        """User names, and the one session of each but viewers, who may be many."""
        ids = {name: {} if (one := self.session_id(name)) is None else {"zids": [one]} for name in self}
        return {name: {"usernames": [name], **ids[name]} for name in self}

    def session_id(self, name: str) -> str | None:
        """A hash of name and secret."""
        if name == VIEWER or name not in self:
            return None
        return zenoh_id(hashlib.sha256(f"{name}:{self[name]}".encode()).hexdigest())

    def connecting(self, name: str) -> dict[str, object]:
        """User and password, where there is a secret of this name."""
        if name not in self:
            return {}
        zid = self.session_id(name)
        user = {"transport/auth/usrpwd/user": name, "transport/auth/usrpwd/password": self[name]}
        return {**user, **({} if zid is None else {"id": zid})}

    @contextmanager
    def listening(self) -> Iterator[dict[str, object]]:
        """With a file of these secrets in memory, as a killed process would leave one on a disk for good."""
        with os.fdopen(os.memfd_create("secrets"), "w") as file:
            file.write(_lines(self))
            file.flush()
            yield self.listening_by(Path(f"/proc/self/fd/{file.fileno()}"))

    def listening_by(self, file: Path) -> dict[str, object]:
        """Settings of a router that finds these secrets in a file of `write_secrets`."""
        return {"transport/auth/usrpwd/dictionary_file": str(file), "access_control": access_control(self)}

    def refused(self, name: str, endpoint: str) -> str:
        """Zenoh tells no client why."""
        return (
            "check that it runs, that the address and port are right, that no firewall is between, and that the secret "
            "is the world's"
        )


def new_secrets(robots: Iterable[str]) -> Secrets:
    """A fresh secret for each robot, the viewer and the world: 192 random bits, which nobody guesses within a run."""
    return Secrets({name: secrets.token_urlsafe(24) for name in (*robots, VIEWER, WORLD)})


def write_secrets(file: Path, secrets: Secrets) -> None:
    """Write a file that only its owner may read, a line NAME:SECRET for each, as Zenoh and `read_secrets` read.

    Raises UnwritableError.
    """
    write_whole(file, _lines(secrets), private=True)


def _lines(secrets: Secrets) -> str:
    return "".join(f"{name}:{secret}\n" for name, secret in secrets.items())


def read_secrets(file: Path, names: Iterable[str] | None) -> Secrets:
    """The secrets of these names only, or of all robots.

    Raises InputError where one is missing or the file cannot be read.
    """
    try:
        lines = read_text(file).splitlines()
    except InputError as error:
        raise InputError(f"--secrets {file}: {error}") from None
    found = Secrets({match[1]: match[2] for line in lines if (match := _LINE.fullmatch(line.strip()))})
    names = found.robots if names is None else list(names)
    missing = [name for name in names if name not in found]
    if missing:
        raise InputError(f"--secrets {file}: it has no line {missing[0]}:SECRET of at least 16 letters and digits")
    return Secrets({name: found[name] for name in names})
