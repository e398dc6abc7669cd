"""YAML and JSON, which is YAML, that people give: read without recursion and within bounds, plain values only."""

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import yaml

from protocol.errors import InputError

MAX_BYTES = 10_000_000
"""Largest file; a thousand walls take 50 kB (ours)."""
MAX_RESULT_BYTES = 1 << 28
"""Largest result of a run that is read as a whole, and longest line of others: `metrics.csv` of 100 robots and two
hours takes 60 MB."""
MAX_DEPTH = 32
"""Lists and maps within each other; a polygon's point is at level 5 (ours)."""
MAX_VALUES = 300_000
"""Values of a file: 100,000 points of outlines (ours). They take 2 s."""
MAX_SCALAR = 4_000
"""Characters of a text or number: int() takes no more than 4,300 (ours)."""
MAX_INT = 2**63
"""Integers are smaller: longer ones cannot even be printed."""

_EXPONENT = re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+\Z")
"""Numbers such as 1e-5, which are texts in YAML 1.1, but numbers in JSON."""
_PAIR = re.compile(r"(?<!\\)((?:\\\\)*)\\u(d[89ab][0-9a-f]{2})\\u(d[c-f][0-9a-f]{2})", re.IGNORECASE)
"""A character beyond 16 bits as JSON escapes it, by two halves that YAML does not take."""
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_CORE = "tag:yaml.org,2002:"


class _Resolver(yaml.resolver.Resolver):
    """What a plain text means."""


DUMPER: Any = type("Dumper", (getattr(yaml, "CSafeDumper", yaml.SafeDumper),), {})
"""Of YAML that we read again: it quotes what the reader would take for a number."""
for _class in (_Resolver, DUMPER):
    _class.add_implicit_resolver(f"{_CORE}float", _EXPONENT, list("-+0123456789"))
_RESOLVER = _Resolver()
_MAKER = yaml.constructor.SafeConstructor()


def _integer(node: yaml.ScalarNode) -> int:
    value: int = _MAKER.construct_yaml_int(node)
    if abs(value) >= MAX_INT:
        raise InputError("an integer of more than 63 bits")
    return value


_SCALARS: Mapping[str, Callable[[yaml.ScalarNode], Any]] = {
    f"{_CORE}null": _MAKER.construct_yaml_null,
    f"{_CORE}bool": _MAKER.construct_yaml_bool,
    f"{_CORE}int": _integer,
    f"{_CORE}float": _MAKER.construct_yaml_float,
    **dict.fromkeys((f"{_CORE}{name}" for name in ("str", "timestamp", "merge", "value")), lambda node: node.value),
}
"""The types of JSON. Dates stay texts."""


def read_document(file: Path) -> Any:
    """What a file says: None, bool, int, float, str, list, dict. Raises InputError without the file's name."""
    return parse_document(read_text(file))


def check_is_file(file: Path) -> None:
    """Raise InputError, without its name, for what is none: a pipe may never end, nor does a device."""
    if not file.is_file():
        raise InputError("this is no file" if file.exists() else "there is no such file")


def check_size(file: Path, max_bytes: int = MAX_BYTES) -> None:
    """Raise InputError, without its name, for what is no file, or a larger one."""
    check_is_file(file)
    if file.stat().st_size > max_bytes:
        raise InputError(f"larger than {max_bytes} bytes")


def read_text(file: Path, max_bytes: int = MAX_BYTES) -> str:
    """The text of a file. Raises InputError without the file's name."""
    with _opened(file) as stream:
        data = stream.read(max_bytes + 1)
        if len(data) > max_bytes:
            raise InputError(f"larger than {max_bytes} bytes")
        return data.decode()


def read_lines(file: Path, max_bytes: int = MAX_RESULT_BYTES) -> Iterator[str]:
    """The lines of a text of any length, each of at most so many bytes. Raises InputError without the file's name."""
    with _opened(file) as stream:
        while line := stream.readline(max_bytes + 1):
            if len(line) > max_bytes:
                raise InputError(f"a line is longer than {max_bytes} bytes")
            yield line.decode()


