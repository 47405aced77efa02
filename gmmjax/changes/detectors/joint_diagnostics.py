"""Diagnostics of a detection by one mixture: of the clouds, the mixture and the computation."""

from typing import Any

import jax
import numpy as np

from gmmjax.changes.detectors.aligned_scans import AlignedScans
from gmmjax.changes.detectors.detector import Scan
from gmmjax.changes.fit.joint_fit import JointFits
from gmmjax.changes.prepare.checking import CheckedCloud
from gmmjax.changes.prepare.resolution import WorkingCloud
from gmmjax.changes.progress import Clock
from gmmjax.clouds import SensorViews
from gmmjax.mixtures import FitStatus
from gmmjax.pair import each


def joint_diagnostics(prepared: AlignedScans, fits: JointFits, clock: Clock) -> dict[str, Any]:
    """The diagnostics as plain values, for the record and the report; lengths are in the unit of the points.

    Args:
        prepared: the scans, registered.
        fits: of all restarts.
        clock: how long each stage took.
    """
    pair, views = prepared.pair, prepared.surveys.map(lambda survey: survey.views)
    clouds = each(_cloud_diagnostics, prepared.scans, prepared.checked, pair.working.clouds, views)
    return {
        "before": clouds.before,
        "after": clouds.after,
        "voxel_size": pair.working.voxel_size,
        "finest_voxel_size": pair.working.finest_voxel_size,
        "spacing": pair.working.spacing,
        "volumetric": pair.working.volumetric,
        "outer_side": None if pair.working.volumetric else prepared.outer_side,
        "tolerance": float(prepared.problem.prior.tolerance),
        "components": fits.joint.mixture.live.sum(axis=1).tolist(),
        "message_length": np.round(fits.message_length, 3).tolist(),
        "density_ratio": np.round(fits.density_ratio, 4).tolist(),
        "steps": fits.steps.tolist(),
        "converged": np.asarray(fits.result == FitStatus.converged).tolist(),
        "seconds": dict(clock.seconds),
        "device": jax.devices()[0].device_kind,
        "precision": "float64",
    }


def _cloud_diagnostics(
    scan: Scan, cloud: CheckedCloud, working: WorkingCloud, views: SensorViews | None
) -> dict[str, Any]:
    """The diagnostics of one scan."""
    # In the frame of the scan, where those above are in that of the before scan.
    recognised = scan.views if scan.recognised and views is not None else None
    return {
        **cloud.diagnostics(scan.cloud),
        "points_compared": len(working.points),
        "views": 0 if views is None else len(views),
        "recognised_stations": [] if recognised is None else recognised.poses[:, :3, 3].tolist(),
    }
