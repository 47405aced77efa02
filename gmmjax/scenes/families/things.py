"""Furniture, vessels, luggage and clutter: tuples of solids that stand on the plane z = 0 about the origin."""

import dataclasses
from collections.abc import Callable, Iterable
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from gmmjax.scenes.ray_casting import Solid, StandingObject
from gmmjax.scenes.rigid_motions import Coordinates
from gmmjax.scenes.shapes import Bowl, Cup, Ellipsoid, Vegetation

# Draws a thing.
Drawing: TypeAlias = Callable[[np.random.Generator], StandingObject]


def block(extent: Coordinates, at: Coordinates = (0.0, 0.0, 0.0), kind: type[Solid] = Solid) -> Solid:
    """An upright solid by its full edge lengths, metres, and the middle of its base."""
    size = np.array(extent, float)
    return kind(np.array(at, float) + np.array([0.0, 0.0, size[2] / 2]), size)


def pillar(diameter: float, height: float, at: Coordinates = (0.0, 0.0, 0.0)) -> Solid:
    """An upright cylinder on the middle of its base."""
    return dataclasses.replace(block((diameter, diameter, height), at), round=True)


def cuboid(centre: Coordinates, extent: Coordinates, yaw: float = 0.0) -> Solid:
    """A box by its centre and its full edge lengths, metres."""
    return Solid(np.array(centre, float), np.array(extent, float), yaw)


def between(lowest: Coordinates, highest: Coordinates) -> Solid:
    """The box between two opposite corners."""
    corners = np.array([lowest, highest], float)
    return Solid(corners.mean(axis=0), corners[1] - corners[0])


def moved(thing: Iterable[Solid], motion: Float[np.ndarray, "4 4"]) -> StandingObject:
    """The thing after a rigid motion."""
    return tuple(solid.moved(motion) for solid in thing)


def labelled(thing: StandingObject, number: int) -> StandingObject:
    """The thing as a change with this number."""
    return tuple(dataclasses.replace(solid, label=number) for solid in thing)


def footprint(thing: StandingObject) -> float:
    """The radius about the vertical through the origin that holds the thing, metres."""
    reaches = [np.abs(solid.rotation) @ solid.extent / 2 for solid in thing]
    return max(
        float(np.linalg.norm(np.abs(solid.centre[:2]) + reach[:2])) for solid, reach in zip(thing, reaches, strict=True)
    )


def height(thing: StandingObject) -> float:
    """Height of the object's top above its base, metres."""
    return max(float(solid.centre[2] + (np.abs(solid.rotation) @ solid.extent)[2] / 2) for solid in thing)


def chance(random: np.random.Generator, probability: float) -> bool:
    """Draw True with this probability."""
    return bool(random.random() < probability)


def log_uniform(random: np.random.Generator, least: float, most: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(random.uniform(np.log(least), np.log(most))))


def box(random: np.random.Generator, least: float = 0.1, most: float = 0.8) -> StandingObject:
    """A carton or a case, no side of which is longer than thrice another."""
    size = log_uniform(random, least, most)
    return (block(np.clip(size * random.uniform(0.45, 1.3, 3), 0.08, None)),)


def boxes(least: float, most: float) -> Drawing:
    """Draws boxes of a size between these lengths, metres."""
    return lambda random: box(random, least, most)


def stack(random: np.random.Generator) -> StandingObject:
    """A smaller box on a box."""
    lower = random.uniform(0.2, 0.6, 3)
    upper = lower * random.uniform(0.5, 0.9, 3)
    aside = (lower - upper)[:2] / 2 * random.uniform(-1, 1, 2)
    return block(lower), block(upper, (*aside, lower[2]))


def drum(random: np.random.Generator) -> StandingObject:
    """A bucket, a canister, a barrel."""
    diameter = log_uniform(random, 0.15, 0.5)
    return (pillar(diameter, diameter * random.uniform(0.7, 1.8)),)


def bag(random: np.random.Generator) -> StandingObject:
    """A backpack, a sack or a cushion."""
    return (block(random.uniform([0.25, 0.2, 0.2], [0.6, 0.45, 0.6]), kind=Ellipsoid),)


def bin_(random: np.random.Generator) -> StandingObject:
    """A waste bin or a basket, open above."""
    wide = random.uniform(0.2, 0.45)
    return (block((wide, wide * random.uniform(0.6, 1.0), wide * random.uniform(0.8, 1.8)), kind=Cup),)


