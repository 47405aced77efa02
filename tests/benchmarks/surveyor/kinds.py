"""The kinds of scenes, each drawn from a seed."""

import zlib
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from gmmjax.errors import InputError
from tests.benchmarks.surveyor.halls import hall_site
from tests.benchmarks.surveyor.slopes import slope_site
from tests.benchmarks.surveyor.surveys import Errors, SurveyedPair, surveyed

# One in three scenes has the coordinates of a national grid.
GRID = (433_120.0, 5_411_760.0, 312.0)


class Simulated(Protocol):
    """Makes a scene of about so many points a side from a seed; its unchanged twin differs only in what changed."""

    def __call__(self, seed: int, points: int, *, changed: bool = True) -> SurveyedPair:
        """See the class."""


def hall_scene(seed: int, points: int, stations: int | None = None, changed: bool = True) -> SurveyedPair:
    """A hall of 30 to 40 m.

    Args:
        seed: of everything.
        points: about so many a side.
        stations: of either survey; None: one to three, by the seed.
        changed: whether anything did.
    """
    random = _random("hall", seed)
    count = int(random.integers(1, 4))
    site = hall_site(random, count if stations is None else stations, changed)
    return surveyed(f"hall {seed}", site, points, Errors(offset=_offset(seed)), random)


def slope_scene(seed: int, points: int, changed: bool = True) -> SurveyedPair:
    """A rock slope of 50 to 200 m, from one or two stations at its foot.

    Args:
        seed: of everything.
        points: about so many a side.
        changed: whether anything did.
    """
    random = _random("slope", seed)
    site = slope_site(random, changed)
    errors = Errors(0.002, 0.001, 0.005, 0.002, _offset(seed))
    return surveyed(f"slope {seed}", site, points, errors, random)


KINDS: Mapping[str, Simulated] = {"hall": hall_scene, "slope": slope_scene}
HELD_OUT: Mapping[str, Simulated] = {}


def simulated(kind: str, seed: int, points: int, *, changed: bool = True) -> SurveyedPair:
    """A scene of any kind.

    Raises:
        InputError: an unknown kind.
    """
    every = {**KINDS, **HELD_OUT}
    if kind not in every:
        raise InputError(f"kind: {kind!r} is unknown; choose from {', '.join(every)}")
    return every[kind](seed, points, changed=changed)


def _random(kind: str, seed: int) -> np.random.Generator:
    return np.random.default_rng([zlib.crc32(kind.encode()), seed])


def _offset(seed: int) -> tuple[float, float, float]:
    return GRID if seed % 3 == 2 else (0.0, 0.0, 0.0)
