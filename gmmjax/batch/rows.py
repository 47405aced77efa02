"""The rows of the summary tables: one for each pair, one for each change."""

import dataclasses
from typing import Literal

from gmmjax.changes import Kind

PairStatus = Literal["done", "failed"]


@dataclasses.dataclass(frozen=True)
class PairRow:
    """A pair of a batch run in the summary. What is not known of a pair that failed is None.

    Attributes:
        name: of the pair.
        status: "done" or "failed".
        error: why it failed, in one line; empty where it is done.
        before: the file of the before cloud; None: the cloud was given as points.
        after: the file of the after cloud, likewise.
        points_before: number of points of the before cloud.
        points_after: number of points of the after cloud.
        changes: number of changes; a moved object counts once.
        appeared: number of objects that appeared.
        disappeared: number of objects that disappeared.
        moved: number of objects that moved.
        highest_probability: of its changes; None where there is none.
        restarts: random restarts of the fits, over which probabilities are averaged.
        standard_error: of the probabilities over the restarts, the largest of its changes; None where there is no
            change, only one restart, or a method that does not have it.
        settled: whether the probabilities had settled when `until_stable` ended it; None: that was not asked for.
        difference: by which the last doubling of the restarts changed a probability, the largest; None likewise.
        registration_applied: whether the after cloud was moved.
        registration_residual: median distance of unchanged surfaces, in the unit of the clouds.
        registration_overlap: share of the points of one cloud with a counterpart in the other, 0 to 1.
        registration_confidence: by which all probabilities are multiplied, 0 to 1.
        unobserved_before: share of the before cloud whose place the other survey did not observe, 0 to 1.
        unobserved_after: share of the after cloud, likewise.
        warnings: what looked wrong but could be used, a line each.
        seconds: wall time of the pair, without the time that it waited.
    """

    name: str
    status: PairStatus
    error: str = ""
    before: str | None = None
    after: str | None = None
    points_before: int | None = None
    points_after: int | None = None
    changes: int | None = None
    appeared: int | None = None
    disappeared: int | None = None
    moved: int | None = None
    highest_probability: float | None = None
    restarts: int | None = None
    standard_error: float | None = None
    settled: bool | None = None
    difference: float | None = None
    registration_applied: bool | None = None
    registration_residual: float | None = None
    registration_overlap: float | None = None
    registration_confidence: float | None = None
    unobserved_before: float | None = None
    unobserved_after: float | None = None
    warnings: str = ""
    seconds: float | None = None


@dataclasses.dataclass(frozen=True)
class ChangeRow:
    """A change of a pair in the summary. Lengths are in the unit of the clouds, in the frame of the before cloud.

    Attributes:
        name: of the pair.
        change: its index in the pair, which is also the label of its points.
        kind: "appeared", "disappeared" or "moved"; a moved object has two rows, one in each cloud.
        probability: that it is a change.
        standard_error: of that probability over the restarts, before the verdict; None where there is only one.
        moved_probability: of a moved object, that its partner is the same object.
        significance: by how many standard deviations its points exceed what the other cloud has there.
        point_count: points that belong to it.
        partner: of a moved object the index of the change that it was or became.
        centre_x: centre of its box.
        centre_y: likewise.
        centre_z: likewise.
        extent_1: longest edge of its box.
        extent_2: the next one.
        extent_3: the shortest one.
    """

    name: str
    change: int
    kind: Kind
    probability: float
    standard_error: float | None
    moved_probability: float | None
    significance: float
    point_count: int
    partner: int | None
    centre_x: float
    centre_y: float
    centre_z: float
    extent_1: float
    extent_2: float
    extent_3: float
