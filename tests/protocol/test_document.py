"""YAML and JSON that people give: what is taken, and what is refused in which words."""

import json
from pathlib import Path

import pytest

from protocol.document import parse_document, read_lines
from protocol.errors import InputError


@pytest.mark.parametrize("text", ["\U0001f916", "a\\\U0001f916b", "\\ud83e\\udd16", "\U0010ffff\U00010000", "\u00e9"])
def test_json_of_any_text_is_that_text(text: str) -> None:
    """Python's and others' JSON tells characters beyond 16 bits by two halves, which are no YAML."""
    assert parse_document(json.dumps({"name": text})) == {"name": text}


def test_half_a_character_is_refused() -> None:
    with pytest.raises(InputError, match="no YAML"):
        parse_document(r'{"name": "\ud83e"}')


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{a: 1, a: 2}", "the field 'a' stands there twice"),
        ("{1: 2, true: 4}", "the fields 1 and True count as one: make texts of them"),
        ("{1: 2, 1.0: 4}", "the fields 1 and 1.0 count as one: make texts of them"),
    ],
)
def test_fields_that_are_one_are_named(text: str, said: str) -> None:
    with pytest.raises(InputError, match=f"^{said}$"):
        parse_document(text)


def test_a_file_is_read_line_by_line_however_long_it_is(tmp_path: Path) -> None:
    """`wireswarm bandwidth` refused finished runs whose robots had told more than 256 MiB of maps."""
    (tmp_path / "lines").write_bytes(b"a\xe2\x80\xa8b\n" * 100 + b"c")
    assert list(read_lines(tmp_path / "lines", 6)) == [*["a\u2028b\n"] * 100, "c"]
    for content, said in ((b"a\n1234567", "a line is longer than 6 bytes"), (b"a\n\xff\n", "no text in UTF-8")):
        (tmp_path / "lines").write_bytes(content)
        lines = read_lines(tmp_path / "lines", 6)
        assert next(lines) == "a\n"
        with pytest.raises(InputError, match=f"^{said}$"):
            next(lines)
    with pytest.raises(InputError, match=r"^there is no such file$"):
        next(read_lines(tmp_path / "none"))
