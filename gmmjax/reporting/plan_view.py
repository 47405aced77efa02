"""The objects of a series from above: their boxes and the paths of those that moved, as SVG."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from gmmjax.batch import ObjectEvent, ObjectHistory
from gmmjax.changes import Box
from gmmjax.geometry import hull_corners
from gmmjax.reporting.quantities import rounded_down

# Pixels: the plan fits beside the time line, and a corridor along y is no page of its own.
WIDTH, HIGHEST = 440, 560
# About the objects: room for labels at the edge.
MARGIN = 26.0


@dataclasses.dataclass(frozen=True)
class _Scale:
    """Map coordinates to pixels, y upwards."""

    lower: Float[np.ndarray, "2"]
    pixels: float
    height: float

    def places(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        inside = (points - self.lower) * self.pixels + MARGIN
        return np.stack([inside[:, 0], self.height - inside[:, 1]], axis=1)


def plan_svg(histories: Sequence[ObjectHistory]) -> str:
    """Draw the plan of objects of one frame, at least one, along z with x to the right."""
    boxes = [box for history in histories for event in history.events for box in (event.box, event.origin) if box]
    corners = np.concatenate([box.corners()[:, :2] for box in boxes])
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    free = np.array([WIDTH, HIGHEST]) - 2 * MARGIN
    extent = np.maximum(upper - lower, 1e-9 * max(1.0, float(np.abs(corners).max())))
    pixels = float((free / extent).min())
    # Short of the width where the height is the limit: the objects stay in the middle.
    height = float(extent[1] * pixels + 2 * MARGIN)
    lower = lower - [(free[0] / pixels - extent[0]) / 2, 0.0]
    scale = _Scale(lower, pixels, height)
    dense = " dense" if len(histories) > 60 else ""
    objects = "".join(_object(history, scale) for history in histories)
    # Above all boxes, also those of later objects.
    objects += _numbers(histories, scale, apart=not dense)
    return f"""<svg class="plan{dense}" viewBox="0 0 {WIDTH} {height + 20:.0f}" role="img"
aria-label="Plan of the objects">
<defs><marker id="arrow" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto"><path
d="M0 0 8 4 0 8z"/></marker></defs>
{objects}{_scale_bar(scale)}</svg>"""


def _object(history: ObjectHistory, scale: _Scale) -> str:
    shapes = "".join(_event_shapes(event, scale) for event in history.events)
    moves = [event for event in history.events if event.origin is not None]
    path = "".join(_path(event.origin, event.box, scale) for event in moves if event.origin is not None)
    return f'<g data-object="{history.number}"><title>Object {history.number}</title>{shapes}{path}</g>\n'


def _numbers(histories: Sequence[ObjectHistory], scale: _Scale, apart: bool) -> str:
    """Write the number of each object in its last box, or above the head of its arrow.

    Numbers that are to be `apart` are moved down where they would cover one before, as where an object came to the
    place of another.
    """
    drawn: list[tuple[float, float, int]] = []
    for history in histories:
        x, y = scale.places(history.events[-1].box.centre[None, :2])[0]
        y -= 13 * any(event.origin is not None for event in history.events)
        width = 10 * len(str(history.number))
        while apart and any(2 * abs(x - left) < width + wide and abs(y - top) < 15 for left, top, wide in drawn):
            y += 3
        drawn.append((x, y, width))
    return "".join(
        f'<g data-object="{history.number}"><text x="{x:.1f}" y="{y:.1f}">{history.number}</text></g>\n'
        for history, (x, y, _) in zip(histories, drawn, strict=True)
    )


def _event_shapes(event: ObjectEvent, scale: _Scale) -> str:
    shapes = f'<polygon class="{event.kind}" points="{_outline(event.box, scale)}"/>'
    if event.origin is None:
        return shapes
    return f'<polygon class="origin" points="{_outline(event.origin, scale)}"/>{shapes}'


def _path(origin: Box, box: Box, scale: _Scale) -> str:
    (x0, y0), (x1, y1) = scale.places(np.stack([origin.centre[:2], box.centre[:2]]))
    return f'<path class="track" d="M{x0:.1f} {y0:.1f} {x1:.1f} {y1:.1f}" marker-end="url(#arrow)"/>'


def _outline(box: Box, scale: _Scale) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in hull_corners(scale.places(box.corners()[:, :2])))


def _scale_bar(scale: _Scale) -> str:
    """Draw a bar of a round length beneath the plan, at most a fifth of the width."""
    length = rounded_down(WIDTH / 5 / scale.pixels)
    x, y = MARGIN, scale.height + 4
    end = x + length * scale.pixels
    return (
        f'<path class="scale" d="M{x} {y - 4:.1f}v8M{x} {y:.1f}H{end:.1f}M{end:.1f} {y - 4:.1f}v8"/>'
        f'<text class="scale" x="{end + 8:.1f}" y="{y + 4:.1f}">{length:g}</text>'
    )
