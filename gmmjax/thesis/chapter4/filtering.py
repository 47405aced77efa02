"""Figure 4.6: localised maps with and without statistical outlier removal, the voxel filter on in both (thesis 4.4)."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Int

from gmmjax.changes import DetectionConfig
from gmmjax.clouds import statistical_outliers
from gmmjax.errors import InputError
from gmmjax.evaluation import Detection, LabelledCloud, LabelledPair, PairSource, detector
from gmmjax.thesis.chapter4.accuracy import confusion
from gmmjax.thesis.chapter4.measures import CHANGE_TYPES, PUBLISHED, as_text, measured, published
from gmmjax.thesis.chapter4.records import Cell, Headline, LastPair, Outcome, Plan, Table, Unit, Work
from gmmjax.thesis.chapter4.survey_pairs import survey_sources
from gmmjax.thesis.chapter4.surveys import METHODS
from gmmjax.thesis.laboratory import VOXEL_SIZE

PART = "filtering"
WITHOUT, WITH = "voxel filter only", "voxel and outlier filter"
CLOUDS = "clouds"
# The thesis does not give its settings of the filter; these are common ones.
FILTER: Mapping[str, Any] = {"neighbours": 20, "ratio": 2.0}
# Number of points of each cloud in the picture, and largest number of outliers that are added to them.
DRAWN, OUTLIERS = 3000, 600


def work(plan: Plan) -> Work:
    """Both methods on localised maps, without and with the filter; for the picture the clouds of the first seed."""
    seeds = plan.seeds(plan.filtering_seeds)
    try:
        pairs = survey_sources(seeds, "localised")
    except InputError as error:
        return Work((), (f"Left out: {error}.",))
    load = LastPair()
    picture = functools.partial(_picture, load, pairs[0])
    units = [Unit(PART, "localised maps", plan.first_seed, CLOUDS, FILTER, picture)]
    for seed, source in zip(seeds, pairs, strict=True):
        for condition in (WITHOUT, WITH):
            for method in METHODS:
                settings = {"voxel_size": VOXEL_SIZE, **(FILTER if condition == WITH else {})}
                run = functools.partial(_run, load, source, method, condition == WITH)
                units.append(Unit(PART, condition, seed, method, settings, run))
    return Work(units)


def tables(outcomes: Sequence[Outcome]) -> list[Table]:
    """The measures of each method without and with the filter."""
    rows: list[dict[str, Cell]] = []
    for condition in (WITHOUT, WITH):
        for method in METHODS:
            own = [outcome for outcome in outcomes if (outcome.condition, outcome.method) == (condition, method)]
            rows.append({"filters": condition, "method": method, **measured(own)})
    return [Table("4.6", "localised maps, without and with the outlier filter", tuple(rows))]


def headlines(outcomes: Sequence[Outcome]) -> list[Headline]:
    """F1 without and with the filter."""
    (table,) = tables(outcomes)
    said = {WITHOUT: "nothing found", WITH: "walls reported"}
    return [
        Headline("4.6", f"F1, {row['filters']}", str(row["method"]), as_text(row), said[str(row["filters"])])
        for row in table.rows
    ]


def without_outliers(pair: LabelledPair) -> tuple[LabelledPair, Bool[np.ndarray, " n0"], Bool[np.ndarray, " n1"]]:
    """The pair without its outliers, and which points of each cloud are kept.

    Args:
        pair: the clouds.
    """
    kept_before, kept_after = (_kept(cloud) for cloud in (pair.before, pair.after))
    filtered = LabelledPair(pair.name, _part(pair.before, kept_before), _part(pair.after, kept_after))
    return filtered, kept_before, kept_after


def _run(load: LastPair, source: PairSource, method: str, filtered: bool) -> dict[str, Any]:
    """The confusion counts on all points: those that the filter removes are labelled unchanged."""
    pair = load(source)
    # The filter precedes both methods, in place of the one that is part of detection by separate fits.
    config = DetectionConfig(voxel_size=VOXEL_SIZE, outlier_neighbours=0)
    detect = detector(method, config) if method != PUBLISHED else functools.partial(_published, source, config)
    if not filtered:
        found = detect(pair)
        labels = found.labels_before, found.labels_after
    else:
        reduced, *kept = without_outliers(pair)
        labels = _of_all_points(detect(reduced), *kept)
    return {"all": dataclasses.asdict(confusion(pair, *labels))}


def _published(source: PairSource, config: DetectionConfig, pair: LabelledPair) -> Detection:
    """The published algorithm, told which type of change occurred."""
    return published(pair, [kind for kind in CHANGE_TYPES if kind == source.condition], config)


def _of_all_points(
    found: Detection, kept_before: Bool[np.ndarray, " n0"], kept_after: Bool[np.ndarray, " n1"]
) -> tuple[Int[np.ndarray, " n0"], Int[np.ndarray, " n1"]]:
    labels_before, labels_after = (np.full(len(kept), -1) for kept in (kept_before, kept_after))
    labels_before[kept_before], labels_after[kept_after] = found.labels_before, found.labels_after
    return labels_before, labels_after


def _kept(cloud: LabelledCloud) -> Bool[np.ndarray, " n"]:
    return ~statistical_outliers(cloud.points, **FILTER)


def _part(cloud: LabelledCloud, kept: Bool[np.ndarray, " n"]) -> LabelledCloud:
    return dataclasses.replace(
        cloud,
        points=cloud.points[kept],
        truth=cloud.truth[kept],
        unseen=None if cloud.unseen is None else cloud.unseen[kept],
        things=None if cloud.things is None else cloud.things[kept],
    )


def _picture(load: LastPair, source: PairSource) -> dict[str, Any]:
    """A sample of the points of both clouds from above, millimetres; which of them the filter keeps, which changed."""
    pair = load(source)
    _, *kept = without_outliers(pair)
    picture = {}
    for name, cloud, own in zip(("before", "after"), (pair.before, pair.after), kept, strict=True):
        drawn = np.union1d(_some(np.arange(len(own)), DRAWN), _some(np.flatnonzero(~own), OUTLIERS))
        picture[name] = {
            "places": np.rint(1000 * cloud.points[drawn, :2]).astype(int).tolist(),
            "kept": own[drawn].tolist(),
            "changed": (cloud.truth[drawn] >= 0).tolist(),
            "points": len(own),
            "left": int(own.sum()),
        }
    return picture


def _some(indices: Int[np.ndarray, " n"], most: int) -> Int[np.ndarray, " m"]:
    return np.random.default_rng(0).choice(indices, min(most, len(indices)), replace=False)
