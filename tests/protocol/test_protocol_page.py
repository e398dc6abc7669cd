"""docs/protocol.md: whether it says what travels."""

import re

import pytest

from protocol import keys
from protocol.messages import PROTOCOL_VERSION, Message
from tests.protocol.transcript import PAGE, captured, page

TEXT = PAGE.read_text(encoding="utf-8")
MESSAGES = Message.__subclasses__()


def test_the_captured_run_is_what_travels_today() -> None:
    assert page()[1] == captured(), "python -m tests.protocol.transcript captures it anew"


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
def test_every_field_of_every_message_is_on_the_page(kind: type[Message]) -> None:
    assert [name for name in kind.model_fields if not re.search(rf"\b{name}\b", TEXT)] == []


def test_the_page_has_every_key_and_the_version() -> None:
    assert f"This is version {PROTOCOL_VERSION}." in TEXT
    services = (keys.service("ID", name) for name in (keys.JOIN, keys.LEAVE))
    told = [
        keys.WORLD_ALIVE,
        keys.CLOCK,
        keys.LINKS,
        keys.PROGRESS,
        keys.SITE,
        keys.WHEREABOUTS,
        keys.alive("ID"),
        *services,
    ]
    told += [keys.to_robot("ID", channel) for channel in keys.INPUTS]
    told += [keys.from_robot("ID", channel) for channel in (*keys.NEEDED, keys.SCAN)]
    assert [key for key in told if f"`{key}`" not in TEXT] == []
