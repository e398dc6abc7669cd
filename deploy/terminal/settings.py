"""The public settings with default, unit and reason, as their models in the code hold them."""

import inspect
import json
import re
import shutil
import textwrap
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from types import NoneType
from typing import Any, Literal, get_args, get_origin

import yaml
from pydantic import BaseModel

from deploy.config import RunConfig
from protocol.document import DUMPER
from protocol.errors import InputError

UNITS = {
    "bytes_per_s": "B/s", "mps": "m/s", "rps": "rad/s", "bytes": "B", "deg": "degrees", "hz": "Hz", "db": "dB",
    "mm": "mm", "m": "m", "s": "s",
}  # fmt: skip
"""Unit by the end of a setting's name; longer ends stand before shorter ones."""

PLAIN = {bool: ("true", "false"), int: ("number",), float: ("number",), str: ("text",), NoneType: ("null",)}
"""What a setting of a plain type takes."""

DERIVED = ("spec.radio_range_m", "spec.radio_mtu_bytes")
"""No settings, though fields of their model: the world tells robots the radio's limits in their spec."""


@dataclass(frozen=True)
class Setting:
    """One public setting."""

    key: str
    """Dotted, as `--set` takes it; `radio.models[bernoulli].loss` is a field of an element of the list radio.models."""
    default: Any  # as in a file; None also where `required`
    required: bool  # whether an element of a list must give it
    unit: str
    choices: str  # what it takes, such as "complete | number"; empty where the default shows it
    reason: str  # the docstring below the field

    @property
    def value(self) -> str:
        """The default as YAML on one line, or that there is none."""
        text: str = yaml.dump(self.default, Dumper=DUMPER, default_flow_style=True, width=1000)
        return "(required)" if self.required else text.removesuffix("\n").removesuffix("\n...")

    @property
    def about(self) -> str:
        """Reason and choices."""
        return f"{self.reason} ({self.choices})" if self.choices else self.reason


def settings(model: BaseModel | None = None, prefix: str = "") -> Iterator[Setting]:
    """All settings of a model (None: of RunConfig) and of the models within it, in the order of the code."""
    model = model or RunConfig()
    for name, field in type(model).model_fields.items():
        key, default = f"{prefix}{name}", getattr(model, name, None)
        if isinstance(default, BaseModel):
            yield from settings(default, f"{key}.")
        elif key not in DERIVED:
            reason = " ".join((field.description or "").split())
            unit = next((unit for end, unit in UNITS.items() if f"_{name}".endswith(f"_{end}")), "")
            parts = list(_parts(field.annotation))
            yield Setting(key, default, not hasattr(model, name), unit, _choices(parts), reason)
            for element in parts:
                if isinstance(element, type) and issubclass(element, BaseModel):
                    yield from _settings_of_element(element, key)


def listed(of: str = "") -> list[Setting]:
    """The settings of which the key, or a group that it is in, is `of`, such as radio or radio.models; all for none.

    Raises InputError where there are none.
    """
    found = [one for one in settings() if not of or re.match(rf"{re.escape(of)}($|[.\[])", one.key)]
    if not found:
        raise InputError(f"{of:.200}: no such setting nor group of settings; `wireswarm config` lists all")
    return found


def _settings_of_element(element: type[BaseModel], key: str) -> Iterator[Setting]:
    """The kind of an element of the list `key` with what it is about, and the element's other settings."""
    (kind,) = get_args(element.model_fields["kind"].annotation)
    about = " ".join((inspect.getdoc(element) or "").split())
    yield Setting(f"{key}[{kind}].kind", kind, False, "", "", about)
    below = settings(element.model_construct(), f"{key}[{kind}].")
    yield from (one for one in below if not one.key.endswith("].kind"))


def to_text(of: str = "") -> str:
    """The settings for people: key and default on a line, reason and choices below it."""
    width = min(shutil.get_terminal_size().columns, 120)
    lines = []
    for one in listed(of):
        lines.append(f"{one.key} = {one.value} {one.unit}".rstrip())
        lines += textwrap.wrap(one.about, width, initial_indent="    ", subsequent_indent="    ")
    return "\n".join(lines)


def to_yaml(of: str = "") -> str:
    """A file for `--config` that holds every default; elements of lists stand in comments."""
    lines = ["# The settings of wireswarm with their defaults. A file needs to hold only what it changes."]
    above: list[str] = []
    for one in listed(of):
        path, element, below = one.key.partition("[")
        *groups, name = path.split(".")
        about = f"[{one.unit}] {one.about}" if one.unit else one.about
        if element:
            about = f"{path}[{below} = {one.value}: {about}"
        else:
            for depth, group in enumerate(groups):
                if above[: depth + 1] != groups[: depth + 1]:
                    lines.append(f"{'  ' * depth}{group}:")
            above = groups
        indent = "  " * len(groups)
        lines += textwrap.wrap(about, 110, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}#   ")
        if not element:
            lines.append(f"{indent}{name}: {one.value}")
    return "\n".join(lines)


def to_json(of: str = "") -> str:
    """The settings as a list of objects."""
    return json.dumps([asdict(one) for one in listed(of)], indent=1)


def _choices(parts: list[Any]) -> str:
    """Words and kinds of value that a setting takes, where it takes words, truth values or null."""
    found = [get_args(part) if get_origin(part) is Literal else PLAIN.get(part, ()) for part in parts]
    words = list(dict.fromkeys(str(word) for some in found for word in some))
    return "" if words in (["number"], ["text"]) else " | ".join(words)


def _parts(annotation: Any) -> Iterator[Any]:
    """An annotation and all that it is made of, such as the types of a union and the models of a list's elements."""
    yield annotation
    if get_origin(annotation) is not Literal:
        for part in get_args(annotation):
            yield from _parts(part)