def ball(random: np.random.Generator) -> StandingObject:
    """A ball."""
    diameter = random.uniform(0.15, 0.6)
    return (block((diameter, diameter, diameter), kind=Ellipsoid),)


def suitcase(random: np.random.Generator) -> StandingObject:
    """A case with its handle pulled out, or without."""
    wide, deep, high = random.uniform([0.35, 0.2, 0.5], [0.5, 0.32, 0.75])
    handle = block((wide / 2, 0.03, random.uniform(0.15, 0.4)), (0.0, -deep / 3, high))
    return (block((wide, deep, high)), handle)[: int(random.integers(1, 3))]


def chair(random: np.random.Generator) -> StandingObject:
    """A chair or a stool, on four legs or on a column."""
    wide, deep, seat = random.uniform([0.38, 0.38, 0.38], [0.55, 0.55, 0.52])
    parts = [block((wide, deep, random.uniform(0.03, 0.1)), (0.0, 0.0, seat))]
    parts += _legs(random, wide, deep, seat) if chance(random, 0.7) else _column(random, wide, seat)
    if chance(random, 0.85):
        thick = random.uniform(0.03, 0.08)
        parts.append(block((wide, thick, random.uniform(0.3, 0.6)), (0.0, (deep - thick) / 2, seat)))
    if chance(random, 0.3):
        parts += [block((0.05, deep * 0.7, 0.2), (side * wide / 2, 0.0, seat)) for side in (-1, 1)]
    return tuple(parts)


def table(random: np.random.Generator) -> StandingObject:
    """A table; its top is the first solid."""
    wide, deep, high = random.uniform([0.6, 0.5, 0.4], [1.8, 0.9, 0.95])
    top = block((wide, deep, random.uniform(0.02, 0.06)), (0.0, 0.0, high))
    legs = _legs(random, wide, deep, high) if chance(random, 0.8) else _column(random, deep, high)
    return (top, *legs)


def counter(random: np.random.Generator) -> StandingObject:
    """A kitchen counter, a chest of drawers or a low cupboard; its top is the first solid."""
    wide, deep, high = random.uniform([0.5, 0.4, 0.6], [2.4, 0.7, 1.1])
    parts = [block((wide, deep, 0.05), (0.0, 0.0, high)), block((wide * 0.98, deep * 0.92, high))]
    doors = max(1, round(wide / random.uniform(0.35, 0.6)))
    for door in range(doors):
        x = ((door + 0.5) / doors - 0.5) * wide
        parts.append(block((0.12, 0.03, 0.03), (x, -deep / 2, high * random.uniform(0.7, 0.9))))
    return tuple(parts)


def sofa(random: np.random.Generator) -> StandingObject:
    """A sofa or an armchair; its seat is the first solid."""
    wide, deep, seat = random.uniform([0.8, 0.7, 0.35], [2.2, 1.0, 0.5])
    back, arm = random.uniform(0.15, 0.3, 2)
    parts = [
        block((wide, deep, seat)),
        block((wide, back, random.uniform(0.3, 0.5)), (0.0, (deep - back) / 2, seat)),
    ]
    return (
        *parts,
        *(block((arm, deep, random.uniform(0.15, 0.3)), (s * (wide - arm) / 2, 0.0, seat)) for s in (-1, 1)),
    )


def cupboard(random: np.random.Generator) -> StandingObject:
    """A wardrobe, a refrigerator, a locker."""
    wide, deep, high = random.uniform([0.4, 0.3, 1.0], [1.6, 0.7, 2.1])
    return block((wide, deep, high)), block((0.03, 0.04, 0.3), (wide * random.uniform(-0.4, 0.4), -deep / 2, high / 2))


def shelves(random: np.random.Generator) -> StandingObject:
    """A rack of boards between two sides; the boards come first."""
    wide, deep, high = random.uniform([0.6, 0.25, 0.9], [1.6, 0.5, 2.0])
    count = int(random.integers(2, 6))
    boards = [block((wide, deep, 0.025), (0.0, 0.0, level)) for level in np.linspace(0.1, high - 0.03, count)]
    return (*boards, *(block((0.03, deep, high), (side * wide / 2, 0.0, 0.0)) for side in (-1, 1)))


