"""The offset between both scans around a change, where nothing changed: the registration error and the noise there."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64
from scipy import stats

from gmmjax.changes.objects.difference_cells import smoothed


@dataclasses.dataclass(frozen=True)
class OffsetSettings:
    """How the offset in the surroundings of a change is measured.

    All values are empirical: they come from development on the scenes of `tests/benchmarks/volumes`.

    Attributes:
        blocks: the surroundings are divided into blocks of the area of the change by this number, whose means differ by
            noise and registration. 1: few blocks, and an uncertain uncertainty.
        fewest_blocks: number of blocks, at least, by which the surroundings count. It is at least 2.
        outlying: cells of the surroundings that are this many robust standard deviations off their median are no
            unchanged surface. Infinite: changes beside the change distort it.
    """

    blocks: int = 4
    fewest_blocks: int = 5
    outlying: float = 4.0


class Offset(NamedTuple):
    """What both scans differ by where nothing changed, in the unit of the scans.

    Attributes:
        value: by how much the after scan is above the before scan.
        error: its standard error, common to all cells.
        density: variance of the mean difference of an area, times the area in cells.
        freedom: degrees of freedom of these.
    """

    value: float
    error: float
    density: float
    freedom: float


def without_spikes(
    difference: Float64[np.ndarray, "r c"],
    core: Bool[np.ndarray, "r c"],
    around: Bool[np.ndarray, "r c"],
    settings: OffsetSettings = OffsetSettings(),
) -> Float64[np.ndarray, "r c"]:
    """With the median about them for cells, beyond the labelled ones, that stand out: single points off the surface.

    Args:
        difference: of each cell, in the unit of the scans; NaN where it is not known.
        core: the labelled cells.
        around: the cells of the surroundings.
        settings: what stands out.
    """
    off = difference - smoothed(difference)
    known = off[around & np.isfinite(off)]
    if not len(known):
        return difference
    spread = float(stats.median_abs_deviation(known, scale="normal"))
    spikes = (np.abs(off) > settings.outlying * spread) & ~core & (spread > 0)
    return np.where(spikes, difference - off, difference)


def surroundings_offset(
    difference: Float64[np.ndarray, "r c"],
    around: Bool[np.ndarray, "r c"],
    area: int,
    registration_error: float,
    settings: OffsetSettings = OffsetSettings(),
) -> Offset:
    """What both scans differ by in the surroundings, weighed against what is expected of the registration.

    Args:
        difference: of each cell, in the unit of the scans; NaN where it is not known.
        around: the cells of the surroundings.
        area: of the change, in cells.
        registration_error: standard deviation that is expected.
        settings: of the blocks.
    """
    nothing = Offset(0.0, registration_error, 0.0, np.inf)
    around = around & np.isfinite(difference)
    if around.sum() < settings.fewest_blocks:
        return nothing
    values = difference[around]
    middle = np.median(values)
    spread = stats.median_abs_deviation(values, scale="normal")
    rows, columns = np.nonzero(around)
    unchanged = np.abs(values - middle) <= settings.outlying * spread
    edge = max(1.0, np.sqrt(area / settings.blocks))
    blocks = np.unique(np.stack([rows // edge, columns // edge]), axis=1, return_inverse=True)[1].ravel()[unchanged]
    values, counts = values[unchanged], np.bincount(blocks)
    # The smallest pieces of the surroundings say little.
    large = counts >= max(1.0, counts.max() / 3)
    if large.sum() < settings.fewest_blocks:
        return nothing
    means, weights = (np.bincount(blocks, values) / np.maximum(counts, 1))[large], counts[large]
    mean = float(np.average(means, weights=weights))
    freedom = float(len(means) - 1)
    density = float((weights * (means - mean) ** 2).sum() / freedom)
    variance, expected = density / weights.sum(), registration_error**2
    if variance + expected == 0:
        return Offset(mean, 0.0, 0.0, freedom)
    trust = expected / (expected + variance)
    return Offset(trust * mean, float(np.sqrt(trust * variance)), density, freedom)
