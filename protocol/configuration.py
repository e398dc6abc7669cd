"""Settings of a program: a YAML file, then the flags, then --set KEY=VALUE; later ones win."""

import re
import reprlib
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from protocol.document import parse_document, read_document
from protocol.errors import InputError
from protocol.text import in_own_words

NEAR = 0.8
"""How alike a key and the one that may be meant are, as difflib counts it (ours)."""
OF_A_RUN = {
    *("world", "robots", "seed", "starts", "until", "max_time_s", "people", "snapshot_s", "scans", "faults", "spec"),
    *("radio", "agent", "mind", "join_timeout_s", "reconnect_s", "restart", "server", "ros2"),
}
"""Groups and settings at the top of a whole run's file (`deploy.config`), which not every program has."""
MAX_KEY = 100
"""Characters of a key that are compared."""

Model = TypeVar("Model", bound=BaseModel)


class ConfigError(InputError):
    """A file, flag or setting that cannot be used; one sentence that names the key."""


def load(
    model: type[Model],
    file: Path | None = None,
    flags: Mapping[str, Any] | None = None,
    sets: Sequence[str] = (),
    shared: bool = False,
) -> Model:
    """Configuration from a YAML file, flags by dotted key (None: not given), and KEY=VALUE settings, in this order.

    shared: the file is that of a whole run, and other programs read (and check) what of it this model does not have.
    Raises ConfigError.
    """
    tree = _read(file) if file else {}
    if shared:
        tree = {key: value for key, value in tree.items() if key in model.model_fields or key not in OF_A_RUN}
    for key, value in (flags or {}).items():
        if value is not None:
            put(tree, key, value)
    for setting in sets:
        key, equals, text = setting.partition("=")
        if not equals or not key:
            raise ConfigError(f"--set {setting:.200}: write it as KEY=VALUE, such as starts=random")
        try:
            value = parse_document(text)
        except InputError as error:
            raise ConfigError(f"--set {key:.200}: {reprlib.repr(text)} is no value: {error}") from None
        put(tree, key, value)
    return validated(model, tree)


def validated(model: type[Model], tree: Mapping[str, Any], context: Mapping[str, Any] | None = None) -> Model:
    """Configuration from the fields of a file; context: of the model's validators. Raises ConfigError."""
    try:
        return model.model_validate(tree, context=context)
    except ValidationError as error:
        raise ConfigError(_sentence(error, model)) from None


def _sentence(error: ValidationError, model: type[BaseModel]) -> str:
    """One sentence on the first wrong key of a configuration."""
    found = error.errors(include_url=False)
    key = _key(found[0]["loc"])
    same = [one for one in found if _key(one["loc"]) == key]
    if same[0]["type"] == "extra_forbidden":
        near = " or ".join(_near(key, list(_keys(model))))
        return f"{key:.200}: there is no such setting{f'; did you mean {near}?' if near else ''}"
    if not key:  # of settings that do not go together, which the sentence names
        return in_own_words(same[0]["msg"])
    wishes = " or ".join(dict.fromkeys(in_own_words(one["msg"]) for one in same))
    if same[0]["type"] == "value_error" and isinstance(same[0]["input"], Mapping):  # likewise, of a group
        return f"{key}: {wishes}"
    return f"{key}: {wishes}, not {reprlib.repr(same[0]['input'])}"


def _keys(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Dotted keys of all settings."""
    for name, field in model.model_fields.items():
        if isinstance(field.default, BaseModel):
            yield from _keys(type(field.default), f"{prefix}{name}.")
        else:
            yield prefix + name


def _near(key: str, keys: Sequence[str]) -> list[str]:
    """Settings that may be meant: those written nearly so, or else those of nearly that name in any group."""
    by_name: dict[str, list[str]] = {}
    for one in keys:
        by_name.setdefault(one.rpartition(".")[2], []).append(one)
    name = key.rpartition(".")[2]
    names = get_close_matches(name[:MAX_KEY], by_name, 1, NEAR)
    return get_close_matches(key[:MAX_KEY], keys, 1, NEAR) or [one for near in names for one in by_name[near]][:3]


def _key(where: tuple[int | str, ...]) -> str:
    """Dotted key of an error, without pydantic's names of the alternatives among types."""
    return ".".join(str(part) for part in where if re.fullmatch(r"[a-z0-9_]+", str(part)) and part != "float")


def _read(file: Path) -> dict[str, Any]:
    try:
        tree = read_document(file)
    except InputError as error:
        raise ConfigError(f"--config {file}: {error}") from None
    if tree is None:
        return {}
    if not isinstance(tree, dict):
        raise ConfigError(f"--config {file}: settings are KEY: VALUE, not {type(tree).__name__}")
    if is_world(tree):
        raise ConfigError(f"--config {file}: this is a world: run it by --world {file}")
    return tree


def is_world(fields: Mapping[str, Any]) -> bool:
    """Whether a file that should hold settings is a world file."""
    return not fields.keys().isdisjoint({"boxes", "walls", "polygons"})


def put(tree: dict[str, Any], key: str, value: object) -> None:
    """Set a value in the fields of a file, by its dotted key. Raises ConfigError where it lies below a value.

    Groups on the way are copied: they may belong to whoever put them there.
    """
    *branches, leaf = key.split(".")
    for branch in branches:
        below = tree.get(branch, {})
        if not isinstance(below, dict):
            raise ConfigError(f"{key:.200}: {branch:.200} is a value, not a group of settings")
        tree[branch] = below = dict(below)
        tree = below
    tree[leaf] = value
