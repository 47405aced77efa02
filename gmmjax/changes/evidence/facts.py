"""The facts of a candidate: what the verdict is made from. A function each, without a unit.

The function measures a plain quantity, which the sentence puts into words. The verdict sees it on a scale on which
equal steps mean about the same: shares as they are, counts and ratios by their logarithm.
"""

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from gmmjax.changes.evidence.candidate import Candidate

Scale = Literal["share", "ratio", "count"]
Sign = Literal[-1, 0, 1]


class Fact(NamedTuple):
    """One quantity that is measured of every candidate.

    Attributes:
        measure: gives the quantity.
        sentence: that puts the quantity into words.
        scale: "share" from -1 to 1, as it is; "ratio" at least 0, by log(1 + x); "count" at least 1, by log x.
        change: 1 where more of it can only speak for a change, -1 where only against one, 0 where it depends.
        poses: whether it needs the views of the other survey.
    """

    measure: Callable[[Candidate], float]
    sentence: str
    scale: Scale
    change: Sign = 0
    poses: bool = False

    def scaled(self, value: float) -> float:
        """The quantity as the verdict sees it."""
        if self.scale == "share":
            return value
        return math.log1p(max(value, 0.0)) if self.scale == "ratio" else math.log(max(value, 1.0))

    def in_words(self, value: float) -> str:
        """The quantity in a sentence."""
        return self.sentence.format(value)


def count(candidate: Candidate) -> float:
    """Number of points, from 1."""
    return float(len(candidate.rows))


def thickness(candidate: Candidate) -> float:
    """Standard deviation along its shortest axis, in spacings, from 0."""
    return float(candidate.deviations[0])


def compactness(candidate: Candidate) -> float:
    """Its shortest axis by its longest one, 0 to 1: 0 for all that is flat."""
    return float(candidate.deviations[0] / max(candidate.deviations[2], 1e-9))


def fill(candidate: Candidate) -> float:
    """Points for each square spacing of its extent, from 0: few for a frayed one."""
    return len(candidate.rows) / max(1.0, float(candidate.deviations[1] * candidate.deviations[2]))


def distance(candidate: Candidate) -> float:
    """Median distance to the other cloud, in the distance that is surely a change there, from 0."""
    return float(np.median(candidate.relative_distance))


def least_distance(candidate: Candidate) -> float:
    """The same, of the nearest tenth."""
    return float(np.quantile(candidate.relative_distance, 0.1))


def greatest_distance(candidate: Candidate) -> float:
    """The same, of the farthest tenth."""
    return float(np.quantile(candidate.relative_distance, 0.9))


def offset(candidate: Candidate) -> float:
    """Median offset from the other cloud's surface, in the offset that is surely a change there, from 0."""
    return float(np.median(candidate.relative_offset))


def offset_from_nearby(candidate: Candidate) -> float:
    """Median offset by that of the unchanged points nearby: a local level of detection (Lague et al. 2013), from 0."""
    nearby = candidate.offsets_nearby
    if not len(nearby):
        return 1.0
    difference = candidate.surroundings.own.difference
    error = max(float(np.median(nearby)), candidate.surroundings.limits.registration_error / 10)
    return float(np.median(difference.offset[candidate.rows])) / error


def displaced(candidate: Candidate) -> float:
    """Share of its points surely off the other cloud's surface opposite them, to one side: eroded ground, 0 to 1."""
    return float(candidate.displaced.mean())


def gap(candidate: Candidate) -> float:
    """Median distance to the other cloud, in spacings, from 0; what is displaced counts as at that of a sure change.

    The surface that eroded ground is displaced from may be nearer than the next point: its distance tells nothing.
    """
    share, sure = displaced(candidate), candidate.surroundings.limits.settings.spacings
    return float((1 + np.median(candidate.to_other)) ** (1 - share) * (1 + sure) ** share - 1)


