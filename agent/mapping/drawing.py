"""A map as it was drawn last, and how often it has changed (ours)."""

import numpy as np

from protocol.wireframe import Wireframe

LIKELIER = 0.25
"""A wall whose likelihood changed by less is as likely as before: peers are told changes of two sevenths and more."""
MOVED_M = 0.01  # a corner that moved by less along either axis has not changed: maps travel on a grid of this size


class Drawing:
    """A wireframe with a number that rises whenever a new one takes its place."""

    def __init__(self) -> None:
        """Begin without walls."""
        self.wireframe, self.version = Wireframe(), 0

    def replace(self, new: Wireframe) -> None:
        """Take a new wireframe, whatever it holds."""
        self.wireframe, self.version = new, self.version + 1

    def update(self, new: Wireframe) -> bool:
        """Take a new wireframe if it differs from the present one; whether it does."""
        changed = new is not self.wireframe and not _alike(new, self.wireframe)
        if changed:
            self.replace(new)
        return changed


def _alike(new: Wireframe, old: Wireframe) -> bool:
    """Whether two maps have the same walls in the same places, to MOVED_M, as likely, and seen by the same."""
    return (
        np.array_equal(new.labels, old.labels)
        and np.array_equal(new.edges, old.edges)
        and np.array_equal(new.own, old.own)
        and (not len(new.edges) or float(np.abs(new.likelihood - old.likelihood).max()) < LIKELIER)
        and (not len(new.points) or float(np.abs(new.points - old.points).max()) < MOVED_M)
    )
