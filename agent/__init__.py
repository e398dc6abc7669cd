"""One robot's mind: scan to corners, wireframe, filter, radio, alignment, cooperation, exploration, driving."""

import os

# Read when numba is imported. Vectorised loops gain nothing on arrays of a few dozen walls, and cost a fifth of the
# compile time.
os.environ.setdefault("NUMBA_LOOP_VECTORIZE", "0")
os.environ.setdefault("NUMBA_SLP_VECTORIZE", "0")
