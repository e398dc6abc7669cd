"""One robot's mind: scan to corners, wireframe, filter, radio, alignment, cooperation, exploration, driving."""

import os

# Read when numba is imported. To put like statements together gains nothing here and takes time to compile. Loops stay
# vectorised: over the rows of a joint covariance that takes an eighth of a step's time off.
os.environ.setdefault("NUMBA_SLP_VECTORIZE", "0")
