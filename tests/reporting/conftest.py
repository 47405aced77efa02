import dataclasses

import numpy as np
import pytest

from gmmjax.changes import Box, Change, Changes, DetectionConfig
from gmmjax.clouds import PointCloud
from tests.changes.explained import explanation, rejected

# UTM zone 32N without a code, as programs write systems of their own.
OWN_SYSTEM = (
    'PROJCS["site grid",GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],'
    'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
    'PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",9],PARAMETER["scale_factor",0.9996],'
    'PARAMETER["false_easting",500000],PARAMETER["false_northing",0],UNIT["metre",1]]'
)


def change(kind, points, partner=None, probability=0.97):
    return Change(
        kind=kind,
        probability=probability,
        significance=9.0,
        point_count=len(points),
        mean=points.mean(axis=0),
        covariance=np.cov(points.T),
        box=Box.around(points),
        partner=partner,
    )


def labelled(changes, labels_before, labels_after, items):
    """The changes with other labels and items, for clouds of these sizes."""
    return dataclasses.replace(
        changes,
        labels_before=labels_before,
        labels_after=labels_after,
        probability_before=np.where(labels_before < 0, 0.0, 1.0),
        probability_after=np.where(labels_after < 0, 0.0, 1.0),
        unobserved_before=np.zeros(len(labels_before), bool),
        unobserved_after=np.zeros(len(labels_after), bool),
        items=items,
    )


@pytest.fixture(scope="module")
def pair():
    """Clouds of 400 and 500 points, the former with colours and a lost row, and what changed, made by hand."""
    random = np.random.default_rng(1)
    rows = random.normal(size=(401, 3))
    rows[7, 1] = np.nan
    colors = random.integers(0, 256, (401, 3)).astype(np.uint8)
    before = PointCloud.from_rows(rows, colors=colors, source="scans/first.ply")
    after = PointCloud.from_rows(random.normal(size=(500, 3)) + np.array([0, 0, 2]), source="scans/second.ply")
    labels_before, labels_after = np.full(400, -1), np.full(500, -1)
    labels_before[:50], labels_after[:60], labels_after[60:130] = 0, 1, 2
    items = (
        change("disappeared", before.points[:50]),
        change("moved", after.points[:60], partner=None),
        change("appeared", after.points[60:130], probability=0.999),
    )
    changes = Changes(
        labels_before=labels_before,
        labels_after=labels_after,
        probability_before=np.where(labels_before < 0, 0.01, 0.97),
        probability_after=np.where(labels_after < 0, 0.01, 0.97),
        unobserved_before=np.zeros(len(labels_before), bool),
        unobserved_after=np.arange(len(labels_after)) == 0,
        items=items,
        emd=0.5,
        config=DetectionConfig(restarts=3, voxel_size=0.25),
        diagnostics={"before": {"rows_dropped": 1}, "seconds": {"fits": 1.5}, "nested": [{"a": [1, 2]}, None, "x"]},
    )
    return before, after, changes


@pytest.fixture(scope="module")
def explained(pair):
    """The same changes with explanations, and two rejected candidates."""
    items = tuple(dataclasses.replace(item, explanation=explanation()) for item in pair[2].items)
    candidates = rejected(changed=0.31), rejected("appeared", "not observed", 0.1, 0.2)
    return dataclasses.replace(pair[2], items=items, rejected=candidates)
