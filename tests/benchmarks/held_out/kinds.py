"""The kinds of held-out scenes, as sources of labelled pairs."""

import functools
import itertools
import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import numpy as np

from gmmjax.errors import check_choice
from gmmjax.evaluation import LabelledCloud, PairSource
from tests.benchmarks.held_out import indoors, outdoors
from tests.benchmarks.held_out.surveys import HeldOutPair, Staged, labelled

Poses = Literal["given", "unknown"]
CHANGED, UNCHANGED = "changed", "unchanged"
KINDS: Mapping[str, Callable[[np.random.Generator, bool], Staged]] = {
    "room": indoors.room,
    "hard_room": indoors.hard_room,
    "single_frame": indoors.single_frame,
    "misregistered_room": indoors.misregistered_room,
    "station": indoors.station,
    "corridor": indoors.corridor,
    "two_sensors": indoors.two_sensors,
    "half_overlap": indoors.half_overlap,
    "turned_chair": indoors.turned_chair,
    "box_by_3_cm": indoors.box_by_3_cm,
    "box_by_10_cm": indoors.box_by_10_cm,
    "laid_table": indoors.laid_table,
    "opened_door": indoors.opened_door,
    "pulled_drawer": indoors.pulled_drawer,
    "airborne": outdoors.airborne,
    "street": outdoors.street,
}


def held_out_sources(
    kinds: Sequence[str] = tuple(KINDS), seeds: Sequence[int] = (0,), poses: Sequence[Poses] = ("unknown", "given")
) -> list[PairSource]:
    """Scenes that changed and scenes that did not, of every kind and seed.

    Args:
        kinds: keys of `KINDS`.
        seeds: a scene of either condition for each.
        poses: whether the detectors are given the sensors' poses; the points are the same.

    Returns:
        Sources whose group is the kind with the poses, whose condition is "changed" or "unchanged".

    Raises:
        InputError: an unknown kind.
    """
    for kind in kinds:
        check_choice("kind", kind, tuple(KINDS))
    return [
        PairSource(
            f"{kind} {seed}",
            f"{kind}, poses {known}",
            condition,
            functools.partial(held_out_pair, kind, seed, condition == CHANGED, known),
        )
        for kind in kinds
        for known in poses
        for condition in (CHANGED, UNCHANGED)
        for seed in seeds
    ]


def held_out_pair(kind: str, seed: int, changed: bool, poses: Poses = "given") -> HeldOutPair:
    """One scene, drawn from the seed; where nobody can be asked to find any of its changes, another is drawn."""
    for attempt in itertools.count():
        random = np.random.default_rng([zlib.crc32(kind.encode()), seed, changed, *([attempt] if attempt else [])])
        pair = labelled(f"{kind} {seed}", KINDS[kind](random, changed), random, given=poses == "given")
        if not changed or _findable(pair.before) or _findable(pair.after):
            break
    return pair


def _findable(cloud: LabelledCloud) -> bool:
    return bool(set(np.unique(cloud.truth)) - {-1} - cloud.not_counted)
