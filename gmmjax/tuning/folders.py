"""The pairs in a folder, with their truth where they have it, for tuning."""

from pathlib import Path

import numpy as np

from gmmjax.clouds import read_cloud
from gmmjax.errors import InputError
from gmmjax.evaluation import LabelledCloud, LabelledPair, cloud_file, pair_folders, read_pair
from gmmjax.tuning.scan_pairs import ScanPair


def find_tuning_pairs(folder: Path) -> list[ScanPair]:
    """Reads all pairs in the folders of a folder; see `find_pairs` for what they hold. Truth may be missing.

    Points whose place the other survey could not see, and those of changes that are not counted, are not judged.

    Args:
        folder: that holds the pairs' folders.

    Raises:
        InputError: no such folder, no pair in it, some pairs with truth and some without, or files that cannot be read
            or do not fit each other.
    """
    folders = pair_folders(folder)
    with_truth = [any((path / f"truth_{side}.npy").is_file() for side in ("before", "after")) for path in folders]
    if any(with_truth) and not all(with_truth):
        names = ", ".join(path.name for path, labelled in zip(folders, with_truth, strict=True) if not labelled)
        raise InputError(f"{folder}: {names} have no truth, other pairs have; give truth for all, or move them away")
    return [scan_pair(read_pair(path)) if with_truth[0] else _unlabelled(path) for path in folders]


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
    )


def _ignored(cloud: LabelledCloud) -> np.ndarray:
    ignored = np.isin(cloud.truth, list(cloud.not_counted))
    return ignored if cloud.unseen is None else ignored | cloud.unseen


def _unlabelled(folder: Path) -> ScanPair:
    return ScanPair(folder.name, read_cloud(cloud_file(folder, "before")), read_cloud(cloud_file(folder, "after")))
