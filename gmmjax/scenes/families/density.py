"""How many points two surveys of a scene have."""

import numpy as np

from gmmjax.pair import Pair, each
from gmmjax.scenes.recording import Recording


def drawn_density(
    random: np.random.Generator,
    recordings: Pair[Recording],
    *,
    most: tuple[int, int] = (12_000, 40_000),
    least: int = 5_000,
    fused: float = 0.7,
) -> Pair[Recording]:
    """The recordings fused in voxels or thinned, half of the time to densities of up to ten to one.

    Args:
        random: of everything.
        recordings: of the two surveys.
        most: between how many points the denser one has, where it has so many.
        least: that the other one keeps.
        fused: share of the clouds that are fused in voxels; the others keep points drawn at random.
    """
    points = int(random.uniform(*most))
    ratio = float(np.exp(random.uniform(0, np.log(10)))) if random.random() < 0.5 else 1.0
    counts = (points, max(least, int(points / ratio)))
    ordered = Pair(*(counts if random.random() < 0.5 else counts[::-1]))
    fuses = random.random(2) < fused
    return each(
        lambda recording, count, fuse: _reduced(random, recording, count, bool(fuse)), recordings, ordered, Pair(*fuses)
    )


def _reduced(random: np.random.Generator, recording: Recording, points: int, fuse: bool) -> Recording:
    return recording.fused_to(points) if fuse else recording.thinned(points, random)
