"""Settings of perception."""

from typing import Literal

from protocol.settings import Config

Segmentation = Literal["piecewise", "split-and-merge"]


class PerceptionConfig(Config):
    """From a lidar scan to corners."""

    method: Segmentation = "piecewise"
    """How a scan is cut into straight pieces: an optimal piecewise fit (ours), or the paper's split and merge (its
    ref. 17)."""
