"""docs/protocol.md: whether it says what travels."""

import re

import pytest

from protocol import keys
from protocol.messages import PROTOCOL_VERSION, WORLD_EVENTS, Message
from tests.protocol.transcript import PAGE, captured, page

TEXT = PAGE.read_text(encoding="utf-8")
MESSAGES = Message.__subclasses__()
WITHIN = {
    "RobotSpec": "Welcome",
    "LidarSpec": "Welcome",
    "OdometrySpec": "Welcome",
    "Event": "Action",
    "TeammatePose": "PoseReport",
    "LinkReport": "LinkTable",
}
"""Messages that are fields of another one, in whose rows they are told."""


def rows_of(message: str) -> str:
    """Rows of a table that begin with the message, or have nothing before its fields."""
    found = re.search(rf"^\|[^|]*`{message}`[^|]*\|.*\n(\| \|.*\n)*", TEXT, re.M)
    assert found, f"no row begins with {message}"
    return found[0]


def test_the_captured_run_is_what_travels_today() -> None:
    assert page()[1] == captured(), "python -m tests.protocol.transcript captures it anew"


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
def test_every_field_of_every_message_is_in_its_rows(kind: type[Message]) -> None:
    rows = rows_of(WITHIN.get(kind.__name__, kind.__name__))
    assert [name for name in kind.model_fields if not re.search(rf"`(\w+\.)*{name}`", rows)] == []


def test_the_page_has_the_events_that_are_no_robots() -> None:
    assert [event for event in sorted(WORLD_EVENTS) if f"`{event}`" not in rows_of("Action")] == []


def test_the_page_has_every_key_and_the_version() -> None:
    assert f"This is version {PROTOCOL_VERSION}." in TEXT
    services = (keys.service("ID", name) for name in (keys.JOIN, keys.LEAVE, keys.WHY))
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