def lamp(random: np.random.Generator) -> StandingObject:
    """A lamp on a pole."""
    high, shade = random.uniform(0.35, 1.7), random.uniform(0.2, 0.45)
    foot = random.uniform(0.15, 0.3)
    top = block((shade, shade, shade * 0.8), (0.0, 0.0, high), Ellipsoid if chance(random, 0.5) else Cup)
    return pillar(foot, 0.04), pillar(random.uniform(0.025, 0.05), high), top


def plant(random: np.random.Generator) -> StandingObject:
    """Leaves over a pot."""
    pot = random.uniform(0.15, 0.35)
    extent = pot * random.uniform([1.2, 1.2, 1.2], [2.5, 2.5, 3.0])
    leaves = Vegetation(np.array([0.0, 0.0, 0.8 * pot + extent[2] / 2]), extent, free_path=random.uniform(0.05, 0.3))
    return pillar(pot, pot), leaves


def screen(random: np.random.Generator) -> StandingObject:
    """A monitor on its foot."""
    wide, high = random.uniform([0.4, 0.25], [0.8, 0.5])
    return block((wide, 0.05, high), (0.0, 0.0, 0.12)), block((0.06, 0.05, 0.15)), block((0.25, 0.18, 0.02))


def vessel(random: np.random.Generator) -> StandingObject:
    """A mug, a pot, a pan, a bowl, a tub or a vase."""
    wide = log_uniform(random, 0.1, 0.35)
    flat = random.uniform(0.4, 1.3)
    kind = (Cup, Bowl, Solid, Ellipsoid)[int(random.choice(4, p=[0.5, 0.2, 0.2, 0.1]))]
    body = block((wide, wide * random.uniform(0.7, 1.0), wide * flat), kind=kind)
    body = dataclasses.replace(body, round=kind is Solid)
    if chance(random, 0.6):
        return (body,)
    handle = block((wide * random.uniform(0.2, 0.8), 0.03, 0.04), (wide * 0.6, 0.0, wide * flat * 0.6))
    return body, handle


def bottle(random: np.random.Generator) -> StandingObject:
    """A bottle, a flask or a large can."""
    wide = random.uniform(0.08, 0.16)
    body = wide * random.uniform(1.5, 2.5)
    return pillar(wide, body), pillar(wide * random.uniform(0.3, 0.6), body * 0.4, (0.0, 0.0, body))


def clutter(random: np.random.Generator) -> StandingObject:
    """Something of several parts that has no name: each part stands on the plane or on an earlier one."""
    parts: list[Solid] = []
    size = log_uniform(random, 0.15, 0.6)
    for _ in range(int(random.integers(2, 5))):
        extent = size * random.uniform(0.25, 0.8, 3)
        below = parts[int(random.integers(len(parts)))] if parts and chance(random, 0.5) else None
        level = 0.0 if below is None else float(below.centre[2] + below.extent[2] / 2)
        middle = np.zeros(2) if below is None else below.centre[:2]
        at = (*(middle + size * random.uniform(-0.25, 0.25, 2)), level)
        part = block(extent, at, Ellipsoid if chance(random, 0.3) else Solid)
        parts.append(dataclasses.replace(part, yaw=float(random.uniform(0, np.pi)), round=chance(random, 0.3)))
    return tuple(parts)


def extinguisher(random: np.random.Generator) -> StandingObject:
    """A cylinder with its valve."""
    wide = random.uniform(0.12, 0.2)
    high = wide * random.uniform(2.2, 3.5)
    return pillar(wide, high), block((wide * 0.5, wide * 0.3, wide * 0.6), (0.0, 0.0, high))


def cart(random: np.random.Generator) -> StandingObject:
    """A trolley: boards between posts, or a closed box on wheels."""
    wide, deep, high = random.uniform([0.5, 0.4, 0.6], [1.1, 0.65, 1.1])
    if chance(random, 0.4):
        wheels = [block((0.08, 0.08, 0.12), (x * wide / 2.5, y * deep / 2.5, 0)) for x in (-1, 1) for y in (-1, 1)]
        return block((wide, deep, high - 0.12), (0.0, 0.0, 0.12)), *wheels
    boards = [block((wide, deep, 0.04), (0.0, 0.0, level)) for level in np.linspace(0.15, high - 0.1, 3)]
    return (*boards, *_legs(random, wide, deep, high))


