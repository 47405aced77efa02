"""Links the changes of the comparisons of a series into objects, in the order of the epochs."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gmmjax.batch.comparison import Comparison
from gmmjax.batch.places import Place, linked, not_observed, of_same_shape
from gmmjax.changes import Box, Change
from gmmjax.geometry import transformed
from gmmjax.pair import Pair


class Sighting(NamedTuple):
    """A change that shows an object.

    Attributes:
        epochs: of the comparison.
        number: index of the change in it.
        change: the change.
        place: its points and box in the frame of the series.
        motion: of a change that moved, in the frame of the series; else None.
        overlap: share of the points that the change and the object's known place have in common, 1 where that link was
            not needed.
        returned: whether the object had gone, and something of its shape is in its place again.
    """

    epochs: Pair[int]
    number: int
    change: Change
    place: Place
    motion: Float[np.ndarray, "4 4"] | None
    overlap: float = 1.0
    returned: bool = False


@dataclasses.dataclass(eq=False)
class Track:
    """One object, by what the comparisons say.

    Attributes:
        home: where it was before the first change that shows it; None: it came.
        arrivals: by epoch, what shows the object where it had not been in the epoch before.
        departures: by epoch, what shows that it is no longer where it had been.
        there: whether it was there, in the epochs for which a change says so.
    """

    home: Place | None = None
    arrivals: dict[int, Sighting] = dataclasses.field(default_factory=dict)
    departures: dict[int, Sighting] = dataclasses.field(default_factory=dict)
    there: dict[int, bool] = dataclasses.field(default_factory=dict)

    def departs(self, sighting: Sighting) -> None:
        """Adds a change of the before cloud: the object was there, and is not any more."""
        self.departures[sighting.epochs.after] = sighting
        self.there |= {sighting.epochs.before: True, sighting.epochs.after: False}

    def arrives(self, sighting: Sighting, *, from_elsewhere: bool) -> None:
        """Adds a change of the after cloud; from elsewhere: the object was in the before cloud, in another place."""
        self.arrivals[sighting.epochs.after] = sighting
        self.there |= {sighting.epochs.before: from_elsewhere, sighting.epochs.after: True}

    def place(self, epoch: int) -> Place:
        """Place where it was last seen up to an epoch; before that, its first place."""
        arrived = [other for other in self.arrivals if other <= epoch]
        if arrived or self.home is None:
            return self.arrivals[max(arrived, default=min(self.arrivals))].place
        return self.home

    def latest_sighting(self, epoch: int) -> Sighting:
        """The latest change that shows it before an epoch; the first one where none does."""
        shown = {**self.arrivals, **self.departures}
        return shown[max((other for other in shown if other < epoch), default=min(shown))]

    def presence(self, epochs: Sequence[int], hidden: Iterable[int]) -> dict[int, bool | None]:
        """Tell for each epoch whether the object was there; None where that is not known.

        What a change says of an epoch holds for all epochs beside it without a change of the object, as far as its
        place was observed. Where two changes contradict each other, one between them was not found, and it is not known
        when.
        """
        said = [{self.there[epoch]} if epoch in self.there else set() for epoch in epochs]
        unsaid = {*epochs} - {*self.there, *hidden}
        free = [index for index, epoch in enumerate(epochs) if epoch in unsaid]
        for index in reversed(free):
            said[index] |= said[index + 1] if index + 1 < len(said) else set()
        for index in free:
            said[index] |= said[index - 1] if index else set()
        return {epoch: next(iter(own)) if len(own) == 1 else None for epoch, own in zip(epochs, said, strict=True)}


class Linker:
    """The objects of epochs of which each was compared with the one before.

    Attributes:
        tracks: of the objects.
    """

    def __init__(self, comparisons: Sequence[Comparison]) -> None:
        """Links the changes of all comparisons, given in the order of time."""
        self.tracks = list[Track]()
        self._comparisons = comparisons
        self._frames = {comparisons[0].epochs.before: np.eye(4)}
        # The objects that are there in the latest epoch so far, and where.
        self._state: dict[Track, Place] = {}
        for comparison in comparisons:
            self._add(comparison)

    def presence(self) -> list[dict[int, bool | None]]:
        """Tell for each object and epoch whether it was there; None where that is not known."""
        hidden: dict[Track, list[int]] = {track: [] for track in self.tracks}
        for epoch in self._frames:
            asked = [track for track in self.tracks if epoch not in track.there]
            for track, found in zip(asked, self._hidden(asked, epoch), strict=True):
                if found:
                    hidden[track].append(epoch)
        return [track.presence(list(self._frames), own) for track, own in hidden.items()]

    def _add(self, comparison: Comparison) -> None:
        """Adds the comparison of the next epoch."""
        frame = self._frames[comparison.epochs.before]
        self._frames[comparison.epochs.after] = frame @ _applied(comparison)
        sightings = [_sighting(comparison, index, frame) for index in range(len(comparison.changes))]
        departed = self._departed([sightings[index] for index, side in enumerate(comparison.sides) if side == 0])
        for track in (track for tracks in departed.values() for track in tracks):
            self._state.pop(track, None)
        arriving = [sightings[index] for index, side in enumerate(comparison.sides) if side == 1]
        self._state |= self._arrived(arriving, departed)

    def _departed(self, sightings: Sequence[Sighting]) -> dict[int, list[Track]]:
        """By the index of each change of the before cloud the objects that are no longer there."""
        departed: dict[int, list[Track]] = {sighting.number: [] for sighting in sightings}
        known = list(self._state)
        for link in linked(list(self._state.values()), [sighting.place for sighting in sightings]):
            track, sighting = known[link.known], sightings[link.new]
            departed[sighting.number].append(track)
            if link.assigned or sighting.epochs.after not in track.departures:
                track.departs(sighting._replace(overlap=link.overlap))
        for sighting in sightings:
            if not departed[sighting.number]:
                departed[sighting.number].append(self._departed_unseen(sighting))
        return departed

    def _departed_unseen(self, sighting: Sighting) -> Track:
        """The object of a change of the before cloud that is of none known there.

        It had been gone and had come back without a change that shows it, or had been there from the start.
        """
        before = sighting.epochs.before
        gone = [
            track
            for track in self.tracks
            if track not in self._state and track.there.get(before) is not False and min(track.there) < before
        ]
        track, overlap = _like(sighting, gone, before)
        if track is None:
            track, overlap = self._new(home=sighting.place), 1.0
        track.departs(sighting._replace(overlap=overlap))
        return track

    def _arrived(self, sightings: Sequence[Sighting], departed: Mapping[int, Sequence[Track]]) -> dict[Track, Place]:
        """The objects of the changes of the after cloud, and where they are."""
        arrived: dict[Track, Place] = {}
        for sighting in sightings:
            partner = sighting.change.partner
            partners = () if partner is None else departed.get(partner, ())
            for track in (track for track in partners if track not in arrived):
                track.arrives(sighting, from_elsewhere=True)
                arrived[track] = sighting.place
            if not partners:
                arrived[self._came(sighting, arrived)] = sighting.place
        return arrived

    def _came(self, sighting: Sighting, arrived: Mapping[Track, Place]) -> Track:
        """The object of a change of the after cloud that was nowhere else: one that returned, or a new one."""
        before, after = sighting.epochs
        earlier = [
            track
            for track in self.tracks
            if track not in arrived and after not in track.departures and track.there.get(before) is not True
        ]
        track, overlap = _like(sighting, earlier, after)
        if track is None:
            track = self._new()
        else:
            sighting = sighting._replace(overlap=overlap, returned=True)
        track.arrives(sighting, from_elsewhere=False)
        return track

    def _new(self, home: Place | None = None) -> Track:
        self.tracks.append(Track(home))
        return self.tracks[-1]

    def _hidden(self, tracks: Sequence[Track], epoch: int) -> list[bool]:
        """Tell which objects were last where the survey of an epoch did not observe."""
        first = self._comparisons[0]
        coverage, frame = first.coverage.after, self._frames[epoch]
        for comparison in self._comparisons:
            if comparison.epochs.after == epoch:
                coverage, frame = comparison.coverage.before, self._frames[comparison.epochs.before]
        return not_observed([track.place(epoch) for track in tracks], coverage, frame)


def _sighting(comparison: Comparison, index: int, frame: Float[np.ndarray, "4 4"]) -> Sighting:
    """A change in the frame of the series."""
    change = comparison.changes[index]
    motion = None if change.transform is None else frame @ change.transform @ np.linalg.inv(frame)
    box = Box(transformed(change.box.centre[None], frame)[0], change.box.extent, frame[:3, :3] @ change.box.rotation)
    return Sighting(comparison.epochs, index, change, Place(transformed(comparison.points[index], frame), box), motion)


def _like(sighting: Sighting, tracks: Sequence[Track], epoch: int) -> tuple[Track | None, float]:
    """The object that was last seen in the place of a change in its shape, and the overlap."""
    best, overlap = of_same_shape(sighting.place, [track.place(epoch) for track in tracks])
    return (None if best is None else tracks[best]), overlap


def _applied(comparison: Comparison) -> Float[np.ndarray, "4 4"]:
    return comparison.registration.transform if comparison.registration.applied else np.eye(4)
