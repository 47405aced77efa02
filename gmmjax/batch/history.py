"""The history of the objects of a series of epochs of one place: when each came, moved and went."""

import dataclasses
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from gmmjax.batch.comparison import Comparison
from gmmjax.batch.linking import Linker, Sighting, Track
from gmmjax.changes import Box
from gmmjax.errors import InputError
from gmmjax.geometry import transformed
from gmmjax.pair import Pair

EventKind = Literal["came", "moved", "went"]
BOX_COLUMNS = ("centre_x", "centre_y", "centre_z", "extent_1", "extent_2", "extent_3")
# Those of the table of objects: the fields of an event, with epochs by name.
OBJECT_COLUMNS = (
    *("object", "event", "kind", "epoch", "previous", "epoch_index", "probability", "moved_probability", "distance"),
    *("returned", "before", "after", "change", "overlap", "point_count", "frame", *BOX_COLUMNS),
)


class EpochTree(NamedTuple):
    """Epochs that are connected by comparisons.

    Attributes:
        root: the first of these epochs, in whose frame all is.
        epochs: all of them in their order, each compared with the one before it here.
    """

    root: int
    epochs: tuple[int, ...]


@dataclasses.dataclass(frozen=True, eq=False)
class ObjectEvent:
    """The coming, moving or going of an object between two epochs. Lengths are in the unit of the clouds.

    Attributes:
        kind: "came", "moved" or "went".
        epoch: index of the first epoch in which it shows.
        previous: index of the latest epoch before that in which it was known to be otherwise: the one before, unless
            epochs between are missing, or did not observe the place.
        probability: of the change that shows it. Where no change shows it, because it was missed, that of the latest
            change before.
        moved_probability: of an object that moved, that it is the same; None where it was not computed.
        box: where the object is from then on, or was until then where it went; in the frame of the history.
        origin: of an object that moved, where it was; else None.
        distance: of an object that moved, how far its centre did; else None.
        point_count: points of that change.
        comparison: the epochs of the comparison that shows it.
        change: index of the change in that comparison; None where it was missed.
        overlap: of the object's known points and those of the change, by which the two were linked: the share of the
            smaller one; 1 where that was not needed. None without a change.
        returned: of an object that came, whether it had been there before, and gone: something of its shape is in the
            same place again.
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

    Each epoch is compared with the one before, or, over a gap, with the latest one before it that can be. Registrations
    are chained into the frame of the first epoch. Nothing is linked across a gap that no comparison bridges: the epochs
    after it have a frame, and objects, of their own.

    Args:
        epochs: their names, in the order of time.
        comparisons: those that are done, in any order.

    Raises:
        InputError: epochs that are not in the series, or an epoch that is compared with two earlier or two later ones.
    """
    comparisons = list(comparisons)
    by_epoch = {comparison.epochs.before: comparison for comparison in comparisons}
    trees = epoch_trees(epochs, [comparison.epochs for comparison in comparisons])
    histories = [
        history
        for tree in trees
        if len(tree.epochs) > 1
        for history in _histories(epochs, tree.epochs, [by_epoch[epoch] for epoch in tree.epochs[:-1]])
    ]
    histories.sort(key=_order)
    return [dataclasses.replace(history, number=number) for number, history in enumerate(histories, 1)]


def epoch_trees(epochs: Sequence[str], pairs: Iterable[Pair[int]]) -> list[EpochTree]:
    """The epochs that are connected by comparisons, each with the next one; one by itself is a group, too.

    Args:
        epochs: their names, in the order of time.
        pairs: indices of the epochs that were compared, the earlier one first.

    Raises:
        InputError: epochs that are not in the series, or an epoch that is compared with two earlier or two later ones.
    """
    following: dict[int, int] = {}
    for before, after in pairs:
        if not 0 <= before < after < len(epochs):
            raise InputError(
                f"comparisons: {before} and {after} are not the indices of an earlier and a later one of "
                f"{len(epochs)} epochs"
            )
        if before in following or after in following.values():
            twice = epochs[before if before in following else after]
            raise InputError(
                f"comparisons: epoch {twice!r} is compared twice with {'later' if before in following else 'earlier'} "
                "ones; give one comparison of each epoch with the one before"
            )
        following[before] = after
    chains = [[epoch] for epoch in range(len(epochs)) if epoch not in following.values()]
    for chain in chains:
        while chain[-1] in following:
            chain.append(following[chain[-1]])
    return [EpochTree(chain[0], tuple(chain)) for chain in chains]


