"""Names for the types of arrays. Shapes, units and frames stand in the docstring of each function."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Labels = NDArray[np.uint8]  # of protocol.wireframe.Label
Records = NDArray[np.void]  # rows with named fields, such as walls of the filter or pieces of a scan
