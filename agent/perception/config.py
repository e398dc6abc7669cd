"""Settings of perception."""

from typing import Literal

from protocol.settings import Config

Method = Literal["piecewise", "split-and-merge"]


class PerceptionConfig(Config):
    """From a lidar scan to corners."""

    method: Method = "piecewise"
    """How a scan is cut into straight pieces: an optimal piecewise fit (ours), or the paper's split and merge (its
    ref. 17)."""
