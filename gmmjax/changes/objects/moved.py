"""Moved objects: pairs of a disappeared and an appeared change that a rigid transform lays onto each other."""

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Int
from scipy.optimize import linear_sum_assignment

from gmmjax.changes.change import Change
from gmmjax.changes.objects.match import Match, MatchSettings, best_match
from gmmjax.changes.objects.support_plane import SupportPlane, support_planes
from gmmjax.geometry import LocalSurface, evenly_chosen
from gmmjax.pair import Pair, each


@dataclasses.dataclass(frozen=True)
class MovedSettings:
    """Which disappeared and appeared changes are compared, and when they are one object.

    Attributes:
        sample: number of points of a change, at most, that are compared with another change. Empirical. Larger: slower.
        most_extent_ratio: changes whose longest extents differ by a greater factor are not compared. Empirical.
            Infinite: all are.
        most_count_ratio: the same, of their point counts. Empirical. Infinite: all are.
        match: when two changes are one object.
    """

    sample: int = 4000
    most_extent_ratio: float = 1.4
    most_count_ratio: float = 4.0
    match: MatchSettings = MatchSettings()


def with_moved(
    items: tuple[Change, ...],
    surfaces: Pair[LocalSurface],
    labels: Pair[Int[np.ndarray, " _"]],
    noise: float,
    settings: MovedSettings = MovedSettings(),
) -> tuple[Change, ...]:
    """The changes, where every pair of a disappeared and an appeared one that are one object has become "moved".

    Args:
        items: the changes of both clouds.
        surfaces: of both clouds, registered.
        labels: the change of each point, or -1.
        noise: standard deviation of the offset between local means of one surface: the registration error of
            `DetectionLimits`.
        settings: which changes are one object.
    """
    matches = _matches(items, surfaces, labels, noise, settings)
    moved = list(items)
    for i, j in _partners({pair: match.misfit for pair, match in matches.items()}):
        transform = matches[i, j].transform
        moved[i] = dataclasses.replace(items[i], kind="moved", partner=j, transform=transform)
        moved[j] = dataclasses.replace(items[j], kind="moved", partner=i, transform=transform)
    return tuple(moved)


def _matches(
    items: tuple[Change, ...],
    surfaces: Pair[LocalSurface],
    labels: Pair[Int[np.ndarray, " _"]],
    noise: float,
    settings: MovedSettings,
) -> dict[tuple[int, int], Match]:
    """The matches of all pairs of a disappeared and an appeared change that are one object."""
    gone = [index for index, change in enumerate(items) if change.kind == "disappeared"]
    new = [index for index, change in enumerate(items) if change.kind == "appeared"]
    if not gone or not new:
        return {}
    parts = {index: _part(surfaces.before, labels.before == index, settings) for index in gone}
    parts |= {index: _part(surfaces.after, labels.after == index, settings) for index in new}
    background = np.concatenate([*each(lambda surface, labels: surface.points[labels < 0], surfaces, labels)])
    planes = support_planes(list(parts.values()), background, noise, settings.match.upright.support)
    stood_on: dict[int, SupportPlane | None] = dict(zip(parts, planes, strict=True))
    matches = {}
    for i, j in ((i, j) for i in gone for j in new if _comparable(items[i], items[j], settings)):
        match = best_match(Pair(parts[i], parts[j]), surfaces, noise, Pair(stood_on[i], stood_on[j]), settings.match)
        if match is not None and match.one_object:
            matches[i, j] = match
    return matches


def _part(scene: LocalSurface, own: Bool[np.ndarray, " n"], settings: MovedSettings) -> LocalSurface:
    points = scene.points[own]
    return LocalSurface.of(points[evenly_chosen(len(points), settings.sample)])


def _comparable(gone: Change, new: Change, settings: MovedSettings) -> bool:
    """Whether two changes are of similar size."""
    extents = np.array([gone.box.extent[0], new.box.extent[0]])
    counts = np.array([gone.point_count, new.point_count])
    return bool(
        extents.max() <= settings.most_extent_ratio * extents.min()
        and counts.max() <= settings.most_count_ratio * counts.min()
    )


def _partners(misfits: Mapping[tuple[int, int], float]) -> list[tuple[int, int]]:
    """The assignment of the most pairs, and of those the least misfit; each change is in one pair at most."""
    gone, new = (sorted({pair[side] for pair in misfits}) for side in (0, 1))
    # A pair that is not one object costs 1, more than the misfit of any that is.
    table = np.array([[misfits.get((i, j), 1.0) for j in new] for i in gone]).reshape(len(gone), len(new))
    assigned = [(gone[row], new[column]) for row, column in zip(*linear_sum_assignment(table), strict=True)]
    return [pair for pair in assigned if pair in misfits]
