"""The history of the objects of a series of epochs of one place: when each came, moved and went."""

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from gmmjax.batch.comparison import Comparison
from gmmjax.batch.linking import SAME_OBJECT, Linker
from gmmjax.batch.places import Place
from gmmjax.batch.rows import ObjectRow
from gmmjax.batch.tracks import EpochTree, Sighting, Track
from gmmjax.changes import Box
from gmmjax.errors import InputError
from gmmjax.geometry import transformed
from gmmjax.pair import Pair

EventKind = Literal["came", "moved", "went"]
# Fields of an event that are columns of its row.
SHARED = ("kind", "probability", "moved_probability", "distance", "returned", "change", "overlap", "point_count")


@dataclasses.dataclass(frozen=True, eq=False)
class ObjectEvent:
    """What became of an object between two epochs. Lengths are in the unit of the clouds.

    Attributes:
        kind: "came", "moved" or "went".
        epoch: index of the first epoch in which it shows.
        previous: index of the latest epoch before that in which it was known to be otherwise: the one before, unless
            epochs between are missing, or did not observe the place.
        probability: of the change that shows it. Where no change shows it, that of the latest change before: an object
            that appeared against the first epoch has gone when it no longer appears, and that is no change.
        moved_probability: of an object that moved, or is back elsewhere, that it is the same; None where it was not
            computed.
        box: where the object is from then on, or was until then where it went; in the frame of the history.
        origin: of an object that moved, where it was; else None.
        distance: of an object that moved, how far its centre did; else None.
        point_count: points of that change.
        comparison: the epochs of the comparison that shows it.
        change: index of the change in that comparison; None where the want of one shows it.
        overlap: of the object's known points and those of the change, by which the two were linked: the share of the
            smaller one; 1 where that was not needed. None without a change.
        returned: of an object that came, whether it had been there before, and gone: something of its shape is in the
            same place again, or it is recognised in another one as moved since the epoch compared with.
    """

    kind: EventKind
    epoch: int
    previous: int
    probability: float
    moved_probability: float | None
    box: Box
    origin: Box | None
    distance: float | None
    point_count: int
    comparison: Pair[int]
    change: int | None
    overlap: float | None
    returned: bool = False


@dataclasses.dataclass(frozen=True, eq=False)
class ObjectHistory:
    """An object that came, moved or went in a series.

    Attributes:
        number: of the object, from 1, by the time of its first event.
        epochs: the names of the epochs of the series.
        frame: index of the epoch in whose frame its coordinates are: the first one, or the first one after a gap that
            no comparison bridges.
        events: in the order of time, at least one.
        presence: of each epoch whether it was there; None where that is not known.
    """

    number: int
    epochs: tuple[str, ...]
    frame: int
    events: tuple[ObjectEvent, ...]
    presence: tuple[bool | None, ...]


def object_histories(epochs: Sequence[str], comparisons: Iterable[Comparison]) -> list[ObjectHistory]:
    """The objects that came, moved or went in a series, each with its history.

    Each epoch is compared with one earlier epoch, its predecessor or the first one; one whose comparison failed, with
    any. Registrations are chained into the frame of the first epoch. Nothing is linked across a gap that no comparison
    bridges: the epochs after it have a frame, and objects, of their own.

    Args:
        epochs: their names, in the order of time.
        comparisons: those that are done, in any order.

    Raises:
        InputError: epochs that are not in the series, or an epoch that is compared with two earlier ones.
    """
    ordered = sorted(comparisons, key=lambda one: (one.epochs.after, one.epochs.before))
    trees = epoch_trees(epochs, [comparison.epochs for comparison in ordered])
    by_epoch = {comparison.epochs.after: comparison for comparison in ordered}
    histories = [own for tree in trees if len(tree.epochs) > 1 for own in _histories(epochs, tree, by_epoch)]
    histories.sort(key=_order)
    return [dataclasses.replace(history, number=number) for number, history in enumerate(histories, 1)]


def epoch_trees(epochs: Sequence[str], pairs: Iterable[Pair[int]]) -> list[EpochTree]:
    """The epochs that are connected by comparisons, each group with its first epoch.

    Args:
        epochs: their names, in the order of time.
        pairs: indices of the epochs that were compared, the earlier one first.

    Raises:
        InputError: epochs that are not in the series, or an epoch that is compared with two earlier ones.
    """
    parents = _parents(epochs, pairs)
    roots: dict[int, int] = {}
    for epoch in range(len(epochs)):
        roots[epoch] = roots[parents[epoch]] if epoch in parents else epoch
    return [
        EpochTree(
            root,
            tuple(epoch for epoch, own in roots.items() if own == root),
            {epoch: parent for epoch, parent in sorted(parents.items()) if roots[epoch] == root},
        )
        for root in sorted(set(roots.values()))
    ]


def object_rows(histories: Sequence[ObjectHistory]) -> list[ObjectRow]:
    """The table of the objects: a row for each event, object after object."""
    return [_row(history, number, event) for history in histories for number, event in enumerate(history.events)]


