"""Scenes for the pictures of the report: a hall, a table, the same table unchanged, and a yard with forty changes.

They are painted: each thing has a colour, so that the scans have colours as real ones do.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gmmjax.changes import Box, Change, Changes, Contribution, DetectionConfig, Explanation, detect_changes
from gmmjax.clouds import PointCloud
from gmmjax.geometry import rigid_transform, rotation_about, transformed
from gmmjax.pair import Pair, each
from gmmjax.scenes.depth_camera import DepthCamera, TriangulatingCamera
from gmmjax.scenes.families.tableware import ball, book, bottle, bowl, can, carton, cup, tin
from gmmjax.scenes.families.things import block, cuboid, labelled, machine, moved, pallet, pillar, shelves, tripod
from gmmjax.scenes.laser_scanner import Beam, TripodScanner
from gmmjax.scenes.ray_casting import Solid
from gmmjax.scenes.recording import Recording, joined
from gmmjax.scenes.rigid_motions import looking_at, upright

Color = tuple[int, int, int]
CONCRETE, PLASTER, STEEL, WOOD = (168, 166, 160), (206, 204, 196), (112, 124, 138), (172, 132, 88)
CARDBOARD, BLUE, RED, YELLOW = (190, 152, 104), (52, 92, 150), (170, 60, 48), (214, 168, 48)
GREEN, WHITE, SLATE = (70, 120, 84), (226, 226, 222), (86, 92, 104)
COLORS = (BLUE, RED, YELLOW, GREEN, CARDBOARD, STEEL)


class Scene(NamedTuple):
    """Two coloured clouds as they are given to the detection, and the number of each point's change, -1 for none."""

    clouds: Pair[PointCloud]
    truth: Pair[np.ndarray]


class Stage:
    """Things at two times, each with a colour, and the numbers of those that change."""

    def __init__(self) -> None:
        self.solids: Pair[list[Solid]] = Pair([], [])
        self.colors: list[Color] = []
        self.numbers: list[int] = []

    def stays(self, thing: Sequence[Solid], color: Color) -> None:
        """There at both times."""
        self._put(Pair(thing, thing), color, -1)

    def changes(self, before: Sequence[Solid], after: Sequence[Solid], color: Color) -> None:
        """There as this before, and as that after."""
        self._put(Pair(before, after), color, max(self.numbers, default=-1) + 1)

    def _put(self, things: Pair[Sequence[Solid]], color: Color, number: int) -> None:
        for side, thing in zip(self.solids, things, strict=True):
            side.extend(labelled(tuple(thing), len(self.colors)))
        self.colors.append(color)
        self.numbers.append(number)

    def scene(self, recordings: Pair[Recording], names: Pair[str], frame: np.ndarray, seed: int) -> Scene:
        """The recordings as coloured clouds.

        Args:
            recordings: of the solids.
            names: of the files.
            frame: motion of the after cloud and its views, which the registration has to undo.
            seed: of the grain of the colours.
        """
        random = np.random.default_rng(seed)
        palette = np.array([*self.colors, (128, 128, 128)], float)

        def cloud(recording: Recording, name: str, motion: np.ndarray) -> PointCloud:
            count = len(recording.points)
            grain = random.normal(0, 7, (count, 1)) + random.normal(0, 3, (count, 3))
            colors = np.clip(palette[recording.labels] + grain, 0, 255).astype(np.uint8)
            views = dataclasses.replace(recording.views)
            views = type(views)(motion @ views.poses, views.field_of_view, views.max_range)
            return PointCloud.from_rows(transformed(recording.points, motion), colors=colors, source=name, views=views)

        numbers = np.array([*self.numbers, -1])
        truth = recordings.map(lambda recording: numbers[recording.labels])
        return Scene(each(cloud, recordings, names, Pair(np.eye(4), frame)), truth)


def place(x: float, y: float, degrees: float = 0.0, z: float = 0.0) -> np.ndarray:
    """The motion from the origin to a place on the floor."""
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    return rigid_transform(turn, np.array([x, y, z]))


def nudge(x: float, y: float, degrees: float, step: tuple[float, float]) -> np.ndarray:
    """The motion of what stands at (x, y): turned about itself, and a step on."""
    turn = place(0, 0, degrees)[:3, :3]
    return rotation_about(turn, np.array([x, y, 0.0]), np.array([x + step[0], y + step[1], 0.0]))


def hall(points: int = 1_000_000) -> Scene:
    """A hall of 30 by 14 m that a scanner surveys from three stations, with goods that came, went and moved."""
    random = np.random.default_rng(7)
    stage = Stage()
    _building(stage, random)
    _goods(stage, random)
    scanner = TripodScanner(Beam(noise=0.002, growth=0.0001), rays=int(0.45 * points), highest=35.0)
    stands = Pair([(-8.0, -1.5), (1.0, -0.5), (9.5, -1.0)], [(-8.2, -1.2), (1.3, -0.3), (9.4, -1.3)])
    poses = stands.map(lambda own: np.stack([upright(np.array([x, y, 1.7]), 0.4) for x, y in own]))
    recordings = each(
        lambda solids, own: scanner.recording(solids, own, random).thinned(points, random), stage.solids, poses
    )
    frame = rigid_transform(place(0, 0, 0.4)[:3, :3], np.array([0.24, -0.17, 0.06]))
    return stage.scene(recordings, Pair("hall 2026-03-02.laz", "hall 2026-03-30.laz"), frame, 1)


