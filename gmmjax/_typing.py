"""The array type of the public records."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

if TYPE_CHECKING:
    # The type checker knows no common interface of JAX's and NumPy's arrays; type and shape are checked at run time.
    from typing import Any

    Array = Any
else:
    import jax

    Array = jax.Array | np.ndarray
    """JAX arrays inside traced code; NumPy arrays, in float64, as host functions return them."""

Scalar = Float[Array, ""] | float
"""A number, or an array that holds one."""
