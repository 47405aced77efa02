"""Links the changes of the comparisons of a series into objects, in the order of the epochs."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from gmmjax.batch.comparison import Comparison
from gmmjax.batch.places import Link, Place, linked, near
from gmmjax.batch.tracks import EpochTree, Sighting, Track, not_observed
from gmmjax.changes import Box
from gmmjax.geometry import transformed

# Two places are one where more than this share of the points of the smaller one lie at points of the other: as in the
# scores of detection. Lower: neighbours that touch become one; higher: what was seen from other sides becomes two.
SAME_OBJECT = 0.5
# Share of the points of both places from which on what comes where an object went is that object again.
SAME_SHAPE = 0.8
# Where more than this share of a place's points was not observed, it is not known whether the object was there.
UNOBSERVED = 0.5


class Linker:
    """The objects of the epochs that can be compared with each other.

    Attributes:
        tree: of these epochs.
        tracks: of the objects.
    """

    def __init__(self, tree: EpochTree, comparisons: Mapping[int, Comparison]) -> None:
        """Links the changes of all comparisons."""
        self.tree, self.tracks = tree, list[Track]()
        self._comparisons = comparisons
        self._frames = {tree.root: np.eye(4)}
        # Of each epoch the objects that are there as the comparisons up to it say, and where.
        self._states: dict[int, dict[Track, Place]] = {tree.root: {}}
        # The same of the latest epoch so far, where an object whose place was not observed is where it was.
        self._latest: dict[Track, Place] = {}
        for epoch in tree.epochs[1:]:
            self._add(comparisons[epoch])

    def presence(self) -> list[dict[int, bool | None]]:
        """Of each object in each epoch whether it was there; None where that is not known."""
        hidden: list[list[int]] = [[] for _ in self.tracks]
        for epoch in self.tree.epochs:
            asked = [index for index, track in enumerate(self.tracks) if epoch not in track.there]
            for index, found in zip(asked, self._hidden([self.tracks[index] for index in asked], epoch), strict=True):
                if found:
                    hidden[index].append(epoch)
        return [track.presence(self.tree, own) for track, own in zip(self.tracks, hidden, strict=True)]

    def _add(self, comparison: Comparison) -> None:
        """Adds the comparison of the next epoch."""
        before, after = comparison.epochs
        self._frames[after] = self._frames[before] @ _applied(comparison)
        found = self._sightings(comparison)
        departed = self._departed(comparison, found)
        gone = {track for tracks in departed.values() for track in tracks}
        state = {track: place for track, place in self._states[before].items() if track not in gone}
        state |= self._arrived(comparison, found, departed, state)
        self._states[after] = state
        elsewhere = [track for track in self._latest if track not in state and after not in track.there]
        kept = {
            track: self._latest[track]
            for track, hidden in zip(elsewhere, self._hidden(elsewhere, after), strict=True)
            if hidden
        }
        self._latest = state | kept

    def _sightings(self, comparison: Comparison) -> list[Sighting]:
        """The changes in the frame of the series."""
        frame = self._frames[comparison.epochs.before]
        return [
            Sighting(
                comparison.epochs,
                index,
                change,
                Place(transformed(points, frame), _box_in(frame, change.box)),
            )
            for index, (change, points) in enumerate(zip(comparison.changes, comparison.points, strict=True))
        ]

    def _departed(self, comparison: Comparison, found: Sequence[Sighting]) -> dict[int, list[Track]]:
        """By the index of each change of the before cloud the objects that are no longer there."""
        state = self._states[comparison.epochs.before]
        indices = [index for index, side in enumerate(comparison.sides) if side == 0]
        departed: dict[int, list[Track]] = {index: [] for index in indices}
        for track, link in self._links(state, [found[index].place for index in indices]):
            index = indices[link.new]
            departed[index].append(track)
            if link.assigned or comparison.epochs.after not in track.departures:
                track.departs(found[index]._replace(overlap=link.overlap))
        for index in indices:
            if not departed[index]:
                departed[index].append(self._departed_unseen(found[index]))
        return departed

    def _departed_unseen(self, sighting: Sighting) -> Track:
        """The object of a change of the before cloud that is of none known there.

        It had been gone and had come back without a change that shows it, or had been there from the start.
        """
        before = sighting.epochs.before
        gone = [
            track
            for track in self.tracks
            if track not in self._states[before] and track.there.get(before) is not False and min(track.there) < before
        ]
        track, overlap = self._of_same_shape(sighting.place, gone, before)
        if track is None:
            track, overlap = Track(home=sighting.place), 1.0
            self.tracks.append(track)
            for state in self._states.values():
                state[track] = sighting.place
        track.departs(sighting._replace(overlap=overlap))
        return track

    def _arrived(
        self,
        comparison: Comparison,
        found: Sequence[Sighting],
        departed: Mapping[int, Sequence[Track]],
        staying: Mapping[Track, Place],
    ) -> dict[Track, Place]:
        """The objects of the changes of the after cloud, and where they are."""
        before_state = self._states[comparison.epochs.before]
        indices = [index for index, side in enumerate(comparison.sides) if side == 1]
        # What had changed since the before cloud already in the epochs between, such as where all are compared with
        # the first one.
        changed = {
            track: place
            for track, place in self._latest.items()
            if track not in staying and place is not before_state.get(track)
        }
        arrived: dict[Track, Place] = {}
        taken = set()
        for track, link in self._links(changed, [found[index].place for index in indices]):
            sighting = found[indices[link.new]]
            taken.add(sighting.number)
            if track not in arrived:
                motion = self._motion(sighting) if track in departed.get(_partner(sighting), ()) else None
                track.arrives(
                    sighting._replace(overlap=link.overlap, motion=motion), from_elsewhere=track in before_state
                )
                arrived[track] = sighting.place
        for sighting in (found[index] for index in indices if index not in taken):
            partners = departed.get(_partner(sighting), ())
            for track in (track for track in partners if track not in arrived):
                track.arrives(sighting._replace(motion=self._motion(sighting)), from_elsewhere=True)
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
        track, overlap = self._of_same_shape(sighting.place, earlier, after)
        returned = track is not None
        if track is None:
            track = Track()
            self.tracks.append(track)
        track.arrives(sighting._replace(overlap=overlap if returned else 1.0, returned=returned), from_elsewhere=False)
        return track

    def _links(self, known: Mapping[Track, Place], new: Sequence[Place]) -> list[tuple[Track, Link]]:
        tracks = list(known)
        links = linked([known[track] for track in tracks], new, SAME_OBJECT)
        return [(tracks[link.known], link) for link in links]

    def _of_same_shape(self, place: Place, tracks: Sequence[Track], epoch: int) -> tuple[Track | None, float]:
        """The object that was last seen in a place in the same shape, the most alike one, and the overlap."""
        places = [track.latest_place(epoch) for track in tracks]
        shares = {row: places[row].shares(place) for row, _ in near(places, [place])}
        best = max(shares, key=lambda row: shares[row].of_larger, default=-1)
        if best < 0 or shares[best].of_larger < SAME_SHAPE:
            return None, 0.0
        return tracks[best], shares[best].of_smaller

    def _motion(self, sighting: Sighting) -> Float[np.ndarray, "4 4"] | None:
        """Of an object that moved, in the frame of the series."""
        frame, motion = self._frames[sighting.epochs.before], sighting.change.transform
        return None if motion is None else frame @ motion @ np.linalg.inv(frame)

    def _hidden(self, tracks: Sequence[Track], epoch: int) -> list[bool]:
        """Of objects whether the survey of an epoch did not observe where they were last, or would be unchanged."""
        if epoch in self.tree.parents:
            comparison = self._comparisons[epoch]
            coverage, frame = comparison.coverage.before, self._frames[comparison.epochs.before]
        else:
            comparison = self._comparisons[next(other for other, own in self.tree.parents.items() if own == epoch)]
            coverage, frame = comparison.coverage.after, self._frames[epoch]
        places = [(track.latest_place(epoch), track.place(epoch, self.tree)) for track in tracks]
        hidden = [not_observed(own, coverage, frame, UNOBSERVED) for own in zip(*places, strict=True)]
        return [bool(latest or unchanged) for latest, unchanged in zip(*hidden, strict=True)]


def _partner(sighting: Sighting) -> int:
    """The index of the change that a moved object was; -1 of any other."""
    partner = sighting.change.partner
    return -1 if partner is None else partner


def _applied(comparison: Comparison) -> Float[np.ndarray, "4 4"]:
    return comparison.registration.transform if comparison.registration.applied else np.eye(4)


def _box_in(frame: Float[np.ndarray, "4 4"], box: Box) -> Box:
    return Box(transformed(box.centre[None], frame)[0], box.extent, frame[:3, :3] @ box.rotation)
