"""Figure 3.9: the scores of a grid search over criteria, covariance types and numbers of Gaussians (thesis 3.1.7)."""

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np

from gmmjax.mixtures import COVARIANCE_TYPES, CRITERIA, grid_search
from gmmjax.thesis.chapter4.clustering import CLOUDS, fixed_cloud
from gmmjax.thesis.chapter4.records import Cell, Headline, Outcome, Plan, Table, Unit, Work

PART = "grid"
COMPONENTS = range(3, 9)
THESIS = {"4 Gaussians": "diagonal, 4", "7 Gaussians": "diagonal, 3"}


def work(plan: Plan) -> Work:
    """One grid search of each cloud."""
    settings = {"components": list(COMPONENTS), "covariances": list(COVARIANCE_TYPES)}
    seed = plan.first_seed
    units = [
        Unit(PART, cloud, seed, "grid search", settings, functools.partial(_scores, cloud, seed)) for cloud in CLOUDS
    ]
    return Work(units)


def tables(outcomes: Sequence[Outcome]) -> list[Table]:
    """A row for each model: its score in nats, and whether it is the lowest by its criterion."""
    rows = [row for outcome in outcomes for row in _rows(outcome.condition, outcome.result)]
    return [Table("3.9", "scores of the grid search, the lowest of each marked", tuple(rows))]


def headlines(outcomes: Sequence[Outcome]) -> list[Headline]:
    """The model with the lowest score of each criterion."""
    (table,) = tables(outcomes)
    lines = []
    for cloud in CLOUDS:
        chosen = [row for row in table.rows if row["cloud"] == cloud and row["lowest"]]
        for row in chosen:
            here = f"{row['covariances']}, {row['gaussians']}"
            thesis = THESIS[cloud] if row["criterion"] == "mdl" else ""
            lines.append(
                Headline("3.9", f"lowest score, {cloud}", f"grid search, {str(row['criterion']).upper()}", here, thesis)
            )
    return lines


def _scores(cloud: str, seed: int) -> dict[str, Any]:
    search = grid_search(fixed_cloud(cloud, seed), key=jax.random.key(seed), components=COMPONENTS)
    return {"scores": {name: _finite(values) for name, values in search.scores.items()}}


def _finite(scores: Any) -> list[list[float | None]]:
    """Scores by covariance type and number; None where every fit failed, since JSON has no NaN."""
    return [[score if np.isfinite(score) else None for score in row] for row in np.asarray(scores).tolist()]


def _rows(cloud: str, result: Mapping[str, Any]) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for criterion in CRITERIA:
        scores = np.array(result["scores"][criterion], float)
        lowest = np.nanargmin(scores)
        for index, (place, score) in enumerate(np.ndenumerate(scores)):
            rows.append(
                {
                    "cloud": cloud,
                    "criterion": criterion,
                    "covariances": COVARIANCE_TYPES[place[0]],
                    "gaussians": COMPONENTS[place[1]],
                    "score": round(float(score), 2) if np.isfinite(score) else None,
                    "lowest": bool(index == lowest),
                }
            )
    return rows