@contextmanager
def _opened(file: Path) -> Iterator[BinaryIO]:
    """A file whose bytes are read and decoded. Raises InputError without the file's name."""
    try:
        check_is_file(file)
        with file.open("rb") as stream:
            yield stream
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError("no text in UTF-8") from None


def parse_document(text: str) -> Any:
    """What a text says. Raises InputError, which names the line of a text of several lines."""
    line = 0
    try:
        top: list[Any] = []
        inside: list[tuple[Any, Any]] = [(top, None)]  # lists and maps that are open; of a map, the key that waits
        key: Any
        left = MAX_VALUES
        for event in yaml.parse(_PAIR.sub(_whole, text), LOADER):
            line = event.start_mark.line if event.start_mark else line
            match event:
                case yaml.AliasEvent():
                    raise InputError(f"the alias *{event.anchor}: write out what it stands for")
                case yaml.SequenceEndEvent() | yaml.MappingEndEvent():
                    inside.pop()
                    continue
                case yaml.ScalarEvent():
                    value = _scalar(event)
                case yaml.SequenceStartEvent(tag=None | "!" | "tag:yaml.org,2002:seq"):
                    value = []
                case yaml.MappingStartEvent(tag=None | "!" | "tag:yaml.org,2002:map"):
                    value = {}
                case yaml.CollectionStartEvent():
                    raise InputError(f"the tag {event.tag!r} is not known")
                case yaml.DocumentStartEvent() if top:
                    raise InputError("a second document begins")
                case _:
                    continue
            left -= 1
            if left < 0:
                raise InputError(f"more than {MAX_VALUES} values")
            holder, key = inside[-1]
            if isinstance(holder, list):
                holder.append(value)
            elif key is None:
                if isinstance(value, list | dict) or value is None:
                    raise InputError("the name of a field must be a text")
                if value in holder:
                    raise InputError(_twice(next(name for name in holder if name == value), value))
                inside[-1] = holder, (value,)
            else:
                holder[key[0]] = value
                inside[-1] = holder, None
            if isinstance(value, list | dict):
                if len(inside) > MAX_DEPTH:
                    raise InputError(f"nested deeper than {MAX_DEPTH}")
                inside.append((value, None))
        return top[0] if top else None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = mark.line if mark else line
        cause = f"no YAML: {' '.join((getattr(error, 'problem', None) or str(error)).split())}"
    except InputError as error:
        cause = str(error)
    except (ValueError, LookupError, OverflowError) as error:  # of a number, or of a character that YAML does not take
        cause = f"no YAML: {error}"
    where = f"line {line + 1}: " if "\n" in text.strip() else ""
    raise InputError(f"{where}{cause:.200}")


def _whole(pair: re.Match[str]) -> str:
    """The same character as YAML escapes it."""
    before, high, low = pair.groups()
    return f"{before}\\U{0x10000 + (int(high, 16) - 0xD800) * 0x400 + int(low, 16) - 0xDC00:08x}"


def _twice(first: object, second: object) -> str:
    """What is wrong with two names of fields that are equal, as 1, 1.0 and true are."""
    if type(first) is type(second):
        return f"the field {second!r:.60} stands there twice"
    return f"the fields {first!r:.60} and {second!r:.60} count as one: make texts of them"


def _scalar(event: yaml.ScalarEvent) -> Any:
    """The value of a text or number."""
    text, tag = event.value, event.tag
    if len(text) > MAX_SCALAR:
        raise InputError(f"a text of more than {MAX_SCALAR} characters")
    if tag is None or tag == "!":
        tag = str(_RESOLVER.resolve(yaml.ScalarNode, text, event.implicit))  # type: ignore[no-untyped-call]
    if tag not in _SCALARS:
        raise InputError(f"the tag {tag!r} is not known")
    return _SCALARS[tag](yaml.ScalarNode(tag, text))
