"""Furniture and machines of 0.3 to 2 m, standing at the origin of the floor."""

import numpy as np

from gmmjax.geometry import rigid_transform
from gmmjax.scenes.families.arrangements import Thing, about_vertical, box, chance, cylinder, moved


def chair(random: np.random.Generator) -> Thing:
    """A seat on four legs or on a column with a star of feet, with a back, with arms or without."""
    wide, deep = random.uniform(0.38, 0.55, 2)
    seat, back = random.uniform(0.4, 0.5), random.uniform(0.35, 0.6)
    thick = random.uniform(0.03, 0.08)
    parts = [box((0.0, 0.0, seat - thick / 2), (wide, deep, thick))]
    lift = random.uniform(0.0, 0.15)
    parts.append(box((0.0, deep / 2 - 0.02, seat + (back + lift) / 2), (wide, 0.04, back - lift)))
    leg = random.uniform(0.025, 0.05)
    if chance(random, 0.4):
        parts.append(cylinder((0.0, 0.0, 0.05), leg, seat - thick - 0.05))
        parts += [box((0.0, 0.0, 0.06), (0.55, leg, 0.05), yaw) for yaw in (0.3, 0.3 + np.pi / 2)]
    else:
        corners = [(x * (wide - leg) / 2, y * (deep - leg) / 2) for x in (-1, 1) for y in (-1, 1)]
        parts += [box((x, y, (seat - thick) / 2), (leg, leg, seat - thick)) for x, y in corners]
        # The back's posts.
        parts += [box((x, deep / 2 - 0.02, seat + back / 2), (leg, leg, back)) for x, y in corners if y > 0]
    if chance(random, 0.35):
        parts += [box((side * wide / 2, 0.0, seat + 0.2), (0.05, 0.8 * deep, 0.04)) for side in (-1, 1)]
        parts += [box((side * wide / 2, 0.0, seat + 0.09), (0.04, 0.05, 0.2)) for side in (-1, 1)]
    return tuple(parts)


def table(random: np.random.Generator) -> Thing:
    """A top on four legs."""
    wide, deep, tall = random.uniform([0.8, 0.5, 0.68], [1.8, 0.9, 0.78])
    leg = random.uniform(0.04, 0.08)
    corners = [(x * (wide - leg) / 2, y * (deep - leg) / 2) for x in (-1, 1) for y in (-1, 1)]
    legs = [box((x, y, tall / 2), (leg, leg, tall)) for x, y in corners]
    return box((0.0, 0.0, tall - 0.02), (wide, deep, 0.04)), *legs


def crate(random: np.random.Generator) -> Thing:
    """A box."""
    extent = random.uniform([0.2, 0.2, 0.15], [0.7, 0.6, 0.7])
    return (box((0.0, 0.0, extent[2] / 2), extent),)


def cabinet(random: np.random.Generator) -> Thing:
    """A taller box."""
    extent = random.uniform([0.4, 0.35, 0.7], [1.2, 0.6, 2.0])
    return (box((0.0, 0.0, extent[2] / 2), extent),)


def bin_(random: np.random.Generator) -> Thing:
    """A drum or a waste bin."""
    return (cylinder((0.0, 0.0, 0.0), random.uniform(0.12, 0.3), random.uniform(0.25, 0.9)),)


def machine(random: np.random.Generator) -> Thing:
    """A body with a head, a motor, a console beside it: boxes and cylinders."""
    body = random.uniform([0.4, 0.3, 0.3], [0.9, 0.7, 0.9])
    head = body * random.uniform([0.3, 0.4, 0.3], [0.8, 0.9, 0.8])
    aside = (body - head)[:2] / 2 * random.uniform(-1, 1, 2)
    parts = [box((0.0, 0.0, body[2] / 2), body), box((*aside, body[2] + head[2] / 2), head)]
    if chance(random, 0.6):
        radius = random.uniform(0.06, 0.14)
        motor = cylinder((0.0, 0.0, 0.0), radius, random.uniform(0.2, 0.4))
        on_side = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
        parts += moved((motor,), rigid_transform(on_side, np.array([body[0] / 2, 0.0, radius + 0.02])))
    if chance(random, 0.5):
        lifted = np.array([0.0, -body[1] / 2 - 0.05, 0.8 * body[2]])
        console = (box((0.0, 0.0, 0.0), (0.3, 0.06, 0.25)),)
        parts += moved(console, rigid_transform(about_vertical(random.uniform(-0.4, 0.4)), lifted))
    return tuple(parts)


def furniture(random: np.random.Generator) -> Thing:
    """Any of them."""
    kinds = (chair, table, crate, cabinet, bin_, machine)
    return kinds[int(random.integers(len(kinds)))](random)
