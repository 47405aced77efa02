"""What the scripts that make the figures of these pages share."""

import io
from pathlib import Path

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from gmmjax.pair import Pair
from gmmjax.reporting.palette import KIND_COLORS

matplotlib.use("agg")
matplotlib.rcParams.update({"font.size": 9, "svg.hashsalt": "gmmjax", "axes.titlesize": "medium"})

IMAGES = Path(__file__).parents[1] / "images"
# Apart from each other for all eyes, and from the kinds of changes.
BEFORE, AFTER = "#7B3294", "#E69F00"
KEPT = ("#FFFFFF", "#000000", BEFORE, AFTER, *KIND_COLORS.values())


def saved(figure: Figure, name: str, *, dpi: int = 110, colors: int = 160) -> None:
    """Writes a figure to `docs/images`: SVG, or PNG in few colours, so that the pages load quickly.

    Args:
        figure: of matplotlib; it is closed.
        name: of the file.
        dpi: of a PNG.
        colors: of a PNG.
    """
    file = IMAGES / name
    if file.suffix == ".svg":
        figure.savefig(file, metadata={"Date": None})
    else:
        buffer = io.BytesIO()
        figure.savefig(buffer, dpi=dpi, facecolor="white")
        in_few_colors(Image.open(buffer), file, colors)
    pyplot.close(figure)
    print(f"{file.relative_to(IMAGES.parents[1])}: {file.stat().st_size / 1000:.0f} kB")


def in_few_colors(given: Image.Image, file: Path, colors: int = 160) -> None:
    """Writes a picture as a small PNG.

    Args:
        given: the picture.
        file: to write.
        colors: that are left of it, besides those with a meaning.
    """
    picture = given.convert("RGB")
    few = picture.quantize(colors, dither=Image.Dither.NONE)
    # Colours with a meaning stay exactly what they are.
    meant = [int(name[place : place + 2], 16) for name in KEPT for place in (1, 3, 5)]
    few.putpalette([*(few.getpalette() or [])[: 3 * colors], *meant])
    picture.quantize(palette=few, dither=Image.Dither.NONE).save(file, optimize=True)


def overlaid(
    clouds: Pair[Float[np.ndarray, "n 3"]], ax: Axes, *, axes: tuple[int, int] = (0, 1), size: float = 1.0
) -> None:
    """Draws two clouds over each other, before in purple and after in orange, so that one sees how they lie."""
    points = np.concatenate(list(clouds))
    colors = np.repeat([BEFORE, AFTER], [len(cloud) for cloud in clouds])
    order = np.random.default_rng(0).permutation(len(points))
    ax.scatter(*points[order][:, axes].T, s=size, c=colors[order], linewidths=0, rasterized=True)
    ax.set(aspect="equal", xlabel="xyz"[axes[0]], ylabel="xyz"[axes[1]])
    for name, color in (("before", BEFORE), ("after", AFTER)):
        ax.scatter([], [], s=20, c=color, label=name)
    ax.legend(loc="upper right", fontsize="small", framealpha=0.9)
