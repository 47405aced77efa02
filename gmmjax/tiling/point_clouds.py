"""Points of scans of any size as point clouds, with what the files state that they are of."""

import dataclasses

import numpy as np
from jaxtyping import Float64, Int64

from gmmjax.clouds import ChunkedCloud, CloudFile, CroppedCloud, PointCloud, SurveyFiles


def all_points(cloud: ChunkedCloud) -> PointCloud:
    """All points of a cloud, in memory."""
    points, rows = zip(*cloud.chunks(), strict=True)
    return named_cloud(np.concatenate(points), np.concatenate(rows), cloud)


def named_cloud(points: Float64[np.ndarray, "n 3"], rows: Int64[np.ndarray, " n"], cloud: ChunkedCloud) -> PointCloud:
    """Points of a cloud, with what its files state."""
    whole = uncropped(cloud)
    unit, crs = (getattr(whole, name, None) for name in ("unit", "crs"))
    return PointCloud(points, rows, source=source_of(whole), unit=unit, crs=crs)


def with_colors(points: PointCloud, cloud: ChunkedCloud) -> PointCloud:
    """Points of a cloud with the colours of their rows or, where its files have none, with their intensity.

    Args:
        points: with the rows that they are from.
        cloud: that they are of; it is read once more, where it is of files with either.

    Raises:
        InputError: as `CloudFile.colors_or_intensity`.
    """
    whole = uncropped(cloud)
    found = whole.colors_or_intensity(points.rows) if isinstance(whole, CloudFile | SurveyFiles) else None
    if found is None:
        return points
    return dataclasses.replace(points, **({"colors": found} if found.ndim == 2 else {"fields": {"intensity": found}}))


def uncropped(cloud: ChunkedCloud) -> ChunkedCloud:
    """The cloud that a cropped one is of; any other one itself."""
    return uncropped(cloud.cloud) if isinstance(cloud, CroppedCloud) else cloud


def source_of(cloud: ChunkedCloud) -> str | None:
    """The name of a file, or of those of a survey; None for arrays."""
    if isinstance(cloud, SurveyFiles):
        return cloud.title if len(cloud.files) > 1 else str(cloud.files[0].path)
    return str(cloud.path) if isinstance(cloud, CloudFile) else None
