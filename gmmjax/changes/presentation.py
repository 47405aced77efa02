"""How a record of changes shows itself: report, plot, notebook. The one module that imports packages that come later.

They are imported when a method is called, and not before: a detection needs neither HTML nor plots.
"""

import dataclasses
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import ArrayLike

from gmmjax.changes.storage import OPTIONAL_FIGURES
from gmmjax.clouds import PointCloud, atomic_write, scan_bounds, within
from gmmjax.errors import InputError
from gmmjax.pair import Pair

if TYPE_CHECKING:
    from gmmjax.changes.record import Changes

GivenCloud = ArrayLike | PointCloud


class Presented(NamedTuple):
    """What is shown.

    Attributes:
        clouds: without the rows that have no position, and without stray points, which would be all that one sees.
        changes: with a label for each point of these clouds.
    """

    clouds: Pair[PointCloud]
    changes: "Changes"


def presented(changes: "Changes", before: GivenCloud | None = None, after: GivenCloud | None = None) -> Presented:
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


def _of_rows(changes: "Changes", time: str, rows: np.ndarray) -> "Changes":
    """The changes with the labels of some rows of one cloud."""
    names = [f"{name}_{time}" for name in ("labels", "probability", "unobserved", *OPTIONAL_FIGURES)]
    arrays = {name: getattr(changes, name) for name in names}
    kept: dict[str, Any] = {name: None if values is None else values[rows] for name, values in arrays.items()}
    return dataclasses.replace(changes, **kept)


def write_report(
    changes: "Changes", path: str | os.PathLike[str], before: GivenCloud | None, after: GivenCloud | None
) -> Path:
    """See `Changes.report`."""
    from gmmjax.reporting import report_html

    target = Path(path)
    if target.is_dir():
        raise InputError(f"{target}: is a folder; name the file, such as {target / 'report.html'}")
    clouds, shown = presented(changes, before, after)
    content = report_html(clouds.before, clouds.after, shown).encode()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(target) as file:
            file.write(content)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from error
    return target


def plotted(changes: "Changes", before: GivenCloud | None, after: GivenCloud | None, axes: Any) -> Any:
    """See `Changes.plot`."""
    from gmmjax.plotting import plot_overview

    return plot_overview(changes, before, after, axes=axes)


def notebook_html(changes: "Changes") -> str:
    """What a notebook shows in place of the `repr`: a table, and a picture where the clouds are known."""
    from gmmjax.reporting.notebook import changes_html

    if changes.clouds is None:
        return changes_html(changes, None)
    clouds, shown = presented(changes)
    return changes_html(shown, clouds)