def _parents(epochs: Sequence[str], pairs: Iterable[Pair[int]]) -> dict[int, int]:
    """The earlier epoch that each one was compared with."""
    parents: dict[int, int] = {}
    for before, after in pairs:
        if not 0 <= before < after < len(epochs):
            raise InputError(
                f"comparisons: {before} and {after} are not the indices of an earlier and a later one of "
                f"{len(epochs)} epochs"
            )
        if after in parents:
            raise InputError(
                f"comparisons: epoch {epochs[after]!r} is compared with {epochs[parents[after]]!r} and with "
                f"{epochs[before]!r}; give one comparison of each epoch with an earlier one"
            )
        parents[after] = before
    return parents


def _histories(
    epochs: Sequence[str], tree: EpochTree, comparisons: Mapping[int, Comparison]
) -> Iterator[ObjectHistory]:
    """Those of the epochs of a tree, not yet numbered."""
    linker = Linker(tree, comparisons)
    for track, presence in zip(linker.tracks, linker.presence(), strict=True):
        events = tuple(_events(track, presence, tree))
        if events:
            everywhere = tuple(presence.get(epoch) for epoch in range(len(epochs)))
            yield ObjectHistory(0, tuple(epochs), tree.root, events, everywhere)


def _order(history: ObjectHistory) -> tuple[int | float | str, ...]:
    """By time; of one time those that came, moved, went, the most probable and largest first."""
    first = history.events[0]
    return (first.epoch, first.kind, -first.probability, -first.point_count, *first.box.centre.tolist())


def _events(track: Track, presence: Mapping[int, bool | None], tree: EpochTree) -> Iterator[ObjectEvent]:
    known = [epoch for epoch in tree.epochs if presence[epoch] is not None]
    for previous, epoch in itertools.pairwise(known):
        was, now = presence[previous], presence[epoch]
        if was and now:
            places = Pair(track.place(previous, tree), track.place(epoch, tree))
            if _moved(track, places, epoch, tree):
                yield _moved_event(track, places, Pair(previous, epoch), tree)
        elif now:
            yield _event("came", track, track.arrivals.get(epoch), Pair(previous, epoch), tree)
        elif was:
            yield _event("went", track, track.departures.get(epoch), Pair(previous, epoch), tree)


def _moved(track: Track, places: Pair[Place], epoch: int, tree: EpochTree) -> bool:
    """Whether two places of an object differ: where a change says so, and else where they hardly overlap."""
    if places.before is places.after:
        return False
    unmoved = track.inherited_place(tree.parents[epoch], tree)
    if unmoved is places.before or unmoved is places.after:
        return True
    return places.before.shares(places.after).of_smaller <= SAME_OBJECT


def _moved_event(track: Track, places: Pair[Place], epochs: Pair[int], tree: EpochTree) -> ObjectEvent:
    event = _event("moved", track, track.arrivals.get(epochs.after), epochs, tree)
    centre = places.before.box.centre
    motion = _motion_between(track, places, epochs.after, tree)
    destination = places.after.box.centre if motion is None else transformed(centre[None], motion)[0]
    distance = float(np.linalg.norm(destination - centre))
    return dataclasses.replace(event, box=places.after.box, origin=places.before.box, distance=distance)


def _motion_between(track: Track, places: Pair[Place], epoch: int, tree: EpochTree) -> Float[np.ndarray, "4 4"] | None:
    """The motion of the object between two places, by its motions from where it is unmoved; None where not known."""
    unmoved = track.inherited_place(tree.parents[epoch], tree)
    motions = {id(sighting.place): sighting.motion for sighting in track.arrivals.values()} | {id(unmoved): np.eye(4)}
    first, second = places.map(lambda place: motions.get(id(place)))
    return None if first is None or second is None else second @ np.linalg.inv(first)


def _event(kind: EventKind, track: Track, sighting: Sighting | None, epochs: Pair[int], tree: EpochTree) -> ObjectEvent:
    """The event that a change shows, or, where that is None, the want of one."""
    shown = track.latest_sighting(epochs.after) if sighting is None else sighting
    recognised = sighting is not None and sighting.motion is not None
    there = epochs.after if kind == "came" else epochs.before
    return ObjectEvent(
        kind=kind,
        epoch=epochs.after,
        previous=epochs.before,
        probability=shown.change.probability,
        moved_probability=sighting.change.moved_probability if sighting and kind != "went" else None,
        box=track.place(there, tree).box if sighting is None else sighting.place.box,
        origin=None,
        distance=None,
        point_count=shown.change.point_count,
        comparison=Pair(tree.parents[epochs.after], epochs.after),
        change=None if sighting is None else sighting.number,
        overlap=None if sighting is None else sighting.overlap,
        returned=kind == "came" and (sighting is None or sighting.returned or recognised),
    )


def _row(history: ObjectHistory, number: int, event: ObjectEvent) -> ObjectRow:
    names = history.epochs
    return ObjectRow(
        object=history.number,
        event=number,
        epoch=names[event.epoch],
        previous=names[event.previous],
        epoch_index=event.epoch,
        before=names[event.comparison.before],
        after=names[event.comparison.after],
        frame=names[history.frame],
        **{name: getattr(event, name) for name in SHARED},
        **dict(zip(("centre_x", "centre_y", "centre_z"), event.box.centre.tolist(), strict=True)),
        **dict(zip(("extent_1", "extent_2", "extent_3"), event.box.extent.tolist(), strict=True)),
    )
