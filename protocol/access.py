"""Who may write and read what: rules that the router enforces (docs/security.md).

Zenoh checks who somebody is when a session opens, by a secret (`protocol.secrets`) or a certificate
(`protocol.certificates`), and drops in both directions what the rules do not allow. A robot's rules hold for one Zenoh
ID only, and Zenoh refuses a second session of an ID: so one session a robot.
"""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any, Protocol

from protocol import keys

VIEWER = "viewer"
"""Name of recorders and displays, which may read everything, the truth included, and write nothing."""
WORLD = "world"
"""Name of the world, where the router is another process."""
ANYBODY = "anybody"
"""Who is known by nothing but a certificate of the authority: may ask why it is not let in. So may all others that have
one, a robot in another's name, too: that question changes nothing, and all who ask it share one small budget."""


class Credentials(Protocol):
    """What shows who somebody is: a client has its own, a router knows those of all."""

    encrypted: bool
    """Whether links are encrypted; their endpoints begin with tls/ then, else not."""

    @property
    def robots(self) -> list[str]:
        """Robots that a client with these credentials may be."""

    def subjects(self) -> Mapping[str, Mapping[str, list[str]]]:
        """By what Zenoh's access control knows the sessions of each name."""

    def session_id(self, name: str) -> str | None:
        """Zenoh ID of this name's only session, as of now; None where it may have several or is not known (any more).

        128 bits of a hash.
        """

    def connecting(self, name: str) -> dict[str, object]:
        """Zenoh's settings of a client by this name."""

    def listening(self) -> AbstractContextManager[dict[str, object]]:
        """Zenoh's settings of a router that knows these credentials, valid while it is opened."""

    def refused(self, name: str, endpoint: str) -> str:
        """What to check where the router at this endpoint does not open a session: the end of a sentence."""


def zenoh_id(sha256: str) -> str:
    """Zenoh ID of the only session that a hash, in hexadecimal, stands for."""
    return sha256[:32].lstrip("0")  # Zenoh takes no leading zeros


def access_control(credentials: Credentials) -> dict[str, Any]:
    """Zenoh's access_control: robots use their own and the public keys, viewers read all, everybody else nothing."""
    rules, subjects, policies = [], [], []
    for name, subject in credentials.subjects().items():
        allowed = _RULES[name] if name in _RULES else _of_robot(name)
        ids = [f"{name}-{number}" for number in range(len(allowed))]
        for rule, (flow, messages, expressions) in zip(ids, allowed, strict=True):
            what = {"flows": [flow], "messages": messages, "key_exprs": expressions}
            rules.append({"id": rule, "permission": "allow", **what})
        subjects.append({"id": name, **subject})
        policies.append({"id": name, "subjects": [name], "rules": ids})
    return {"enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies}


Rule = tuple[str, list[str], list[str]]
"""Flow as the router sees it, messages, key expressions."""

_SAMPLES = ["put", "delete"]
_WATCH = ["declare_liveliness_subscriber", "liveliness_query"]
_ALL_IN = keys.to_robot("*")
_PUBLIC: list[Rule] = [
    ("ingress", ["declare_subscriber", *_WATCH], [keys.ALL_PUBLIC]),
    ("egress", [*_SAMPLES, "liveliness_token"], [keys.ALL_PUBLIC]),
]
_RULES: dict[str, list[Rule]] = {
    VIEWER: [
        *_PUBLIC,
        ("ingress", ["declare_subscriber"], [keys.ALL_TRUTH, keys.ALL_OUT]),
        ("egress", _SAMPLES, [keys.ALL_TRUTH, keys.ALL_OUT]),
        ("ingress", _WATCH, [keys.ALL_ALIVE]),
        ("egress", ["liveliness_token"], [keys.ALL_ALIVE]),
    ],
    WORLD: [
        ("ingress", _SAMPLES, [_ALL_IN, keys.ALL_PUBLIC, keys.ALL_TRUTH]),
        ("ingress", ["liveliness_token"], [keys.WORLD_ALIVE]),
        ("egress", ["declare_subscriber"], [_ALL_IN, keys.ALL_PUBLIC, keys.ALL_TRUTH]),
        ("ingress", ["declare_subscriber"], [keys.ALL_OUT]),
        ("egress", _SAMPLES, [keys.ALL_OUT]),
        ("ingress", _WATCH, [keys.ALL_ALIVE, keys.WORLD_ALIVE]),
        ("egress", ["liveliness_token"], [keys.ALL_ALIVE, keys.WORLD_ALIVE]),
        ("ingress", ["declare_queryable", "reply"], [keys.ALL_SRV]),
        ("egress", ["query"], [keys.ALL_SRV]),
    ],
    ANYBODY: [
        ("ingress", _WATCH, [keys.WORLD_ALIVE]),
        ("egress", ["liveliness_token"], [keys.WORLD_ALIVE]),
        ("ingress", ["query"], [keys.ALL_WHY]),
        ("egress", ["declare_queryable", "reply"], [keys.ALL_SRV]),
    ],
}


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
