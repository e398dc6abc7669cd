"""One word for one thing: class names are unique, and what the glossary names exists."""

import ast
import re
from collections import defaultdict
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
GLOSSARY = (ROOT / "docs" / "glossary.md").read_text()
ROWS = re.findall(r"^\| (?!term|---)([^|]+) \| ([^|]+) \| `([\w.]+)` \|$", GLOSSARY, re.M)


def test_no_two_classes_share_a_name() -> None:
    homes = defaultdict(list)
    for package in ("agent", "world", "protocol", "deploy", "wireswarm"):
        for file in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.ClassDef):
                    homes[node.name].append(str(file.relative_to(ROOT)))
    assert {name: files for name, files in homes.items() if len(files) > 1} == {}


@pytest.mark.parametrize(("term", "sentence", "home"), ROWS)
def test_the_glossary_gives_each_term_a_sentence_and_a_place_in_the_code(term: str, sentence: str, home: str) -> None:
    assert sentence.endswith(".") and term.strip()
    module, _, name = home.rpartition(".")
    if name[0].isupper():
        assert hasattr(import_module(module), name)
    else:
        import_module(home)


def test_the_glossary_names_each_term_once() -> None:
    terms = [term for term, _, _ in ROWS]
    assert len(terms) == len(set(terms)) == len(re.findall(r"^\| (?!term)[a-z]", GLOSSARY, re.M)) > 40
