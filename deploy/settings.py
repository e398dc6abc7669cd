"""The public settings with default, unit and reason, as their models in the code hold them."""

import ast
import inspect
import json
import shutil
import textwrap
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cache
from itertools import pairwise
from types import NoneType
from typing import Any, Literal, get_args, get_origin

import yaml
from pydantic import BaseModel

from deploy.config import RunConfig

UNITS = {
    "bytes_per_s": "B/s",
    "mps": "m/s",
    "rps": "rad/s",
    "bytes": "B",
    "deg": "degrees",
    "rad": "rad",
    "kg": "kg",
    "hz": "Hz",
    "db": "dB",
    "m": "m",
    "s": "s",
}
"""Unit by the end of a setting's name; longer ends stand before shorter ones."""


PLAIN = {bool: ("true", "false"), int: ("number",), float: ("number",), str: ("text",), NoneType: ("null",)}
"""What a setting of a plain type takes."""


@dataclass(frozen=True)
class Setting:
    """One public setting."""

    key: str
    """Dotted, as `--set` takes it; `radio.models[bernoulli].loss` is a field of an element of the list radio.models."""
    default: Any
    """As in a file; None also where `required`."""
    required: bool
    """Whether an element of a list must give it."""
    unit: str
    choices: str
    """What it takes, such as "complete | number"; empty where the default shows it."""
    reason: str
    """The docstring below the field."""

    @property
    def value(self) -> str:
        """The default as YAML, or that there is none."""
        return "(required)" if self.required else on_one_line(self.default)

    @property
    def about(self) -> str:
        """Reason and choices."""
        return f"{self.reason} ({self.choices})" if self.choices else self.reason


def settings(model: BaseModel | type[BaseModel] = RunConfig, prefix: str = "") -> Iterator[Setting]:
    """All settings of a model and of the models within it, in the order of the code."""
    kind = model if isinstance(model, type) else type(model)
    for name, field in kind.model_fields.items():
        required = isinstance(model, type) and field.is_required()
        default = None
        if not required:
            default = field.get_default(call_default_factory=True) if isinstance(model, type) else getattr(model, name)
        if isinstance(default, BaseModel):
            yield from settings(default, f"{prefix}{name}.")
            continue
        reason = _docstrings(kind).get(name, "")
        yield Setting(f"{prefix}{name}", default, required, _unit(name), _choices(field.annotation), reason)
        for element in _elements(field.annotation):
            (tag,) = get_args(element.model_fields["kind"].annotation)
            about = " ".join((inspect.getdoc(element) or "").split())
            yield Setting(f"{prefix}{name}[{tag}].kind", tag, False, "", "", about)
            for below in settings(element, f"{prefix}{name}[{tag}]."):
                if not below.key.endswith("].kind"):
                    yield below


def to_text() -> str:
    """The settings for people: key and default on a line, reason and choices below it."""
    width = min(shutil.get_terminal_size().columns, 120)
    lines = []
    for one in settings():
        lines.append(f"{one.key} = {one.value} {one.unit}".rstrip())
        lines += textwrap.wrap(one.about, width, initial_indent="    ", subsequent_indent="    ")
    return "\n".join(lines)


def to_yaml() -> str:
    """A file for `--config` that holds every default; elements of lists stand in comments."""
    lines = ["# The settings of wireswarm with their defaults. A file needs to hold only what it changes."]
    above: list[str] = []
    for one in settings():
        path, element, below = one.key.partition("[")
        *groups, name = path.split(".")
        for depth, group in enumerate(groups):
            if above[: depth + 1] != groups[: depth + 1]:
                lines.append(f"{'  ' * depth}{group}:")
        above, indent = groups, "  " * len(groups)
        about = f"[{one.unit}] {one.about}" if one.unit else one.about
        if element:
            about = f"{name}[{below} = {one.value}: {about}"
        lines += textwrap.wrap(about, 110, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}#   ")
        if not element:
            lines.append(f"{indent}{name}: {one.value}")
    return "\n".join(lines)


def to_json() -> str:
    """The settings as a list of objects."""
    return json.dumps([asdict(one) for one in settings()], indent=1)


def on_one_line(value: Any) -> str:
    """A value on one line."""
    return yaml.safe_dump(value, default_flow_style=True, width=1000).removesuffix("\n").removesuffix("\n...")


def _unit(name: str) -> str:
    return next((unit for end, unit in UNITS.items() if name.endswith(f"_{end}")), "")


def _choices(annotation: Any) -> str:
    """Words and kinds of value that a setting takes, where it takes words, truth values or null."""
    found: list[str] = []
    for part in _parts(annotation):
        if get_origin(part) is Literal:
            found += map(str, get_args(part))
        else:
            found += PLAIN.get(part, ())
    words = list(dict.fromkeys(found))
    return "" if words in (["number"], ["text"]) else " | ".join(words)


def _elements(annotation: Any) -> list[type[BaseModel]]:
    """Models that are alternatives for the elements of a list."""
    return [part for part in _parts(annotation) if isinstance(part, type) and issubclass(part, BaseModel)]


def _parts(annotation: Any) -> Iterator[Any]:
    yield annotation
    if get_origin(annotation) is not Literal:
        for part in get_args(annotation):
            yield from _parts(part)


@cache
def _docstrings(model: type[BaseModel]) -> dict[str, str]:
    """The docstring below each field, in one line, also of fields that a parent model holds."""
    found = {}
    for kind in reversed(model.__mro__):
        if issubclass(kind, BaseModel) and kind is not BaseModel:
            (tree,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
            assert isinstance(tree, ast.ClassDef)
            for above, below in pairwise(tree.body):
                match above, below:
                    case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                        found[name] = " ".join(text.split())
    return found
