"""Who is let in, and who is not because another of its name is there."""

import pytest

from protocol import keys
from protocol.codec import encode
from protocol.messages import PROTOCOL_VERSION, Join
from world.shell.participants import Participants

THERE = "another r1 is there already"
NO_MORE = "its certificate does not count: it was revoked, or made after the world began"


def asks(there: Participants, session: str, process: str) -> str | None:
    """Why r1 is refused; None where it is let in."""
    return there.admit("r1", keys.JOIN, said(session, process))


def said(session: str, process: str) -> bytes:
    return encode(Join(version=PROTOCOL_VERSION, robot="r1", session=session, process=process))


@pytest.mark.parametrize(
    ("first", "second", "refused"),
    [
        (("0a", "01"), ("0b", "02"), THERE),
        (("0a", "01"), ("", "02"), THERE),
        (("", "01"), ("0b", "02"), THERE),
        (("", "01"), ("", "02"), THERE),
        (("", ""), ("", ""), THERE),  # nobody can tell whether it is the same
        (("0a", "01"), ("0a", "02"), None),  # of one secret, whose Zenoh ID one process at a time can have
        (("", "01"), ("", "01"), None),
    ],
)
def test_a_name_is_for_one_process_whatever_it_tells_of_itself(
    first: tuple[str, str], second: tuple[str, str], refused: str | None
) -> None:
    links = {first[0]} - {""}
    there = Participants(["r1"], {}, lambda: links)
    assert asks(there, *first) is None
    there.token_came("r1")
    assert asks(there, *second) == refused
    links.clear()
    there.token_went("r1")
    assert asks(there, *second) is None


def test_who_was_ready_and_has_gone_does_not_prepare() -> None:
    """Behind a router the world waited for it for five minutes."""
    there = Participants(["r1"], {})
    for goes in (lambda: there.token_went("r1"), lambda: there.dismiss("r1", said("0a", "01"))):
        assert asks(there, "0a", "01") is None and there.preparing == ["r1"]
        there.token_came("r1")
        assert (there.ready, there.preparing) == (["r1"], [])
        assert goes() is None and (there.ready, there.preparing, there.missing) == ([], [], ["r1"])
    assert asks(there, "0a", "01") is None and there.preparing == ["r1"]
    assert there.dismiss("r1", said("0a", "01")) is None and there.preparing == []


def test_a_token_from_before_a_process_is_let_in_is_not_its() -> None:
    """A robot that outlives its world shows its token to the next, before it asks and begins anew."""
    there = Participants(["r1"], {})
    there.token_came("r1")
    assert asks(there, "0a", "01") is None and (there.ready, there.preparing) == ([], ["r1"])
    there.token_went("r1")
    there.token_came("r1")
    assert there.ready == ["r1"]
    assert asks(there, "0a", "01") is None and there.ready == ["r1"]  # its link was lost, and is back


def test_a_world_that_goes_on_keeps_the_tokens_of_robots_that_its_log_does_not_tell_of() -> None:
    """Let in by the world before, they live in the run and never declare them anew; they were waited for in vain."""
    there = Participants(["r1"], {}, goes_on=True)
    there.token_came("r1")
    assert asks(there, "0a", "01") is None and (there.ready, there.preparing) == (["r1"], [])
    assert asks(there, "0a", "02") is None  # that token was of the one before
    assert (there.ready, there.preparing) == ([], ["r1"])


def test_a_refusal_among_many_robots_fits_into_a_message() -> None:
    there = Participants([f"r{number + 1}" for number in range(500)], {})
    refusal = there.admit("r501", keys.JOIN, encode(Join(version=PROTOCOL_VERSION, robot="r501")))
    assert refusal == "no r501 takes part, only r1, r2, r3, r4, r5, r6, r7, r8 and 492 more"


def test_who_asks_why_is_told_what_is_against_it_and_never_let_in() -> None:
    there = Participants(["r1", "r2"], {}, known={"r1": "0a"}.get)

    def why(**join: str) -> str | None:
        return there.why_not(encode(Join.model_validate({"version": PROTOCOL_VERSION} | join)))

    assert why(robot="r1", session="0a") is None
    assert why(robot="r1", session="0b") == why(robot="r2", session="0c") == NO_MORE
    assert why(robot="r3") == "no r3 takes part, only r1 and r2"
    assert "no msgpack" in str(there.why_not(b""))
    assert not there.sessions
