"""`gmmjax evaluate laboratory`."""

from collections.abc import Callable, Sequence
from typing import Literal

from tyro.conf import OmitArgPrefixes

from gmmjax.cli.evaluation import Options, fitting, run_evaluation, seed_range


def command(arguments: Sequence[str]) -> Callable[..., int]:
    """`evaluate_laboratory`, whatever the arguments."""
    del arguments
    return evaluate_laboratory


def evaluate_laboratory(
    *,
    levels: tuple[Literal["normal", "hard"], ...] = ("normal",),
    surveys: tuple[Literal["panorama", "frame"], ...] = ("panorama",),
    poses: tuple[Literal["given", "unknown"], ...] = ("given", "unknown"),
    conditions: tuple[str, ...] = ("*",),
    seeds: int = 5,
    first_seed: int = 0,
    common: OmitArgPrefixes[Options] = Options(),
) -> int:
    """Score detectors on simulated surveys of a room of 2 m, by a depth camera, in which objects of 0.3 m change.

    Args:
        levels: "hard" has more noise and misregistration, and a quarter of the frames is lost.
        surveys: "panorama": 16 frames from around the room; "frame": a single one.
        poses: whether the detectors are told where the camera stood.
        conditions: only those that fit one of these patterns: (+1) (+2) (+3) (-1) (-2) (-1 +1) (-2 +2) (moved) (none).
        seeds: scenes of each condition.
        first_seed: first seed of the scenes; the others follow.
        common: to all evaluations.
    """
    from gmmjax.evaluation import laboratory_sources

    common.check()
    chosen = seed_range(first_seed, seeds)
    sources = [
        source
        for survey in surveys
        for level in levels
        for known in poses
        for source in laboratory_sources(chosen, level=level, survey=survey, poses=known)
    ]
    return run_evaluation(fitting(sources, conditions), common, evidence=True)
