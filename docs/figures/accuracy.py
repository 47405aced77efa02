"""The accuracy beside the peers as bars, from the tables of `docs/results.md`: `python docs/figures/accuracy.py`."""

import re
from pathlib import Path

import numpy as np
from drawing import saved
from matplotlib import pyplot
from matplotlib.axes import Axes

PAGE = Path(__file__).parents[1] / "results.md"
SECTION = "Families that were left out"
# The headings of their columns.
METHODS = ("gmmjax", "c2c", "voxels", "M3C2")
COLORS = {"gmmjax": "#0072B2", "c2c": "#E69F00", "voxels": "#CC79A7", "M3C2": "#8C8C8C"}
# Read on white paper and on a dark page.
TEXT = "#808488"


def tables(page: str) -> dict[str, dict[str, dict[str, float]]]:
    """The segment F1 by poses, family and method, as the page has them."""
    section = page.split(f"\n## {SECTION}\n")[1].split("\n## ")[0]
    found = {}
    for title, text in re.findall(r"^\*(Poses \w+)\*\n\n((?:\|.*\n)+)", section, re.MULTILINE):
        heading, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
        found[title] = {
            row[0]: {name: f1(cell) for name, cell in zip(heading, row, strict=True) if name in METHODS} for row in rows
        }
    return found


def f1(cell: str) -> float:
    """Of "segment F1 / point F1, false segments"."""
    return float(cell.split("/")[0])


def draw(families: dict[str, dict[str, float]], ax: Axes) -> None:
    """A group of bars for each family, all of them together at the bottom."""
    thick = 0.8 / len(COLORS)
    places = np.arange(len(families), dtype=float)
    # The sum of all stands apart.
    places[-1] += 0.4
    for row, (name, color) in enumerate(COLORS.items()):
        values = [family[name] for family in families.values()]
        ax.barh(places + (row - 1.5) * thick, values, thick, color=color, label=name)
    ax.set_yticks(places, [name.replace("_", " ") for name in families])
    ax.set(xlim=(0, 1), ylim=(places[-1] + 0.6, -0.6), xlabel="segment F1")
    ax.grid(axis="x", color=TEXT, alpha=0.3)
    ax.set_axisbelow(True)
    ax.spines[["top", "right", "left"]].set_visible(False)
    ax.tick_params(axis="y", length=0)


def main() -> None:
    """Draws both tables."""
    pyplot.rcParams.update({"text.color": TEXT, "axes.labelcolor": TEXT, "xtick.color": TEXT, "ytick.color": TEXT})
    pyplot.rcParams.update({"axes.edgecolor": TEXT, "savefig.transparent": True, "svg.fonttype": "path"})
    both = tables(PAGE.read_text(encoding="utf-8"))
    figure, panels = pyplot.subplots(1, len(both), figsize=(9, 6.5), layout="constrained", sharey=True)
    for ax, (title, families) in zip(panels, both.items(), strict=True):
        draw(families, ax)
        ax.set_title(title)
    handles, names = panels[0].get_legend_handles_labels()
    panels[0].get_yticklabels()[-1].set_fontweight("bold")
    figure.legend(handles, names, loc="outside upper center", ncols=len(names), frameon=False)
    saved(figure, "accuracy.svg")


if __name__ == "__main__":
    main()
