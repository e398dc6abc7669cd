"""An index of things by the cell in which they lie."""

import numpy as np

from agent.kernels import kernel
from protocol.arrays import Ints


@kernel
def by_cell(cells: Ints, count: int) -> tuple[Ints, Ints]:
    """Things in the order of their cells (n,): where each of `count` cells begins (count + 1,), and the rows (n,)."""
    begins = np.zeros(count + 1, np.int64)
    for cell in cells:
        begins[cell + 1] += 1
    for cell in range(count):
        begins[cell + 1] += begins[cell]
    rows, filled = np.empty(len(cells), np.int64), begins.copy()
    for row, cell in enumerate(cells):
        rows[filled[cell]] = row
        filled[cell] += 1
    return begins, rows