def object_rows(histories: Sequence[ObjectHistory]) -> list[dict[str, Any]]:
    """The table of the objects: a row for each event, object after object, by `OBJECT_COLUMNS`."""
    return [_row(history, number, event) for history in histories for number, event in enumerate(history.events)]


def _histories(
    epochs: Sequence[str], connected: Sequence[int], comparisons: Sequence[Comparison]
) -> Iterator[ObjectHistory]:
    """Those of connected epochs, not yet numbered."""
    linker, compared_with = Linker(comparisons), dict(zip(connected[1:], connected, strict=False))
    for track, presence in zip(linker.tracks, linker.presence(), strict=True):
        events = tuple(_events(track, presence, compared_with))
        if events:
            everywhere = tuple(presence.get(epoch) for epoch in range(len(epochs)))
            yield ObjectHistory(0, tuple(epochs), connected[0], events, everywhere)


def _order(history: ObjectHistory) -> tuple[int | float | str, ...]:
    """By time; of one time those that came, moved, went, the most probable and largest first."""
    first = history.events[0]
    return (first.epoch, first.kind, -first.probability, -first.point_count, *first.box.centre.tolist())


def _events(
    track: Track, presence: Mapping[int, bool | None], compared_with: Mapping[int, int]
) -> Iterator[ObjectEvent]:
    known = [epoch for epoch, there in presence.items() if there is not None]
    for previous, epoch in itertools.pairwise(known):
        was, now = presence[previous], presence[epoch]
        epochs, comparison = Pair(previous, epoch), Pair(compared_with[epoch], epoch)
        arrival = track.arrivals.get(epoch)
        if was and now and arrival is not None:
            yield _moved(_event("moved", track, arrival, epochs, comparison), track.place(previous).box, arrival)
        elif now and not was:
            yield _event("came", track, arrival, epochs, comparison)
        elif was and not now:
            yield _event("went", track, track.departures.get(epoch), epochs, comparison)


def _moved(event: ObjectEvent, origin: Box, arrival: Sighting) -> ObjectEvent:
    """The event of an object that moved from a place."""
    centre = arrival.place.box.centre
    if arrival.motion is not None:
        centre = transformed(origin.centre[None], arrival.motion)[0]
    return dataclasses.replace(event, origin=origin, distance=float(np.linalg.norm(centre - origin.centre)))


def _event(
    kind: EventKind, track: Track, sighting: Sighting | None, epochs: Pair[int], comparison: Pair[int]
) -> ObjectEvent:
    """The event that a change shows, or, where that is None, that was missed."""
    shown = track.latest_sighting(epochs.after) if sighting is None else sighting
    place = track.place(epochs.after if kind == "came" else epochs.before) if sighting is None else sighting.place
    return ObjectEvent(
        kind=kind,
        epoch=epochs.after,
        previous=epochs.before,
        probability=shown.change.probability,
        moved_probability=sighting.change.moved_probability if sighting and kind != "went" else None,
        box=place.box,
        origin=None,
        distance=None,
        point_count=shown.change.point_count,
        comparison=comparison,
        change=None if sighting is None else sighting.number,
        overlap=None if sighting is None else sighting.overlap,
        returned=kind == "came" and (sighting is None or sighting.returned),
    )


def _row(history: ObjectHistory, number: int, event: ObjectEvent) -> dict[str, Any]:
    names, comparison = history.epochs, event.comparison
    values = {
        **{name: getattr(event, name) for name in OBJECT_COLUMNS if hasattr(event, name)},
        **{"object": history.number, "event": number, "epoch_index": event.epoch, "frame": names[history.frame]},
        **{"epoch": names[event.epoch], "previous": names[event.previous]},
        **{"before": names[comparison.before], "after": names[comparison.after]},
        **dict(zip(BOX_COLUMNS, [*event.box.centre.tolist(), *event.box.extent.tolist()], strict=True)),
    }
    return {name: values[name] for name in OBJECT_COLUMNS}
