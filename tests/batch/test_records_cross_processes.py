"""What is sent to workers of Dask and back is the same there. (Other tests send pairs to spawned processes.)"""

import hashlib

import jax
import numpy as np
import pytest

from gmmjax import detect_changes
from gmmjax.batch import BatchPair
from gmmjax.batch.worker import PairTask
from gmmjax.changes import DetectionConfig, detect_consensus
from gmmjax.clouds import PointCloud, SensorViews
from gmmjax.mixtures import fit_mixture
from tests.batch.runs import SETTINGS, cloud

CONFIG = DetectionConfig(**SETTINGS)


def content_of(record):
    """All that a record holds, as text: arrays by type, shape and bytes."""
    if isinstance(record, np.ndarray | jax.Array):
        array = np.asarray(record)
        return f"{array.dtype} {array.shape} {hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()}"
    if isinstance(record, dict):
        return {name: content_of(value) for name, value in record.items() if name != "seconds"}
    if isinstance(record, list | tuple):
        return [content_of(value) for value in record]
    if callable(record):
        return f"{record.__module__}.{record.__name__}"
    if hasattr(record, "__dict__"):
        return {"type": type(record).__name__, **content_of(vars(record))}
    return repr(record)


def records():
    points = cloud(0)
    views = SensorViews(np.eye(4)[None], (60.0, 45.0), 20.0)
    given = PointCloud.from_rows(
        points, np.zeros((len(points), 3), np.uint8), {"intensity": points[:, 0]}, source="x.ply", views=views
    )
    key = jax.random.key(0)
    return {
        "PointCloud": given,
        "SensorViews": views,
        "DetectionConfig": CONFIG,
        "GaussianMixture": fit_mixture(points, key=key, max_components=8).mixture,
        "Changes": detect_changes(cloud(0, 4), cloud(1), config=CONFIG),
        "Consensus": detect_consensus(cloud(0, 4), cloud(1), config=CONFIG),
        "PairTask": PairTask(BatchPair("x", given, points), CONFIG),
    }


@pytest.fixture(scope="module")
def made():
    return records()


NAMES = ("PointCloud", "SensorViews", "DetectionConfig", "GaussianMixture", "Changes", "Consensus", "PairTask")


@pytest.mark.parametrize("name", NAMES)
def test_dask_serialises_it(made, name):
    protocol = pytest.importorskip("distributed.protocol")
    header, frames = protocol.serialize(made[name])
    assert content_of(protocol.deserialize(header, frames)) == content_of(made[name])