def _building(stage: Stage, random: np.random.Generator) -> None:
    stage.stays([block((30.4, 14.4, 0.2), (0, 0, -0.2))], CONCRETE)
    for side in (-1, 1):
        stage.stays([block((0.2, 14, 4.5), (side * 15.1, 0, 0))], PLASTER)
        stage.stays([block((30.4, 0.2, 4.5), (0, side * 7.1, 0))], PLASTER)
        stage.stays([block((30, 0.25, 0.25), (0, side * 6.6, 3.9))], STEEL)
        for x in np.arange(-12, 13, 6):
            stage.stays([pillar(0.4, 4.5, (x, side * 6.4, 0))], WHITE)
    for x, y, degrees, color in [(-11, 5, 0, GREEN), (-4, 5.2, 0, GREEN), (9, -5.3, 180, BLUE), (12.6, 4.5, -90, BLUE)]:
        stage.stays(moved(machine(random), place(x, y, degrees)), color)
    for x in (-12.5, -10.8, -9.1, -7.4):
        stage.stays(moved(shelves(random), place(x, -6.2)), STEEL)
    for x, y in [(-1, -5.6), (0.7, -5.4), (4, 5.5), (6.4, 5.6), (13.2, -1)]:
        stage.stays(moved(pallet(random), place(x, y, random.uniform(-8, 8))), CARDBOARD)
    stage.stays(moved(tripod(random), place(2.2, 3.4)), YELLOW)


def _goods(stage: Stage, random: np.random.Generator) -> None:
    def loaded(wide: float, deep: float, high: float) -> tuple[Solid, ...]:
        return block((wide, deep, high), (0, 0, 0.14)), block((1.2, 0.8, 0.14))

    stage.changes((), moved(loaded(1.1, 0.75, 0.9), place(3.4, -3.4, 12)), CARDBOARD)
    stage.changes((), moved(loaded(1.0, 0.7, 1.3), place(7.2, 3.2, -20)), BLUE)
    stage.changes((), moved((block((0.9, 0.7, 0.8)),), place(-4.5, -6.5)), WOOD)
    stage.changes(moved(loaded(1.1, 0.8, 1.1), place(-6.5, 3.2, 5)), (), WOOD)
    stage.changes(moved((block((1.4, 0.9, 1.1)),), place(12, -6.4)), (), WOOD)
    lathe = block((2.4, 1.3, 1.2)), block((0.9, 1.1, 0.8), (0.6, 0.1, 1.2))
    lathe = moved(lathe, place(-3.2, 1.3, 15))
    stage.changes(lathe, moved(lathe, nudge(-3.2, 1.3, 12, (1.9, 1.3))), RED)
    trolley = moved((block((1.8, 1.1, 0.9)), block((0.3, 1.1, 1.6), (0.75, 0, 0))), place(5.4, 0.2, 30))
    stage.changes(trolley, moved(trolley, nudge(5.4, 0.2, 15, (-0.9, 1.3))), YELLOW)


def table(changed: bool = True) -> Scene:
    """A table that a depth camera looks at from two sides; a cup went, a tin came, and a bottle and a book moved.

    Args:
        changed: False: nothing changes between the two scans.
    """
    random = np.random.default_rng(3)
    stage = Stage()
    stage.stays([cuboid((0, 0, -0.015), (1.2, 0.8, 0.03))], WOOD)
    stage.stays([cuboid((0, 0.1, -0.72), (1.9, 1.6, 0.04))], SLATE)
    stage.stays([cuboid((0, 0.9, -0.1), (1.9, 0.04, 1.2))], PLASTER)
    still = [(can, -0.42, 0.22, RED), (bowl, -0.15, 0.2, WHITE), (bottle, 0.45, 0.25, GREEN), (tin, 0.1, -0.22, STEEL)]
    for draw, x, y, color in still:
        stage.stays(moved(draw(random), place(x, y, 20)), color)
    if changed:
        stage.changes(moved(cup(random), place(-0.3, -0.1, 200)), (), BLUE)
        stage.changes((), moved(carton(random), place(0.28, 0.05, 25)), YELLOW)
        lying = moved(book(random), place(-0.08, -0.05, 10))
        stage.changes(lying, moved(lying, nudge(-0.08, -0.05, 12, (0.05, -0.09))), BLUE)
        round_one = moved(ball(random), place(0.42, -0.2))
        stage.changes(round_one, moved(round_one, nudge(0.42, -0.2, 0, (-0.1, 0.02))), RED)
    ideal = DepthCamera(
        columns=480, rows=360, field_of_view=(64.0, 50.0), max_range=3.0, flying=0.02, lost=0.02, edge=0.05
    )
    camera = TriangulatingCamera(ideal, noise=0.0008, blur=0.6, distortion=0.0003)
    eyes = np.array([[-0.45, -1.05, 0.62], [0.5, -1.0, 0.66]])
    poses = np.stack([looking_at(eye, np.array([0.0, 0.05, -0.03])) for eye in eyes])

    def survey(solids: list[Solid]) -> Recording:
        distortion = camera.distortion_of(random)
        frames = [camera.frame(solids, pose, distortion, random) for pose in poses]
        return joined(frames, poses, poses, ideal.field_of_view, ideal.max_range)

    recordings = stage.solids.map(survey)
    frame = rigid_transform(place(0, 0, 0.3)[:3, :3], np.array([0.004, -0.003, 0.002]))
    return stage.scene(recordings, Pair("table morning.ply", "table evening.ply"), frame, 2)


