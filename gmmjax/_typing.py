"""The array type of the public records."""

import jax
import numpy as np

Array = jax.Array | np.ndarray
"""JAX arrays inside traced code; NumPy arrays, in float64, as host functions return them."""
