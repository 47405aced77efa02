"""A room without anything in it, from the stations of a scanner."""

import numpy as np

# A room, metres: its lower and its upper corner.
ROOM = np.array([[0.0, 0.0, 0.0], [20.0, 12.0, 4.0]])
STATIONS = np.array([[6.0, 5.0, 1.7], [14.0, 8.0, 1.5]])


def scan(station, rays, *, lowest=-60.0, slope=0.0, noise=0.003, seed=0):
    """What a scanner sees of the room from a place, in equal steps of both angles; the floor may rise along x."""
    random = np.random.default_rng(seed)
    step = np.sqrt(np.radians(360) * np.radians(90 - lowest) / rays)
    azimuth, elevation = np.meshgrid(
        np.arange(-np.pi, np.pi, step) + step * random.random(), np.arange(np.radians(lowest), np.pi / 2, step)
    )
    level = np.cos(elevation)
    directions = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1).reshape(-1, 3)
    with np.errstate(divide="ignore"):
        ranges = np.where(directions > 0, ROOM[1] - station, ROOM[0] - station) / directions
        # The floor rises; beside it, down to where the level one would be, there is nothing.
        above = station[2] - slope * station[0]
        ranges[:, 2] = np.where(
            directions[:, 2] < 0, above / (slope * directions[:, 0] - directions[:, 2]), ranges[:, 2]
        )
    ranges[ranges <= 0] = np.inf
    reach = ranges.min(axis=1) + noise * random.standard_normal(len(ranges))
    return station + reach[:, None] * directions
