"""Settings of a robot's process."""

from protocol.settings import Config, NotNegative, Positive


class JoinConfig(Config):
    """How long a robot looks for its world."""

    join_timeout_s: Positive = 10.0
    """Seconds that a robot tries to reach a world at its start. A world that starts with it is up after 1 to 5 s."""
    reconnect_s: NotNegative = 2.0
    """Seconds that a robot waits for a world that is gone. One that restarts is found 0.5 s after it is up."""
