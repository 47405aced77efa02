"""The pairs in a folder, with their truth where they have it, for tuning."""

from pathlib import Path

import numpy as np

from gmmjax.changes import NAMES
from gmmjax.clouds import PointCloud, read_cloud
from gmmjax.errors import InputError
from gmmjax.evaluation import LabelledCloud, LabelledPair, cloud_file, pair_folders, pair_views, read_pair
from gmmjax.pair import Pair
from gmmjax.tuning.scan_pairs import ScanPair, unchanged_pair


def find_tuning_pairs(folder: Path, *, unchanged: bool = False) -> list[ScanPair]:
    """Reads all pairs in the folders of a folder; see `find_pairs` for what they hold. Truth may be missing.

    Points whose place the other survey could not see, and those of changes that are not counted, are not judged.

    Args:
        folder: that holds the pairs' folders.
        unchanged: nothing changed in the pairs without truth.

    Raises:
        InputError: no such folder, no pair in it, some pairs with truth and some without, or files that cannot be read
            or do not fit each other.
    """
    folders = pair_folders(folder)
    with_truth = [any((path / f"truth_{side}.npy").is_file() for side in ("before", "after")) for path in folders]
    if any(with_truth) and not all(with_truth) and not unchanged:
        names = ", ".join(path.name for path, labelled in zip(folders, with_truth, strict=True) if not labelled)
        raise InputError(
            f"{folder}: {names} have no truth, other pairs have; give truth for all, move them "
            "away, or say with unchanged=True (--unchanged) that nothing changed in them"
        )
    without = _unchanged if unchanged else _unlabelled
    return [
        scan_pair(read_pair(path)) if labelled else without(path)
        for path, labelled in zip(folders, with_truth, strict=True)
    ]


def scan_pair(pair: LabelledPair) -> ScanPair:
    """A labelled pair, for tuning."""
    return ScanPair(
        name=pair.name,
        before=pair.before.points,
        after=pair.after.points,
        truth_before=pair.before.truth,
        truth_after=pair.after.truth,
        ignored_before=_ignored(pair.before),
        ignored_after=_ignored(pair.after),
        views_before=pair.before.views,
        views_after=pair.after.views,
        unseen_before=_unseen(pair.before),
        unseen_after=_unseen(pair.after),
    )


def _ignored(cloud: LabelledCloud) -> np.ndarray:
    ignored = np.isin(cloud.truth, list(cloud.not_counted))
    return ignored if cloud.unseen is None else ignored | cloud.unseen


def _unseen(cloud: LabelledCloud) -> np.ndarray | None:
    """The points of changes that are not counted are not judged at all."""
    return None if cloud.unseen is None else cloud.unseen & ~np.isin(cloud.truth, list(cloud.not_counted))


def _unlabelled(folder: Path) -> ScanPair:
    return ScanPair(folder.name, *_clouds(folder))


def _unchanged(folder: Path) -> ScanPair:
    before, after = _clouds(folder)
    return unchanged_pair(folder.name, before, after, *(pair_views(folder, side) for side in NAMES))


def _clouds(folder: Path) -> Pair[PointCloud]:
    return Pair(*NAMES).map(lambda side: read_cloud(cloud_file(folder, side)))