def greatest_gap(candidate: Candidate) -> float:
    """Largest distance to the other cloud, in spacings, from 0."""
    return float(candidate.to_other.max())


def excess(candidate: Candidate) -> float:
    """Mean posterior of the joint mixture that only its own cloud has it, 0 to 1."""
    return candidate.excess.mean


def agreement(candidate: Candidate) -> float:
    """How nearly two restarts agree in that posterior, the mean over all pairs of them, 0 to 1."""
    return 1.0 - _mean_difference(candidate.excess.of_restarts)


def contact(candidate: Candidate) -> float:
    """Share of its points next to unchanged ones of its own cloud, 0 to 1."""
    return float((candidate.to_unchanged < candidate.surroundings.settings.contact).mean())


def apartness(candidate: Candidate) -> float:
    """Distance to the unchanged points of its own cloud, of the farthest tenth, in spacings, from 0."""
    return float(np.quantile(candidate.to_unchanged, 0.9))


def one_sided(candidate: Candidate) -> float:
    """How far the other cloud around it lies to one side, 0 (all around) to 1 (in one direction, or nothing there)."""
    directions = candidate.directions
    return float(np.linalg.norm(directions.mean(axis=0))) if len(directions) else 1.0


def surrounded(candidate: Candidate) -> float:
    """Share of all directions in which the other cloud lies around it, 0 to 1."""
    directions = candidate.directions
    if not len(directions):
        return 0.0
    looked = sphere_directions(candidate.surroundings.settings.directions)
    return len(np.unique((directions @ looked.T).argmax(axis=1))) / len(looked)


def behind(candidate: Candidate) -> float:
    """Share of the other cloud around it on the emptier side of its plane, 0 to 0.5."""
    return min(_sides(candidate))


def in_front(candidate: Candidate) -> float:
    """Share of the other cloud around it on the fuller side of its plane, 0 to 1."""
    return max(_sides(candidate))


def other_around(candidate: Candidate) -> float:
    """Points of the other cloud around it for each of its own, from 0."""
    return candidate.around_count / len(candidate.rows)


def interspersed(candidate: Candidate) -> float:
    """Points of the other cloud among its own, for each of these, from 0: clutter of which both have some points."""
    return candidate.interspersed_count / len(candidate.rows)


def continued(candidate: Candidate) -> float:
    """Share of its points that continue an unchanged surface beside it into a hole of the other cloud, 0 to 1."""
    return float(candidate.continuation.continued.mean())


def at_edge(candidate: Candidate) -> float:
    """Share of its points on walls at the edge of the other cloud's coverage, 0 to 1."""
    return float(candidate.continuation.at_edge.mean())


def shown(candidate: Candidate) -> float:
    """Share of its footprint where the other cloud has the bare surface that it stands on, and its own less, 0 to 1."""
    return candidate.continuation.shown


def beyond(candidate: Candidate) -> float:
    """Share of its points outside of the convex hull of the other cloud, 0 to 1."""
    return float((candidate.beyond_hull > 1).mean())


def roughness(candidate: Candidate) -> float:
    """Deviation of its points from the planes through their neighbours, in spacings, from 0: foliage, flying pixels."""
    return candidate.roughness


def other_spacing(candidate: Candidate) -> float:
    """Spacing of the other cloud there by its spacing elsewhere, from 0."""
    difference = candidate.surroundings.own.difference
    return float(np.median(difference.spacing[candidate.rows])) / candidate.spacing


def other_roughness(candidate: Candidate) -> float:
    """Deviation of the other cloud there from the planes through its neighbours, in spacings, from 0."""
    difference = candidate.surroundings.own.difference
    return float(np.median(difference.thickness[candidate.rows])) / candidate.spacing


def supports(candidate: Candidate) -> float:
    """Share of its points on a level surface that a candidate of the other cloud stands on, 0 to 1."""
    return float(candidate.surroundings.supports[candidate.rows].mean())


