"""`gmmjax evaluate scenes`."""

from collections.abc import Callable, Sequence
from typing import Literal

from tyro.conf import OmitArgPrefixes

from gmmjax.cli.evaluation import Options, run_evaluation, seed_range
from gmmjax.errors import InputError


def command(arguments: Sequence[str]) -> Callable[..., int]:
    """`evaluate_scenes`, whatever the arguments."""
    del arguments
    return evaluate_scenes


def evaluate_scenes(
    *,
    families: tuple[str, ...] = (),
    poses: tuple[Literal["given", "unknown"], ...] = ("given", "unknown"),
    seeds: int = 5,
    first_seed: int = 0,
    common: OmitArgPrefixes[Options] = Options(),
) -> int:
    """Score detectors on simulated surveys of places of many kinds, by depth cameras and laser scanners.

    Args:
        families: kinds of places, such as rooms, station, corridors; default all. A wrong name lists them.
        poses: whether the detectors are told where the sensor stood.
        seeds: scenes of each family.
        first_seed: first seed of the scenes; the others follow.
        common: to all evaluations.
    """
    from gmmjax.evaluation import family_sources
    from gmmjax.scenes import FAMILIES

    common.check()
    if unknown := [name for name in families if name not in FAMILIES]:
        raise InputError(f"--families {' '.join(unknown)}: there is no such family; choose from {', '.join(FAMILIES)}")
    chosen = seed_range(first_seed, seeds)
    sources = [source for known in poses for source in family_sources(families or tuple(FAMILIES), chosen, poses=known)]
    return run_evaluation(sources, common, evidence=True)
