"""Colours and marks, the same in the picture and on the page."""

from protocol.wireframe import Label

INK = "#1f2933"
FAINT = "#7b8794"
RULE = "#d9dee4"
SOLID = "#d3d8de"
"""Walls of the true world."""
SOLID_EDGE = "#aab2bd"

ROBOTS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#8a6d00", "#56b4e9", "#6a3d9a", "#7a4b2a")
"""Okabe and Ito's palette for the colour-blind, ordered by contrast with white and with each other."""

OPEN = "#e0003c"
"""Of frontiers, where colours and not marks tell vertices apart."""

MARKS = {Label.NOMINAL: "o", Label.OCCLUSION: "^", Label.FRONTIER: "s"}
"""As in figures 2 and 3 of the paper: circle, triangle, square."""


def colour(index: int) -> str:
    """Colour of the robot of that number, from 0."""
    return ROBOTS[index % len(ROBOTS)]


STROKE_PX = 2.2
"""Width of a map's walls in the overview, and distance between the maps of two robots that lie side by side."""

BAND_PX = 9.0  # largest width of all maps side by side: with many robots, lines get thinner


def stroke(robots: int) -> float:
    """Width of a map's walls where so many maps lie side by side, in pixels of a plan 900 pixels wide."""
    return min(STROKE_PX, BAND_PX / max(robots, 1))