def pallet(random: np.random.Generator) -> StandingObject:
    """A pallet with a load, or empty."""
    wide, deep = random.uniform([1.0, 0.7], [1.3, 1.1])
    slats = [block((wide, deep / 9, 0.14), (0.0, (row - 2) * deep / 4.5, 0.0)) for row in range(5)]
    if chance(random, 0.25):
        return tuple(slats)
    load = block(np.array([wide, deep, 1.0]) * random.uniform([0.7, 0.7, 0.3], [1.0, 1.0, 1.4]), (0.0, 0.0, 0.14))
    return load, *slats


def machine(random: np.random.Generator) -> StandingObject:
    """A housing with what stands out of it."""
    body = random.uniform([0.6, 0.5, 0.6], [2.5, 1.5, 1.8])
    parts = [block(body)]
    for _ in range(int(random.integers(1, 5))):
        extent = body * random.uniform(0.15, 0.5, 3)
        at = (*(body[:2] * random.uniform(-0.45, 0.45, 2)), body[2])
        part = block(extent, at)
        parts.append(dataclasses.replace(part, round=chance(random, 0.4)))
    side = block((body[0] * 0.4, 0.25, body[2] * 0.5), (0.0, -body[1] / 2, body[2] * random.uniform(0.1, 0.5)))
    return (*parts, side)


def rod(random: np.random.Generator) -> StandingObject:
    """A pipe, a beam or a board that lies there, or three of them."""
    thick, long = log_uniform(random, 0.04, 0.25), log_uniform(random, 0.8, 4.0)
    round_ = chance(random, 0.5)
    wide = thick if round_ else thick * random.uniform(0.5, 3.0)
    count = 3 if chance(random, 0.25) else 1
    lying = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    places = [(0.0, (number - (count - 1) / 2) * 1.02 * wide) for number in range(count)]
    return tuple(
        Solid(np.array([*place, thick / 2]), np.array([wide, thick, long]), round=round_, axes=lying)
        for place in places
    )


def rack(random: np.random.Generator, levels: int) -> StandingObject:
    """A rack for pallets, open on all sides; its decks come first, the lowest of them at the beginning."""
    bays = int(random.integers(1, 4))
    wide, deep, step = bays * random.uniform(1.8, 2.8), random.uniform(0.8, 1.2), random.uniform(0.8, 1.6)
    heights, faces = step * np.arange(1, levels + 1), (-deep / 2, deep / 2)
    decks = [block((wide, deep, 0.03), (0.0, 0.0, height)) for height in heights]
    beams = [block((wide, 0.05, 0.12), (0.0, y, height - 0.12)) for height in heights for y in faces]
    high = heights[-1] + random.uniform(0.0, 0.6)
    posts = [block((0.09, 0.09, high), (x, y, 0.0)) for x in np.linspace(-wide / 2, wide / 2, bays + 1) for y in faces]
    return (*decks, *beams, *posts)


def tripod(random: np.random.Generator) -> StandingObject:
    """A scanner or a camera on three legs."""
    high, spread = random.uniform(1.1, 1.6), random.uniform(0.35, 0.55)
    parts = [block((0.22, 0.18, 0.3), (0.0, 0.0, high))]
    for angle in 2 * np.pi * np.arange(3) / 3:
        foot = spread * np.array([np.cos(angle), np.sin(angle), 0.0])
        along = np.array([0.0, 0.0, high]) - foot
        across = np.cross(along, foot)
        axes = np.stack([across, np.cross(along, across), along], axis=1)
        extent = np.array([0.05, 0.05, np.linalg.norm(along)])
        middle = foot + along / 2
        parts.append(Solid(middle, extent, round=True, axes=axes / np.linalg.norm(axes, axis=0)))
    return tuple(parts)


def one_of(*drawings: Drawing) -> Drawing:
    """Draws one of these kinds of things, each as often."""
    return lambda random: drawings[int(random.integers(len(drawings)))](random)


def _legs(random: np.random.Generator, wide: float, deep: float, high: float) -> list[Solid]:
    thick = random.uniform(0.025, 0.07)
    x, y = (wide - thick) / 2, (deep - thick) / 2
    return [block((thick, thick, high), (i * x, j * y, 0.0)) for i in (-1, 1) for j in (-1, 1)]


def _column(random: np.random.Generator, wide: float, high: float) -> list[Solid]:
    return [pillar(random.uniform(0.05, 0.12), high), pillar(wide * random.uniform(0.7, 1.0), 0.06)]
