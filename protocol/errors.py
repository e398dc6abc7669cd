"""What can go wrong between processes, each as one sentence for a user."""

from __future__ import annotations


class ProtocolError(ValueError):
    """Bytes that are no valid message: malformed, too large, not finite, or of another version."""


class LinkError(RuntimeError):
    """No session, or the other side is gone; says what to check."""


class RefusedError(LinkError):
    """The world answered, and does not let this robot in; says why."""
