"""Things of 4 to 25 cm as they stand on tables: cups, bowls, cans, bottles, balls, boxes, books."""

import numpy as np

from gmmjax.geometry import rigid_transform
from gmmjax.scenes.families.things import chance, cuboid, moved
from gmmjax.scenes.ray_casting import StandingObject
from gmmjax.scenes.shapes import Revolved


def can(random: np.random.Generator) -> StandingObject:
    """A can, standing or on its side."""
    radius, height = random.uniform(0.025, 0.06), random.uniform(0.06, 0.2)
    standing = Revolved.standing([(0.0, 0.0), (radius, 0.0), (radius, height), (0.0, height)])
    return _lying((standing,), radius) if chance(random, 0.15) else (standing,)


def tin(random: np.random.Generator) -> StandingObject:
    """A flat tin."""
    radius, height = random.uniform(0.035, 0.11), random.uniform(0.025, 0.07)
    return (Revolved.standing([(0.0, 0.0), (radius, 0.0), (radius, height), (0.0, height)]),)


def cup(random: np.random.Generator) -> StandingObject:
    """Wider above than below or not, hollow, with a handle or without."""
    base, height, wall = random.uniform(0.02, 0.045), random.uniform(0.06, 0.14), random.uniform(0.002, 0.005)
    rim = base * random.uniform(1.0, 1.5)
    cup = Revolved.standing(
        [(0.0, 0.0), (base, 0.0), (rim, height), (rim - wall, height), (base - wall, wall), (0.0, wall)]
    )
    if chance(random, 0.4):
        return (cup,)
    out, thick = random.uniform(0.02, 0.035), random.uniform(0.006, 0.012)
    middle = (base + rim) / 2
    bars = [(middle + out / 2, height * at, out, thick) for at in (0.25, 0.75)]
    handle = [cuboid((x, 0.0, z), (length, thick, thick)) for x, z, length, thick in bars]
    return cup, *handle, cuboid((middle + out, 0.0, height / 2), (thick, thick, height / 2 + thick))


def bowl(random: np.random.Generator) -> StandingObject:
    """A bowl or a plate, hollow."""
    radius, depth, wall = random.uniform(0.05, 0.125), random.uniform(0.35, 0.9), random.uniform(0.003, 0.006)
    angles = np.linspace(0.25, np.pi / 2, 6)
    outside = [(radius * np.sin(angle), radius * depth * (1 - np.cos(angle))) for angle in angles]
    inside = [(at - wall, height + (wall if at < 0.9 * radius else 0.0)) for at, height in reversed(outside)]
    low = outside[0][1]
    profile = [(0.0, low), *outside, *inside, (0.0, inside[-1][1])]
    return (Revolved.standing([(at, height - low) for at, height in profile]),)


def bottle(random: np.random.Generator) -> StandingObject:
    """A bottle, standing or on its side."""
    radius, height = random.uniform(0.025, 0.05), random.uniform(0.16, 0.25)
    neck, shoulder = radius * random.uniform(0.25, 0.5), height * random.uniform(0.5, 0.7)
    above = shoulder + (height - shoulder) * random.uniform(0.3, 0.7)
    standing = Revolved.standing(
        [(0.0, 0.0), (radius, 0.0), (radius, shoulder), (neck, above), (neck, height), (0.0, height)]
    )
    return _lying((standing,), radius) if chance(random, 0.15) else (standing,)


def ball(random: np.random.Generator) -> StandingObject:
    """A ball or a fruit."""
    radius = random.uniform(0.03, 0.1)
    angles = np.linspace(0, np.pi, 13)
    return (Revolved.standing([(radius * np.sin(angle), radius * (1 - np.cos(angle))) for angle in angles]),)


def carton(random: np.random.Generator) -> StandingObject:
    """A carton."""
    extent = random.uniform([0.04, 0.04, 0.06], [0.12, 0.2, 0.25])
    return (cuboid((0.0, 0.0, extent[2] / 2), extent),)


def book(random: np.random.Generator) -> StandingObject:
    """A book or a flat box."""
    extent = random.uniform([0.1, 0.12, 0.012], [0.2, 0.25, 0.05])
    return (cuboid((0.0, 0.0, extent[2] / 2), extent),)


def _lying(thing: StandingObject, radius: float) -> StandingObject:
    """On its side, its axis level, its middle near the origin."""
    length = float(thing[0].extent[2])
    on_side = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    return moved(thing, rigid_transform(on_side, np.array([-length / 2, 0.0, radius])))
