"""Texts of robots, files and worlds, made fit for a terminal and a page."""

from typing import Any


def printable(text: str) -> str:
    """The text with control characters as escapes, such as \\x1b: C0, C1, line ends, overrides of direction."""
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in text)


def all_printable(value: Any) -> Any:
    """A JSON value with all its texts, keys included, made printable."""
    match value:
        case str():
            return printable(value)
        case list():
            return [all_printable(inner) for inner in value]
        case dict():
            return {printable(key): all_printable(inner) for key, inner in value.items()}
    return value
