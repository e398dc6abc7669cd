"""Strictly sparse (paper I): beyond perception, and the shells that hand it on, nothing touches a range."""

import ast
from pathlib import Path

import agent

PACKAGE = Path(agent.__file__).parent
MAY_READ = ("perception", "shell")


def reads_ranges(source: str) -> bool:
    """Whether a module asks an observation for its ranges."""
    asked = (node.attr for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Attribute))
    called = (
        node.func.attr
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and not node.args
    )
    return "ranges" in asked or "scan" in called


def test_only_perception_reads_ranges() -> None:
    readers = {
        file.relative_to(PACKAGE).parts[0]
        for file in PACKAGE.rglob("*.py")
        if reads_ranges(file.read_text(encoding="utf-8"))
    }
    assert readers - set(MAY_READ) == set()
    assert "perception" in readers