def opposite_nearby(candidate: Candidate) -> float:
    """Points of the other cloud's candidates around it for each of its own, from 0: a shadow, or an old place."""
    return candidate.count_beside(candidate.surroundings.opposite) / len(candidate.rows)


def opposite_contact(candidate: Candidate) -> float:
    """Share of its points beside candidates of the other cloud, 0 to 1; none where these stand on it, and hide it."""
    hidden = supports(candidate) * (1 - displaced(candidate))
    return float(candidate.beside(candidate.surroundings.opposite).mean()) * (1 - hidden)


def differing_nearby(candidate: Candidate) -> float:
    """Share of its own cloud in its neighbourhood that is of candidates, 0 to 1: much where coverage differs."""
    around = candidate.surroundings
    everything = candidate.count_in_neighbourhood(around.everything)
    return candidate.count_in_neighbourhood(around.differing) / max(everything, 1)


def other_differing_nearby(candidate: Candidate) -> float:
    """Share of the other cloud in its neighbourhood that is of candidates, 0 to 1: what it hides, or was there."""
    around = candidate.surroundings
    return candidate.count_in_neighbourhood(around.opposite) / max(candidate.count_in_neighbourhood(around.other), 1)


def differing_overall(candidate: Candidate) -> float:
    """Share of its own cloud, by area, that is of candidates, 0 to 1: much where the surveys cover different places."""
    areas = candidate.surroundings.areas
    return areas.differing / areas.everything


def differing_elsewhere(candidate: Candidate) -> float:
    """Share of what differs in its own cloud, by area, that is of others, 0 (the only candidate) to 1 (one of many)."""
    return 1 - candidate.area / max(candidate.surroundings.areas.differing, candidate.area)


def of_cluster(candidate: Candidate) -> float:
    """Its share of the points of the cluster that it was cut from, 0 to 1."""
    return len(candidate.rows) / len(candidate.cluster_rows)


def seen_free(candidate: Candidate) -> float:
    """Share of its points in free space of the other survey, 0 to 1."""
    return _share_observed(candidate, 1)


def seen_surface(candidate: Candidate) -> float:
    """Share of its points where the other survey saw a surface, 0 to 1."""
    return _share_observed(candidate, 0)


def not_seen(candidate: Candidate) -> float:
    """Share of its points whose place the other survey did not observe, 0 to 1."""
    return _share_observed(candidate, -1)


def unreached(candidate: Candidate) -> float:
    """Share of its points that no line of sight of the other survey reached, however near its surfaces are, 0 to 1."""
    return float((candidate.sightlines.reached == 0).mean())


def free_by_offset(candidate: Candidate) -> float:
    """Share of its points where the other survey saw a surface at another offset, 0 to 1: what is thin, or shifted."""
    assert candidate.observed is not None
    return float(((candidate.observed == 0) & (candidate.relative_offset >= 1)).mean())


def seen_through(candidate: Candidate) -> float:
    """Share of the lines of sight to it that passed through its place, of those that reached it or were blocked."""
    through, blocked = (float(own.sum()) for own in candidate.sightlines[:2])
    return through / max(through + blocked, 1.0)


def depth_beyond(candidate: Candidate) -> float:
    """How far beyond its place the other survey saw, of the deepest half, in the distance that is surely a change."""
    return float(np.quantile(candidate.sightlines.beyond, 0.75))


def cluster_free(candidate: Candidate) -> float:
    """Share of the cluster that it was cut from in free space of the other survey, 0 to 1."""
    free = candidate.surroundings.own.free
    assert free is not None
    return float(free[candidate.cluster_rows].mean())


def free_nearby(candidate: Candidate) -> float:
    """Points of its cloud's candidates in free space of the other survey around it, by these and its own, 0 to 1."""
    free = candidate.count_beside(candidate.surroundings.in_free_space)
    return free / (free + len(candidate.rows))


def free_contact(candidate: Candidate) -> float:
    """Share of its points beside such points, 0 to 1: the hidden side of what was seen through."""
    return float(candidate.beside(candidate.surroundings.in_free_space).mean())


