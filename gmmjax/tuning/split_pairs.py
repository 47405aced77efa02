"""Split of the pairs into those trained on and those held out."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gmmjax.changes import DetectionConfig
from gmmjax.errors import warn
from gmmjax.tuning.scan_pairs import ReadyPair, ScanPair, ready_pair
from gmmjax.tuning.settings import TuningSettings


class SplitPairs(NamedTuple):
    """Pairs made ready: those that are trained on, those that are held back, and the names of both."""

    training: list[ReadyPair]
    held_back: list[ReadyPair]
    names: tuple[tuple[str, ...], tuple[str, ...]]


def split_pairs(
    pairs: Sequence[ScanPair],
    config: DetectionConfig,
    settings: TuningSettings,
    progress: Callable[[str, float], None],
) -> SplitPairs:
    """The pairs made ready, a share of them held back.

    Args:
        pairs: as given.
        config: everything that is not tuned.
        settings: which share is held back.
        progress: called with what is being done and the share of the work that is done.

    Raises:
        InputError: a pair that cannot be compared; it is named.

    Warns:
        InputWarning: fewer than three pairs: those that are trained on are also held back.
    """
    unlabelled = settings.loss == "likelihood"
    ready = []
    for number, pair in enumerate(pairs):
        progress(f"Preparing {pair.name}", 0.05 * number / len(pairs))
        # Held-out points are drawn only where the truth is not looked at.
        own = dataclasses.replace(pair, truth_before=None, truth_after=None) if unlabelled else pair
        ready.append(ready_pair(own, config, settings.max_points, settings.seed + number))
    if len(pairs) < 3:
        warn(
            f"{len(pairs)} pairs are too few to hold one back: the tuned settings are judged by the pairs that they "
            "were tuned on; give three or more"
        )
        training = held_back = list(range(len(pairs)))
    else:
        training, held_back = _split([_changed(pair) for pair in pairs], settings)
    return SplitPairs(
        [ready[number] for number in training],
        [ready[number] for number in held_back],
        (tuple(pairs[number].name for number in training), tuple(pairs[number].name for number in held_back)),
    )


def _changed(pair: ScanPair) -> bool:
    return any(truth is not None and bool((truth >= 0).any()) for truth in (pair.truth_before, pair.truth_after))


def _split(changed: Sequence[bool], settings: TuningSettings) -> tuple[list[int], list[int]]:
    """Split into training and held-out pairs: the same share of those with changes and of those without."""
    generator = np.random.default_rng(settings.seed)
    kinds = [np.flatnonzero(np.asarray(changed) == kind) for kind in (True, False)]
    # In an order in which every stretch has its share of both kinds.
    places = np.concatenate([(np.arange(len(kind)) + 0.5) / max(len(kind), 1) for kind in kinds])
    order = np.concatenate([generator.permutation(kind) for kind in kinds])[np.argsort(places, kind="stable")]
    count = min(len(changed) - 1, max(1, round(settings.validation_share * len(changed))))
    return sorted(order[count:].tolist()), sorted(order[:count].tolist())
