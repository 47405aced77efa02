"""A record beside its clouds, as reports and plots take them."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from gmmjax.changes.record import Changes, GivenCloud
from gmmjax.changes.storage import OPTIONAL_FIGURES
from gmmjax.clouds import PointCloud, scan_bounds, within
from gmmjax.errors import InputError
from gmmjax.pair import Pair


class Presented(NamedTuple):
    """Content that is shown.

    Attributes:
        clouds: without the rows that have no position, and without stray points, which would be all that one sees.
        changes: with a label for each point of these clouds.
    """

    clouds: Pair[PointCloud]
    changes: Changes


def presented(changes: Changes, before: GivenCloud | None = None, after: GivenCloud | None = None) -> Presented:
    """The changes with their clouds, in a form that reports and plots take.

    Args:
        changes: what was found.
        before: the before cloud that they were found in; None: the one that they remember.
        after: the same for the after cloud.

    Raises:
        InputError: clouds that are not known, or are not those of the changes.
    """
    remembered: Pair[Any] = changes.clouds or Pair(None, None)
    given = Pair(remembered.before if before is None else before, remembered.after if after is None else after)
    for name, cloud in zip(("before", "after"), given, strict=True):
        if cloud is None:
            raise InputError(
                f"{name}: the changes do not know their clouds, as after Changes.load: give before and after, the "
                "clouds that they were found in"
            )
    clouds = given.map(lambda cloud: cloud if isinstance(cloud, PointCloud) else PointCloud.from_rows(cloud))
    for time, cloud, own in (("before", clouds.before, given.before), ("after", clouds.after, given.after)):
        rows = len(cloud) if isinstance(own, PointCloud) else len(cloud) + cloud.rows_dropped
        labels = getattr(changes, f"labels_{time}")
        if rows != len(labels):
            raise InputError(
                f"{time}: has {rows:,} points, the changes have labels for {len(labels):,}; give the clouds that the "
                "changes were found in"
            )
        if rows != len(cloud):
            changes = _of_rows(changes, time, cloud.rows)
    for time, cloud in (("before", clouds.before), ("after", clouds.after)):
        # A stray point is no part of a change, unless the comparison was cropped to its place.
        shown = within(cloud.points, scan_bounds(cloud.points)) | (getattr(changes, f"labels_{time}") >= 0)
        if not shown.all():
            changes = _of_rows(changes, time, np.flatnonzero(shown))
            clouds = dataclasses.replace(clouds, **{time: cloud.part(np.flatnonzero(shown))})
    return Presented(clouds, changes)


def _of_rows(changes: Changes, time: str, rows: np.ndarray) -> Changes:
    """The changes with the labels of some rows of one cloud."""
    names = [f"{name}_{time}" for name in ("labels", "probability", "unobserved", *OPTIONAL_FIGURES)]
    arrays = {name: getattr(changes, name) for name in names}
    kept: dict[str, Any] = {name: None if values is None else values[rows] for name, values in arrays.items()}
    return dataclasses.replace(changes, **kept)