FACTS: dict[str, Fact] = {
    "count": Fact(count, "it has {:.0f} points at the resolution of the comparison", "count", 1),
    "thickness": Fact(thickness, "it is {:.1f} spacings of points thick (standard deviation)", "ratio"),
    "compactness": Fact(compactness, "its thickness is {:.0%} of its length", "share"),
    "fill": Fact(fill, "{:.1f} points fill each square spacing of its extent", "ratio"),
    "distance": Fact(distance, "half of it is {:.1f} times as far from the other scan as noise explains", "ratio", 1),
    "least_distance": Fact(
        least_distance, "nearly all of it is {:.1f} times as far from the other scan as noise explains", "ratio", 1
    ),
    "greatest_distance": Fact(
        greatest_distance, "a tenth of it is {:.1f} times as far from the other scan as noise explains", "ratio"
    ),
    "offset": Fact(offset, "half of it is {:.1f} times as far off the other scan's surface as noise explains", "ratio"),
    "offset_from_nearby": Fact(
        offset_from_nearby, "it is {:.1f} times as far off the other scan as the surfaces nearby", "ratio", 1
    ),
    "displaced": Fact(displaced, "{:.0%} of it lies surely off the other scan's surface, on one side", "share", 1),
    "gap": Fact(
        gap, "it is {:.1f} spacings of points from the other scan, where displaced points count as changed", "ratio"
    ),
    "greatest_gap": Fact(greatest_gap, "its farthest point is {:.0f} spacings of points from the other scan", "ratio"),
    "excess": Fact(excess, "the mixture gives {:.0%} of it to its own scan alone", "share", 1),
    "agreement": Fact(agreement, "the restarts agree on {:.0%} of that", "share"),
    "contact": Fact(contact, "{:.0%} of it touches unchanged surfaces", "share"),
    "apartness": Fact(apartness, "it reaches {:.0f} spacings of points away from unchanged surfaces", "ratio"),
    "one_sided": Fact(one_sided, "the other scan around it lies to {:.0%} on one side", "share"),
    "surrounded": Fact(surrounded, "the other scan lies around it in {:.0%} of all directions", "share"),
    "behind": Fact(behind, "{:.0%} of the other scan around it lies behind it", "share"),
    "in_front": Fact(in_front, "{:.0%} of the other scan around it lies in front of it", "share"),
    "other_around": Fact(other_around, "the other scan has {:.1f} points around it for each of its own", "ratio"),
    "interspersed": Fact(interspersed, "the other scan has {:.1f} points among its own for each of these", "ratio"),
    "continued": Fact(continued, "{:.0%} of it continues surfaces that did not change", "share", -1),
    "at_edge": Fact(at_edge, "{:.0%} of it is a wall at the edge of what the other scan covers", "share", -1),
    "shown": Fact(shown, "the other scan shows {:.0%} of the surface that it stands on bare", "share", 1),
    "beyond": Fact(beyond, "{:.0%} of it lies outside of all that the other scan reaches", "share"),
    "roughness": Fact(roughness, "its surface is rough by {:.1f} spacings of points", "ratio"),
    "other_spacing": Fact(other_spacing, "the other scan is {:.1f} times as sparse there as usual", "ratio"),
    "other_roughness": Fact(other_roughness, "the other scan is rough by {:.1f} spacings of points there", "ratio"),
    "supports": Fact(supports, "{:.0%} of it is what a change of the other scan stands on", "share", -1),
    "opposite_nearby": Fact(
        opposite_nearby, "candidates of the other scan have {:.1f} points around it for each of its own", "ratio"
    ),
    "opposite_contact": Fact(opposite_contact, "{:.0%} of it lies beside candidates of the other scan", "share"),
    "differing_nearby": Fact(differing_nearby, "{:.0%} of its own scan around it differs from the other", "share"),
    "other_differing_nearby": Fact(
        other_differing_nearby, "{:.0%} of the other scan around it differs from its own", "share"
    ),
    "differing_overall": Fact(differing_overall, "{:.0%} of its whole scan differs from the other", "share"),
    "differing_elsewhere": Fact(differing_elsewhere, "{:.0%} of what differs in its scan lies elsewhere", "share"),
    "of_cluster": Fact(of_cluster, "it is {:.0%} of what differs there", "share"),
    "seen_free": Fact(seen_free, "{:.0%} of it lies where the other survey saw through", "share", 1, poses=True),
    "seen_surface": Fact(
        seen_surface, "{:.0%} of it lies where the other survey saw a surface", "share", 0, poses=True
    ),
    "not_seen": Fact(not_seen, "{:.0%} of it lies where the other survey saw nothing", "share", -1, poses=True),
    "unreached": Fact(unreached, "no line of sight of the other survey reached {:.0%} of it", "share", -1, poses=True),
    "free_by_offset": Fact(
        free_by_offset, "{:.0%} of it is off the surface that the other survey saw there", "share", 1, poses=True
    ),
    "seen_through": Fact(
        seen_through, "{:.0%} of the other survey's lines of sight there passed through it", "share", 1, poses=True
    ),
    "depth_beyond": Fact(
        depth_beyond,
        "the other survey saw {:.1f} times the distance of a sure change beyond it",
        "ratio",
        1,
        poses=True,
    ),
    "cluster_free": Fact(
        cluster_free, "the other survey saw through {:.0%} of what differs there", "share", 1, poses=True
    ),
    "free_nearby": Fact(
        free_nearby,
        "what the other survey saw through around it makes up {:.0%} of that and it together",
        "share",
        1,
        poses=True,
    ),
    "free_contact": Fact(
        free_contact, "{:.0%} of it lies beside what the other survey saw through", "share", 1, poses=True
    ),
}


