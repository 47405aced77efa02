"""The verdict's reliability on families that were left out: `python docs/figures/reliability.py ROWS`.

The rows are those that `python -m gmmjax.learning --rows ROWS` keeps.
"""

import argparse
from pathlib import Path

import numpy as np
from drawing import saved
from matplotlib import pyplot

from gmmjax.evaluation import Reliability
from gmmjax.learning import CHANGED, PENALTIES, learned, read_rows


def of_families_left_out(rows: Path, *, poses: bool, penalties: tuple[float, ...]) -> Reliability:
    """The curve over all candidates, each judged by what was learned on all other families."""
    families = read_rows(rows).of(poses=poses)
    _, left_out = learned(families, poses=poses, penalties=penalties)
    probability = np.concatenate([own[:, CHANGED] for own in left_out.probabilities.values()])
    kinds = np.concatenate([families[name].kind for name in left_out.probabilities])
    return Reliability.of(probability, kinds == CHANGED)


def draw(curves: dict[str, Reliability]) -> None:
    """The frequency of changes by the probability, with the 95 % intervals of what the counts can tell."""
    canvas, panels = pyplot.subplots(1, len(curves), figsize=(4 * len(curves), 4), layout="constrained", sharey=True)
    for axes, (name, curve) in zip(panels, curves.items(), strict=True):
        filled = curve.count > 0
        count, frequency = curve.count[filled], curve.true[filled] / curve.count[filled]
        # Agresti and Coull's interval: as if four candidates more had been judged, two of them changes.
        middle = (curve.true[filled] + 2) / (count + 4)
        reach = 1.96 * np.sqrt(middle * (1 - middle) / (count + 4))
        mean = curve.predicted[filled] / count
        axes.plot([0, 1], [0, 1], color="grey", linestyle="--", linewidth=1)
        axes.vlines(mean, np.maximum(middle - reach, 0), np.minimum(middle + reach, 1), color="tab:blue", alpha=0.5)
        axes.plot(mean, frequency, "o", color="tab:blue")
        for place, share, number in zip(mean, frequency, count, strict=True):
            side = (-6, 4, "right") if place > 0.5 else (6, -10, "left")
            axes.annotate(str(number), (place, share), side[:2], textcoords="offset points", ha=side[2], fontsize=7)
        title = f"{name}: calibration error {curve.calibration_error:.3f}"
        axes.set(title=title, xlabel="probability of a change", xlim=(0, 1), ylim=(0, 1), aspect="equal")
        axes.grid(alpha=0.3)
    panels[0].set(ylabel="share of the candidates that changed")
    saved(canvas, "verdict-reliability.svg")


def main() -> None:
    """Draws both curves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rows", type=Path)
    parser.add_argument("--penalties", type=float, nargs="+", default=list(PENALTIES))
    arguments = parser.parse_args()
    curves = {
        name: of_families_left_out(arguments.rows, poses=poses, penalties=tuple(arguments.penalties))
        for name, poses in (("poses unknown", False), ("poses given", True))
    }
    draw(curves)


if __name__ == "__main__":
    main()
