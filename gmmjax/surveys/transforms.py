"""The tree of coordinate frames that ROS calls TF: fixed and moving edges, and the trajectories along its paths."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from gmmjax.errors import InputError
from gmmjax.surveys.trajectory import MAX_GAP, Trajectory


@dataclass(frozen=True, eq=False)
class Edge:
    """The pose of one coordinate frame in another.

    Attributes:
        motion: its poses, child to parent.
        fixed: the last pose holds at all times.
    """

    motion: Trajectory
    fixed: bool

    @property
    def pose(self) -> Float64[np.ndarray, "4 4"]:
        """The last pose."""
        return self.motion.poses[-1]


@dataclass(frozen=True, eq=False)
class TransformTree:
    """Coordinate frames and the edges between them.

    Attributes:
        edges: by the names of the parent and the child.
    """

    edges: Mapping[tuple[str, str], Edge]

    @property
    def frames(self) -> tuple[str, ...]:
        """The names of all coordinate frames, sorted."""
        return tuple(sorted({name for pair in self.edges for name in pair}))

    def root_of(self, frame: str) -> str:
        """The frame at the top of the tree that a frame hangs on.

        Raises:
            InputError: no such frame.
        """
        self._require(frame)
        parents = {child: parent for parent, child in self.edges}
        seen = {frame}
        while frame in parents and parents[frame] not in seen:
            frame = parents[frame]
            seen.add(frame)
        return frame

    def connects(self, parent: str, child: str) -> bool:
        """True where a path leads from one frame to the other."""
        return {parent, child} <= set(self.frames) and self._search(parent, child) is not None

    def fixed_pose(self, parent: str, child: str) -> Float64[np.ndarray, "4 4"]:
        """The pose of a frame that does not move in another one, child to parent.

        Raises:
            InputError: no such frames, no path between them, or one that moves.
        """
        pose = np.eye(4)
        for edge, up in self._path(parent, child):
            if not edge.fixed:
                raise InputError(f"transforms: {child!r} moves in {parent!r}; give the fixed pose of the sensor")
            pose = pose @ (np.linalg.inv(edge.pose) if up else edge.pose)
        return pose

    def trajectory(self, parent: str, child: str, max_gap: float = MAX_GAP) -> Trajectory:
        """The poses of a frame in another one, child to parent.

        A fixed edge of the path holds at all times. The times are those of the moving edge with the most samples; the
        other moving edges are interpolated at these, and times that they do not cover are left out.

        Args:
            parent: the coordinates of the result.
            child: what moves in it.
            max_gap: the longest gap between two samples of an edge that is interpolated over, seconds.

        Raises:
            InputError: no such frames, no path between them, one that does not move, or edges that share no time.
        """
        path = self._path(parent, child)
        moving = [edge.motion for edge, _ in path if not edge.fixed]
        if not moving:
            raise InputError(f"transforms: {child!r} does not move in {parent!r}; name the world as parent")
        times = max(moving, key=len).times
        covered = np.ones(len(times), np.bool_)
        poses = np.tile(np.eye(4), (len(times), 1, 1))
        for edge, up in path:
            if edge.fixed:
                step, known = edge.pose[None], np.ones_like(covered)
            else:
                step, known = edge.motion.at(times, max_gap)
            covered &= known
            poses = poses @ (np.linalg.inv(step) if up else step)
        if not covered.any():
            spans = "; ".join(f"{motion.times[0]:.3f} to {motion.times[-1]:.3f} s" for motion in moving)
            raise InputError(f"transforms: the edges from {parent!r} to {child!r} share no time ({spans})")
        return Trajectory(times[covered], poses[covered])

    def _path(self, parent: str, child: str) -> Sequence[tuple[Edge, bool]]:
        for name in (parent, child):
            self._require(name)
        path = self._search(parent, child)
        if path is None:
            pairs = ", ".join(f"{above} > {below}" for above, below in sorted(self.edges))
            raise InputError(f"transforms: no path leads from {parent!r} to {child!r}; the edges are: {pairs}")
        return path

    def _search(self, parent: str, child: str) -> Sequence[tuple[Edge, bool]] | None:
        """The edges of the shortest path, each with whether it is taken from the child up to the parent."""
        neighbours: dict[str, list[tuple[str, Edge, bool]]] = {name: [] for name in self.frames}
        for (above, below), edge in self.edges.items():
            neighbours[above].append((below, edge, False))
            neighbours[below].append((above, edge, True))
        paths: dict[str, tuple[tuple[Edge, bool], ...]] = {parent: ()}
        queue = deque([parent])
        while queue and child not in paths:
            name = queue.popleft()
            for other, edge, up in neighbours[name]:
                if other not in paths:
                    paths[other] = (*paths[name], (edge, up))
                    queue.append(other)
        return paths.get(child)

    def _require(self, frame: str) -> None:
        if frame not in self.frames:
            listed = ", ".join(self.frames) or "none"
            raise InputError(f"transforms: there is no frame {frame!r}; the frames are: {listed}")
