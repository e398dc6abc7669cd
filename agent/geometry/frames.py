"""From the robot's frame into that of its pose, and back."""

from __future__ import annotations

import math

import numpy as np

from protocol.arrays import Floats

PoseXYT = tuple[float, float, float]


def moved(points: Floats, pose: PoseXYT) -> Floats:
    """Points (n, 2) of the robot's frame, in the frame of its pose."""
    return np.asarray(points @ _axes(pose) + np.array(pose[:2]), np.float64)


def seen_from(points: Floats, pose: PoseXYT) -> Floats:
    """Points (n, 2) of the frame of a robot's pose, in the robot's own."""
    return np.asarray((points - np.array(pose[:2])) @ _axes(pose).T, np.float64)


def _axes(pose: PoseXYT) -> Floats:
    """(2, 2) the robot's axes as rows, in the frame of its pose."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.array(((c, s), (-s, c)))
