"""`gmmjax evaluate gaussians`."""

from collections.abc import Callable, Sequence
from typing import Literal

from tyro.conf import OmitArgPrefixes

from gmmjax.cli.evaluation import Options, fitting, run_evaluation, seed_range

Family = Literal["thesis", "separation", "few-points", "sparse", "shifted"]


def command(arguments: Sequence[str]) -> Callable[..., int]:
    """`evaluate_gaussians`, whatever the arguments."""
    del arguments
    return evaluate_gaussians


def evaluate_gaussians(
    *,
    families: tuple[Family, ...] = ("thesis",),
    conditions: tuple[str, ...] = ("*",),
    seeds: int = 10,
    first_seed: int = 0,
    points: int | None = None,
    common: OmitArgPrefixes[Options] = Options(),
) -> int:
    """Score detectors on artificial scenes of five Gaussians: precision, recall, F1, false segments, times.

    Args:
        families: "thesis": (+1) (+2) (-1) (-2) (-1 +1) (none) (-2 +2) (-1 +3) (-3 +1) with low and medium overlap;
            "separation": one gone and one new, 0.25 to 2 standard deviations apart; "few-points": the same with 60 and
            200 points; "sparse": an after cloud 0.4 times as dense; "shifted": one displaced by 0.1 m on each axis.
        conditions: only those whose names fit one of these patterns, such as '(-1 +1)*' or '*medium*'.
        seeds: scenes of each condition.
        first_seed: first seed of the scenes; the others follow.
        points: points drawn from each Gaussian; default the condition's own, 1,000 unless it says otherwise.
        common: to all evaluations.
    """
    from gmmjax.errors import InputError
    from gmmjax.evaluation import gaussian_sources

    common.check()
    if points is not None and points < 1:
        raise InputError(f"--points {points} must be at least 1")
    sources = gaussian_sources(seed_range(first_seed, seeds), families, points=points)
    return run_evaluation(fitting(sources, conditions), common, evidence=False)
