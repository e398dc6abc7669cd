"""What a mind must not forget, as arrays that come from a file and are checked."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

State = Mapping[str, NDArray[Any]]
"""Arrays by name; none of objects."""
LARGEST = 1e12
"""No number of a mind is larger."""


def checked(state: State, name: str, like: NDArray[Any], rows: bool = False) -> NDArray[Any]:
    """An array of a state with the type and shape of another, finite. rows: it may have another number of rows.

    Raises ValueError or LookupError.
    """
    array = state[name]
    if array.dtype != like.dtype or array.shape[rows:] != like.shape[rows:] or array.ndim != like.ndim:
        raise ValueError(f"{name} has a wrong type or shape")
    if not (np.abs(array) <= LARGEST).all():  # NaN is not
        raise ValueError(f"{name} has a number that is not finite or too large")
    return array
