"""Errors between processes. The text of each is one sentence for a user."""


class InputError(ValueError):
    """Something that a person gave is wrong, such as a file or an option; the text says what to do."""


class ProtocolError(ValueError):
    """Bytes that are no valid message: malformed, too large, not finite, or of another version."""


class LinkError(RuntimeError):
    """There is no session, or the other side is gone; the text says what to check."""


class Interrupted(Exception):  # noqa: N818
    """Somebody asked this process to stop; no error."""


class RefusedError(LinkError):
    """The world answered and does not let this robot in; the text says why."""
