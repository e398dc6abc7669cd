"""Who may write and read what: a secret per robot and run, and rules that the router enforces (docs/security.md).

Zenoh checks name and secret when a session opens, and drops in both directions what the rules do not allow. A robot's
rules hold for one Zenoh ID only, and Zenoh refuses a second session of an ID: so one session a robot.
"""

import hashlib
import re
import secrets as random_secrets
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from protocol import keys
from protocol.document import read_text
from protocol.errors import InputError
from protocol.files import write_whole

VIEWER = "viewer"
"""Name of recorders and displays, which may read everything, the truth included, and write nothing."""

Secrets = Mapping[str, str]
"""Secrets by name: robots, and VIEWER."""

_LINE = re.compile(r"([a-z][a-z0-9_-]{0,15}):([A-Za-z0-9_-]{16,200})")


def new_secrets(robots: Iterable[str]) -> dict[str, str]:
    """A fresh secret for each robot and for the viewer: 192 random bits, which nobody guesses within a run."""
    return {name: random_secrets.token_urlsafe(24) for name in (*robots, VIEWER)}


def write_secrets(file: Path, secrets: Secrets) -> None:
    """Write a file that only its owner may read, a line NAME:SECRET for each, as Zenoh and `read_secrets` read.

    Raises UnwritableError.
    """
    write_whole(file, "".join(f"{name}:{secret}\n" for name, secret in secrets.items()), private=True)


def read_secrets(file: Path, names: Iterable[str] | None) -> dict[str, str]:
    """The secrets of these names only, or of all robots.

    Raises InputError where one is missing or the file cannot be read.
    """
    try:
        lines = read_text(file).splitlines()
    except InputError as error:
        raise InputError(f"--secrets {file}: {error}") from None
    found = {match[1]: match[2] for line in lines if (match := _LINE.fullmatch(line.strip()))}
    names = [name for name in found if name != VIEWER] if names is None else list(names)
    missing = [name for name in names if name not in found]
    if missing:
        raise InputError(f"--secrets {file}: it has no line {missing[0]}:SECRET of at least 16 letters and digits")
    return {name: found[name] for name in names}


def session_id(name: str, secret: str) -> str:
    """Zenoh ID of the only session with a robot's rights: 128 bits that nobody knows without the secret."""
    return hashlib.sha256(f"{name}:{secret}".encode()).hexdigest()[:32].lstrip("0")  # Zenoh takes no leading zeros


def access_control(secrets: Secrets) -> dict[str, Any]:
    """Zenoh's access_control: robots use their own and the public keys, viewers read all, everybody else nothing."""
    rules, subjects, policies = [], [], []
    for name, secret in secrets.items():
        allowed = _OF_VIEWER if name == VIEWER else _of_robot(name)
        ids = [f"{name}-{number}" for number in range(len(allowed))]
        for rule, (flow, messages, expressions) in zip(ids, allowed, strict=True):
            what = {"flows": [flow], "messages": messages, "key_exprs": expressions}
            rules.append({"id": rule, "permission": "allow", **what})
        session = {} if name == VIEWER else {"zids": [session_id(name, secret)]}
        subjects.append({"id": name, "usernames": [name], **session})
        policies.append({"id": name, "subjects": [name], "rules": ids})
    return {"enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies}


Rule = tuple[str, list[str], list[str]]
"""Flow as the router sees it, messages, key expressions."""

_SAMPLES = ["put", "delete"]
_PUBLIC: list[Rule] = [
    ("ingress", ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"], [keys.ALL_PUBLIC]),
    ("egress", [*_SAMPLES, "liveliness_token"], [keys.ALL_PUBLIC]),
]
_OF_VIEWER: list[Rule] = [
    *_PUBLIC,
    ("ingress", ["declare_subscriber"], [keys.ALL_TRUTH, keys.ALL_OUT]),
    ("egress", _SAMPLES, [keys.ALL_TRUTH, keys.ALL_OUT]),
    ("ingress", ["declare_liveliness_subscriber", "liveliness_query"], [keys.ALL_ALIVE]),
    ("egress", ["liveliness_token"], [keys.ALL_ALIVE]),
]


def _of_robot(robot: str) -> list[Rule]:
    heard, said, services = [keys.to_robot(robot)], [keys.from_robot(robot)], [keys.service(robot)]
    return [
        *_PUBLIC,
        ("ingress", _SAMPLES, said),
        ("ingress", ["liveliness_token"], [keys.alive(robot)]),
        ("ingress", ["declare_subscriber"], heard),
        ("egress", _SAMPLES, heard),
        # with the world's and the viewers' wildcards, else the robot's publishers see no subscriber and drop silently
        ("egress", ["declare_subscriber"], [*said, keys.ALL_OUT]),
        ("ingress", ["query"], services),
        # likewise with the wildcard of the world's queryable
        ("egress", ["declare_queryable", "reply"], [*services, keys.ALL_SRV]),
    ]
