"""Where a range image jumps: beams that hit both surfaces there return something between them."""

import numpy as np
from jaxtyping import Float


def behind_edges(image: Float[np.ndarray, "rows columns"], jump: float) -> Float[np.ndarray, "rows columns"]:
    """The range of a pixel beside where that is further by more than the jump; the own range elsewhere."""
    behind = image.copy()
    for one, other in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        for near, far in ((one, other), (other, one)):
            behind[near] = np.where(image[far] - image[near] > jump, image[far], behind[near])
    return behind
