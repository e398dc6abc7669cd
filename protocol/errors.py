"""The one error of everything that comes from a network."""

from __future__ import annotations


class ProtocolError(ValueError):
    """Bytes that are no valid message: malformed, too large, not finite, or of another version."""
