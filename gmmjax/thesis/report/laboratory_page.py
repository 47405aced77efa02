"""The simulated laboratory as one HTML page: height maps of the runs, as in figure 3.6 of the thesis, and frames."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from gmmjax.thesis.laboratory import (
    BAG,
    BOARD,
    CLOUD_KINDS,
    GEAR_BOX,
    PANEL,
    ROBOT,
    CloudKind,
    LabCloud,
    Laboratory,
    LabPair,
)

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

# Colours of the outlines: those of the thesis's circles, and two more.
OBJECT_COLORS = {ROBOT: "#D55E00", BAG: "#009E73", GEAR_BOX: "#0072B2", BOARD: "#CC79A7", PANEL: "#E69F00"}
# Height maps: half their width, the width of a cell, and the largest height that is shown, metres.
HALF_WIDTH, CELL, TOP = 1.35, 0.02, 1.3
# Ends of the colour scale of depth images, metres.
NEAREST, FARTHEST = 0.3, 3.0
# Width of a panel, pixels, and depth images in a row.
PANEL_SIZE, COLUMNS = 260, 5
SCALE = "Viridis"


def lab_page(maps: Mapping[tuple[str, CloudKind], LabCloud], frames: Mapping[str, LabPair], seed: int) -> str:
    """The page.

    Args:
        maps: the clouds by the name of the survey and their kind.
        frames: the pairs of single frames by their title.
        seed: of the laboratory.

    Returns:
        HTML, with plotly.js inside.
    """
    kinds = [kind for kind in CLOUD_KINDS if any(other == kind for _, other in maps)]
    parts = [
        _from_above(kind, {name: cloud for (name, other), cloud in maps.items() if other == kind}) for kind in kinds
    ]
    if frames:
        parts.append(_depth_images(frames))
    figures = [
        figure.to_html(full_html=False, include_plotlyjs=number == 0, config={"displayModeBar": False})
        for number, figure in enumerate(parts)
    ]
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'><title>Simulated laboratory</title>"
        "<style>body{font-family:system-ui,sans-serif;margin:24px auto;max-width:1400px;color:#1b1f27}</style></head>"
        f"<body><h1>Simulated laboratory, seed {seed}</h1>{''.join(figures)}</body></html>\n"
    )


def heights(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "c c"]:
    """Largest height of the points in each cell of the floor, below the top of the walls; NaN in empty cells."""
    cells = round(2 * HALF_WIDTH / CELL)
    column, row = ((points[:, axis] + HALF_WIDTH) // CELL for axis in (0, 1))
    inside = (column >= 0) & (column < cells) & (row >= 0) & (row < cells) & (points[:, 2] < TOP)
    grid = np.full(cells * cells, -np.inf)
    np.maximum.at(grid, (row * cells + column)[inside].astype(int), points[inside, 2])
    return np.where(np.isfinite(grid), grid, np.nan).reshape(cells, cells)


def _from_above(kind: CloudKind, clouds: Mapping[str, LabCloud]) -> "Figure":
    figure = _panels(f"{CLOUD_KINDS[kind].capitalize()}, from above", list(clouds), 1)
    middles = (np.arange(round(2 * HALF_WIDTH / CELL)) + 0.5) * CELL - HALF_WIDTH
    for number, cloud in enumerate(clouds.values(), 1):
        places = cloud.points @ cloud.to_scene[:3, :3].T + cloud.to_scene[:3, 3]
        image = {"z": np.round(heights(places), 2), "x": middles, "y": middles, "zmin": -0.05, "zmax": TOP}
        figure.add_heatmap(**image, colorscale=SCALE, showscale=False, row=1, col=number)
        for name, outline in _outlines(cloud.laboratory).items():
            line = {"color": OBJECT_COLORS[name], "width": 3}
            first = not any(trace.name == name for trace in figure.data)
            figure.add_scatter(
                x=outline[:, 0],
                y=outline[:, 1],
                mode="lines",
                line=line,
                name=name,
                legendgroup=name,
                showlegend=first,
                row=1,
                col=number,
            )
    figure.update_xaxes(range=[-HALF_WIDTH, HALF_WIDTH], visible=False)
    figure.update_yaxes(range=[-HALF_WIDTH, HALF_WIDTH], visible=False)
    return figure


def _outlines(laboratory: Laboratory) -> dict[str, np.ndarray]:
    """The outline of each object from above, a little enlarged, as a closed polygon."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) / 2
    outlines = {}
    for name in laboratory.objects:
        part = laboratory.things[name][0]
        outlines[name] = part.centre[:2] + (1.15 * corners * part.extent[:2]) @ part.rotation[:2, :2].T
    return outlines


def _depth_images(frames: Mapping[str, LabPair]) -> "Figure":
    """Depth images before, with those after below them; `COLUMNS` pairs in a row."""
    titles = list(frames)
    rows = [titles[start : start + COLUMNS] for start in range(0, len(titles), COLUMNS)]
    names = [name for row in rows for name in [*row, *[""] * (2 * min(COLUMNS, len(titles)) - len(row))]]
    figure = _panels("Single frames: depth before, and after below", names, 2 * len(rows))
    for number, pair in enumerate(frames.values()):
        row, column = divmod(number, COLUMNS)
        for below, cloud in enumerate((pair.before, pair.after)):
            assert cloud.frame is not None
            figure.add_heatmap(
                z=np.round(cloud.frame.image()[::2, ::2, 2], 2),
                zmin=NEAREST,
                zmax=FARTHEST,
                colorscale=SCALE,
                reversescale=True,
                showscale=False,
                row=2 * row + below + 1,
                col=column + 1,
            )
    figure.update_xaxes(visible=False)
    figure.update_yaxes(visible=False, autorange="reversed")
    return figure


def _panels(title: str, titles: Sequence[str], rows: int) -> "Figure":
    """A figure of panels with titles, row by row."""
    from plotly.subplots import make_subplots

    columns = len(titles) // rows
    figure = make_subplots(rows, columns, subplot_titles=titles, horizontal_spacing=0.01, vertical_spacing=0.1 / rows)
    side = PANEL_SIZE if rows == 1 else int(0.75 * PANEL_SIZE)
    figure.update_layout(
        title=title,
        template="plotly_white",
        width=max(500, PANEL_SIZE * columns),
        height=side * rows + 110,
        legend={"orientation": "h", "y": -0.02},
        margin={"l": 10, "r": 10, "t": 70, "b": 20},
    )
    return figure