def yard(side: int = 5, rows: int = 8) -> tuple[Scene, Changes]:
    """A yard with forty crates that came, went or moved, and a record of the changes by the truth.

    Args:
        side: crates in a row.
        rows: of crates.
    """
    random = np.random.default_rng(11)
    stage = Stage()
    stage.stays([block((4.0 * rows + 4, 4.0 * side + 4, 0.2), (0, 0, -0.2))], CONCRETE)
    for number in range(side * rows):
        x, y = 4.0 * (number % rows - (rows - 1) / 2), 4.0 * (number // rows - (side - 1) / 2)
        crate = moved((block(random.uniform(0.5, 1.6, 3)),), place(x, y, random.uniform(0, 90)))
        step = tuple(random.uniform(-0.8, 0.8, 2))
        before, after = [((), crate), (crate, ()), (crate, moved(crate, nudge(x, y, 25, step)))][number % 3]
        stage.changes(before, after, COLORS[number % len(COLORS)])
    scanner = TripodScanner(Beam(max_range=80), rays=60_000, highest=20.0)
    poses = np.stack([upright(np.array([x, y, 5.0]), 0.0) for x in (-10, 0, 10) for y in (-12, 12)])
    recordings = stage.solids.map(lambda solids: scanner.recording(solids, poses, random))
    scene = stage.scene(recordings, Pair("yard, week 12.las", "yard, week 13.las"), np.eye(4), 3)
    return scene, changes_by_truth(scene, degrees=25)


def changes_by_truth(scene: Scene, degrees: float) -> Changes:
    """What a detection without a fault would have reported.

    Args:
        scene: whose truth it is.
        degrees: that what moved turned by, about the vertical.
    """
    turn = place(0, 0, degrees)[:3, :3]
    numbers = np.unique(np.concatenate([truth[truth >= 0] for truth in scene.truth]))
    labels = scene.truth.map(lambda truth: np.full(len(truth), -1))
    items: list[Change] = []
    for number in numbers:
        chosen = scene.truth.map(lambda truth, number=number: truth == number)  # type: ignore[misc]
        there = [rows.sum() >= 10 for rows in chosen]
        for is_there, kind, cloud, rows, own in zip(
            there, ("disappeared", "appeared"), scene.clouds, chosen, labels, strict=True
        ):
            if is_there:
                own[rows] = len(items)
                partner = len(items) + (1 if kind == "disappeared" else -1) if all(there) else None
                items.append(_change("moved" if all(there) else kind, cloud.points[rows], partner, len(items)))
    for index, item in enumerate(items):
        if item.partner is not None:
            first, second = sorted((index, item.partner))
            motion = rotation_about(turn, items[first].mean, items[second].mean)
            items[index] = dataclasses.replace(item, transform=motion, moved_probability=0.93)
    shares = labels.map(lambda own: np.where(own < 0, 0.02, 0.95))
    return Changes(
        *labels,
        *shares,
        *labels.map(lambda own: np.zeros(len(own), bool)),
        items=tuple(items),
        emd=0.21,
        config=DetectionConfig(),
        diagnostics={},
        unit="m",
    )


def _change(kind: str, points: np.ndarray, partner: int | None, number: int) -> Change:
    facts = (
        Contribution("free_share", 0.9, 3.1, "90 % of it lies where the other survey looked through"),
        Contribution("continued_share", 0.1, -0.4, "10 % of it continues planes of the other cloud"),
    )
    probability = 0.99 - 0.01 * (number % 30)
    return Change(
        kind=kind,  # type: ignore[arg-type]
        probability=probability,
        significance=30.0 - 0.4 * number,
        point_count=len(points),
        mean=points.mean(axis=0),
        covariance=np.cov(points.T),
        box=Box.around(points),
        partner=partner,
        explanation=Explanation(probability, 1 - probability, 0.0, facts),
    )


def detected(scene: Scene, **settings: object) -> Changes:
    """What `detect_changes` finds, with the poses of the scanner."""
    changes = detect_changes(*scene.clouds, config=DetectionConfig(**settings))  # type: ignore[arg-type]
    return dataclasses.replace(changes, unit="m")