def names_of(*, poses: bool) -> tuple[str, ...]:
    """The names of the facts that can be measured.

    Args:
        poses: whether the views of the other survey are known.
    """
    return tuple(name for name, fact in FACTS.items() if poses or not fact.poses)


def measured(candidate: Candidate) -> dict[str, float]:
    """All facts of a candidate, by name."""
    return {name: FACTS[name].measure(candidate) for name in names_of(poses=candidate.observed is not None)}


def scaled(values: dict[str, float]) -> Float[np.ndarray, " f"]:
    """The facts as the verdict sees them, in the order of their names."""
    return np.array([FACTS[name].scaled(value) for name, value in values.items()])


def sphere_directions(number: int) -> Float[np.ndarray, "d 3"]:
    """Unit directions, evenly spread over the sphere: a Fibonacci lattice."""
    index = np.arange(number) + 0.5
    height, angle = 1 - 2 * index / number, np.pi * (1 + np.sqrt(5)) * index
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def _mean_difference(values: Float[np.ndarray, " r"]) -> float:
    """The mean absolute difference of two of the values, over all pairs of them (Gini's); 0 of a single one."""
    count = len(values)
    if count < 2:
        return 0.0
    # In how many pairs a value is the larger one, less those in which it is the smaller one.
    signs = 2 * np.arange(count) - (count - 1)
    return float((signs * np.sort(values)).sum() / (count * (count - 1) / 2))


def _sides(candidate: Candidate) -> tuple[float, float]:
    """The share of the other cloud around a candidate on either side of its plane, beyond its thickness."""
    if len(candidate.around) < candidate.surroundings.settings.min_around:
        return 0.0, 0.0
    heights = candidate.around @ candidate.normal / candidate.spacing
    clear = 2 * (candidate.deviations[0] + 1)
    return float((heights > clear).mean()), float((heights < -clear).mean())


def _share_observed(candidate: Candidate, kind: int) -> float:
    assert candidate.observed is not None
    return float((candidate.observed == kind).mean())
