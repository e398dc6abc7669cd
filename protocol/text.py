"""Texts of robots, files and worlds, made fit for a terminal and a page."""

import re
from typing import Any

_WORDS = (
    ("Value error, ", ""),
    ("Input should be a valid integer.*", "a whole number"),
    ("Input should be a valid (number|decimal).*", "a number"),
    ("Input should be a valid boolean.*", "true or false"),
    ("Input should be a valid string.*", "a text"),
    ("Input should be a valid list.*", "a list"),
    ("Input should be a valid (dictionary|mapping).*", "KEY: VALUE"),
    ("Input should be a finite number.*", "a finite number"),
    ("Input should be greater than or equal to ", "at least "),
    ("Input should be less than or equal to ", "at most "),
    ("Input should be greater than ", "more than "),
    ("Input should be less than ", "less than "),
    ("Input tag .* does not match any of the expected tags: ", "its kind is one of "),
    ("Unable to extract tag using discriminator '?kind'?", "name its kind"),
    ("String should match pattern ", "a text of the form "),
    ("Input should be None", "null"),
    ("Input should be ", ""),
)
"""What libraries say of a wrong value, and what we say it must be."""


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


def in_own_words(sentence: str) -> str:
    """What a value must be, of a library's sentence on a wrong one."""
    for theirs, ours in _WORDS:
        said, times = re.subn(f"^{theirs}", ours, sentence)
        if times:
            return said
    return sentence[:1].lower() + sentence[1:]
