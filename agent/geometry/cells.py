"""An index of things by the cell in which they lie."""

import numpy as np

from agent.kernels import kernel
from protocol.arrays import Ints


@kernel
def by_cell(cells: Ints, count: int) -> tuple[Ints, Ints]:
    """Things in the order of their cells (n,): where each of `count` cells begins (count + 1,), and the rows (n,)."""
    begins = np.zeros(count + 1, np.int64)
    begins[1:] = np.cumsum(np.bincount(cells, minlength=count))
    return begins, np.argsort(cells, kind="mergesort")
