"""The kinds of scenes, each drawn from a seed."""

import zlib
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from gmmjax.errors import check_choice
from tests.benchmarks.surveyor.halls import hall_site
from tests.benchmarks.surveyor.quarries import quarry_site
from tests.benchmarks.surveyor.slopes import slope_site
from tests.benchmarks.surveyor.surveys import Errors, Site, SurveyedPair, surveyed
from tests.benchmarks.surveyor.tunnels import tunnel_site
from tests.benchmarks.surveyor.warehouses import warehouse_site

# The coordinates of one in three scenes are a national grid's, of this reference system.
GRID, GRID_CODE = (433_120.0, 5_411_760.0, 312.0), 25832


class Kind(NamedTuple):
    """How scenes are made.

    Attributes:
        site: from everything random, and whether anything changed, to what is surveyed.
        errors: of putting the clouds together.
    """

    site: Callable[[np.random.Generator, bool], Site]
    errors: Errors


KINDS: Mapping[str, Kind] = {
    "hall": Kind(hall_site, Errors()),
    "slope": Kind(slope_site, Errors(0.002, 0.001, 0.005, 0.002)),
}
HELD_OUT: Mapping[str, Kind] = {
    "warehouse": Kind(warehouse_site, Errors(0.002, 0.004, 0.003, 0.005)),
    "quarry": Kind(quarry_site, Errors(0.002, 0.001, 0.005, 0.002)),
    "tunnel": Kind(tunnel_site, Errors(0.001, 0.002, 0.004, 0.004)),
}


def simulated(kind: str, seed: int, points: int, *, changed: bool = True) -> SurveyedPair:
    """A scene of any kind; its unchanged twin differs in nothing but what changed.

    Args:
        kind: of `KINDS` or `HELD_OUT`.
        seed: of everything.
        points: about so many a side.
        changed: whether anything did.

    Raises:
        InputError: an unknown kind.
    """
    random = drawn_from(kind, seed)
    made = kind_of(kind)
    return surveyed(f"{kind} {seed}", made.site(random, changed), points, made.errors, _offset(seed), random)


def hall_scene(seed: int, points: int, stations: int | None = None, changed: bool = True) -> SurveyedPair:
    """A hall of 30 to 40 m with pallets, boxes and pipes.

    Args:
        seed: of everything.
        points: about so many a side.
        stations: of either survey; None: one to three, by the seed.
        changed: whether anything did.
    """
    random = drawn_from("hall", seed)
    site = hall_site(random, changed, stations)
    return surveyed(f"hall {seed}", site, points, KINDS["hall"].errors, _offset(seed), random)


def slope_scene(seed: int, points: int, changed: bool = True) -> SurveyedPair:
    """A rock slope of 50 to 200 m, from one or two stations at its foot; see `simulated`."""
    return simulated("slope", seed, points, changed=changed)


def kind_of(name: str) -> Kind:
    """The kind of a name.

    Raises:
        InputError: there is none.
    """
    every = {**KINDS, **HELD_OUT}
    check_choice("kind", name, tuple(every))
    return every[name]


def drawn_from(kind: str, seed: int) -> np.random.Generator:
    """What a scene is drawn from."""
    return np.random.default_rng([zlib.crc32(kind.encode()), seed])


def _offset(seed: int) -> tuple[float, float, float]:
    return GRID if seed % 3 == 2 else (0.0, 0.0, 0.0)
