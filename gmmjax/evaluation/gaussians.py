"""The artificial scenes of thesis 4.6.1 and harder ones of the same kind, as labelled pairs."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import jax
from jaxtyping import PRNGKeyArray

from gmmjax.errors import check_choice
from gmmjax.evaluation.labelled_pair import LabelledCloud, LabelledPair, PairSource
from gmmjax.scenes import OVERLAPS, GaussianScene, Overlap, random_scene, replaced_scene

POINTS = 1000
SPARSE = 0.4
SHIFT = 0.1
SEPARATION = 2.0


@dataclasses.dataclass(frozen=True)
class Condition:
    """The changes in a scene of five Gaussians.

    Attributes:
        appeared: new Gaussians.
        disappeared: Gaussians that are gone.
        overlap: of the Gaussians.
        separation: distance of the new Gaussian from the one that is gone, standard deviations; None: anywhere.
        points: drawn from each Gaussian.
        density: of the after cloud, by that of the before cloud.
        shift: standard deviation on each axis of a displacement of the whole after cloud, metres.
    """

    appeared: int
    disappeared: int
    overlap: Overlap
    separation: float | None = None
    points: int = POINTS
    density: float = 1.0
    shift: float = 0.0

    def __str__(self) -> str:
        """As in the thesis, (-1 +1) low, and what is beyond it."""
        parts = [f"-{self.disappeared}"] * (self.disappeared > 0) + [f"+{self.appeared}"] * (self.appeared > 0)
        more = [f"{self.separation:g} sd apart"] if self.separation is not None else []
        more += [f"{self.points} points"] if self.points != POINTS else []
        more += [f"density {self.density:g}"] if self.density != 1 else []
        more += [f"shift {self.shift:g}"] if self.shift else []
        return ", ".join([f"({' '.join(parts) or 'none'}) {self.overlap}", *more])


def _of_overlaps(appeared: int, disappeared: int, **more: Any) -> tuple[Condition, ...]:
    return tuple(Condition(appeared, disappeared, overlap, **more) for overlap in OVERLAPS)


# The conditions of figure 4.9, nothing, and three with more changes.
NUMBERS = ((1, 0), (2, 0), (0, 1), (0, 2), (1, 1), (0, 0), (2, 2), (3, 1), (1, 3))
CONDITIONS = tuple(condition for numbers in NUMBERS for condition in _of_overlaps(*numbers))
GAUSSIAN_FAMILIES: Mapping[str, tuple[Condition, ...]] = {
    "thesis": CONDITIONS,
    "separation": tuple(
        condition for apart in (0.25, 0.5, 1.0, 2.0) for condition in _of_overlaps(1, 1, separation=apart)
    ),
    "few-points": tuple(
        condition for few in (60, 200) for condition in _of_overlaps(1, 1, separation=SEPARATION, points=few)
    ),
    "sparse": (*_of_overlaps(1, 1, separation=SEPARATION, density=SPARSE), *_of_overlaps(1, 1, density=SPARSE)),
    "shifted": (*_of_overlaps(1, 1, separation=SEPARATION, shift=SHIFT), *_of_overlaps(1, 1, shift=SHIFT)),
}


def gaussian_sources(
    seeds: Sequence[int], families: Sequence[str] = ("thesis",), *, points: int | None = None
) -> list[PairSource]:
    """The scenes of every condition and seed.

    Args:
        seeds: one scene of every condition for each.
        families: names in `GAUSSIAN_FAMILIES`.
        points: drawn from each Gaussian; None: as the condition says.

    Raises:
        InputError: an unknown family.
    """
    for family in families:
        check_choice("family", family, tuple(GAUSSIAN_FAMILIES))
    sources = []
    for family in families:
        for known in GAUSSIAN_FAMILIES[family]:
            condition = dataclasses.replace(known, points=points or known.points)
            for seed in seeds:
                load = functools.partial(gaussian_pair, condition, seed)
                sources.append(PairSource(f"seed {seed}", family, str(condition), load))
    return sources


def gaussian_pair(condition: Condition, seed: int) -> LabelledPair:
    """One scene, drawn from the seed."""
    scene = _scene(condition, jax.random.key(seed))
    return LabelledPair(
        f"seed {seed}",
        LabelledCloud(scene.before, scene.truth_before, things=scene.gaussians_before),
        LabelledCloud(scene.after, scene.truth_after, things=scene.gaussians_after),
    )


def _scene(condition: Condition, key: PRNGKeyArray) -> GaussianScene:
    common: dict[str, Any] = {
        "overlap": condition.overlap,
        "points": condition.points,
        "density": condition.density,
        "shift": condition.shift,
    }
    if condition.separation is not None:
        return replaced_scene(key, separation=condition.separation, **common)
    return random_scene(key, appeared=condition.appeared, disappeared=condition.disappeared, **common)
