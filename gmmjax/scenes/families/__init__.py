"""Families of simulated places, each drawn from ranges so wide that the real world is one more sample."""

import zlib
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from gmmjax.errors import check_choice
from gmmjax.scenes.families.apartments import apartments
from gmmjax.scenes.families.corridors import corridors
from gmmjax.scenes.families.doors import doors
from gmmjax.scenes.families.earthworks import earthworks
from gmmjax.scenes.families.halls import depots, halls, yards
from gmmjax.scenes.families.room_surveys import small_motions
from gmmjax.scenes.families.rooms import kitchens, rooms
from gmmjax.scenes.families.station import station
from gmmjax.scenes.families.tabletop import tabletop
from gmmjax.scenes.families.terrain import terrain
from gmmjax.scenes.families.town import town
from gmmjax.scenes.surveyed_scene import SurveyedScene

_FAMILIES = (
    *(rooms, kitchens, tabletop, doors, small_motions, terrain, town, station),
    *(corridors, halls, apartments, yards, depots, earthworks),
)
# What each family's name makes from a random generator.
FAMILIES: Mapping[str, Callable[[np.random.Generator], SurveyedScene]] = MappingProxyType(
    {family.__name__: family for family in _FAMILIES}
)


def family_scene(name: str, seed: int) -> SurveyedScene:
    """One scene of a family; the same name and seed give the same scene.

    Args:
        name: of the family, one of `FAMILIES`.
        seed: at least 0.

    Raises:
        InputError: no such family.
    """
    check_choice("family", name, tuple(FAMILIES))
    # The name's own number, so that the scenes of two families with the same seed have nothing in common.
    return FAMILIES[name](np.random.default_rng([seed, zlib.crc32(name.encode())]))
