"""The figures of the method, by the code that they explain: `python docs/figures/method.py [NAME ...]`.

All but two show the storehouse of `gmmjax demo`, with half as many points, or as its scanner measured it.
"""

import sys
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from drawing import overlaid, saved
from matplotlib import colormaps, pyplot
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.patches import Ellipse, Patch

from gmmjax import Changes, DetectionConfig, GaussianMixture, earth_movers_distance, fit_mixture
from gmmjax.changes import JointDetector, Scan
from gmmjax.changes.detectors.aligned_scans import AlignedScans
from gmmjax.changes.evidence.free_space import observation
from gmmjax.changes.fit.joint_fit import JointFits
from gmmjax.changes.progress import Clock
from gmmjax.clouds import PointCloud, recognised_stations
from gmmjax.mixtures import FitSettings
from gmmjax.pair import Pair, each
from gmmjax.plotting import plot_message_length, plot_mixture, plot_registration, plot_transport
from gmmjax.scenes import StorehouseSettings, storehouse


class Detection:
    """One detection, and what its stages made on the way."""

    def __init__(self) -> None:
        colored = storehouse(0, StorehouseSettings(points=25_000, rays=35_000))
        self.clouds = each(
            lambda points, colors, views: PointCloud.from_rows(points, colors, views=views),
            colored.scene.clouds,
            colored.colors,
            colored.scene.views,
        )
        scans = each(lambda cloud, views: Scan(cloud, views), self.clouds, colored.scene.views)
        self.detector = JointDetector(DetectionConfig())
        self.prepared: AlignedScans = self.detector.prepared(scans, Clock(lambda *report: None))
        self.fits = JointFits.of_arrays(
            self.detector.fitted(self.prepared, range(1), lambda share: None), self.prepared.framed.frame
        )
        self.changes: Changes = self.detector.changes(scans)


def mixture(detection: Detection) -> None:
    """The joint mixture from above: the colour is the share of the after cloud in a Gaussian."""
    joint, frame = jax.tree.map(lambda leaf: np.asarray(leaf)[0], detection.fits.joint), detection.fits.frame
    live = np.flatnonzero(joint.mixture.live)
    means = np.asarray(joint.mixture.means)[live] * float(frame.spread) + np.asarray(frame.origin)
    covariances = np.asarray(joint.mixture.covariances)[live] * float(frame.spread) ** 2
    shares = np.asarray(joint.share_after)[live]
    colormap, norm = colormaps["PuOr_r"], Normalize(0, 1)
    figure, ax = pyplot.subplots(figsize=(8, 5), layout="constrained")
    points = np.concatenate(list(detection.prepared.pair.points))
    ax.scatter(*points[::2, :2].T, s=0.6, color="0.8", linewidths=0, rasterized=True)
    # The smallest last: the floor would cover the things on it.
    for index in np.argsort([-np.linalg.det(covariance[:2, :2]) for covariance in covariances]):
        values, axes = np.linalg.eigh(covariances[index][:2, :2])
        angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
        size = 4 * np.sqrt(values[::-1])
        ax.add_patch(
            Ellipse(means[index][:2], *size, angle=angle, color=colormap(norm(shares[index])), alpha=0.55, linewidth=0)
        )
        ax.add_patch(Ellipse(means[index][:2], *size, angle=angle, fill=False, edgecolor="0.35", linewidth=0.6))
    ax.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    bar = figure.colorbar(ScalarMappable(norm, colormap), ax=ax, shrink=0.8)
    bar.set_label("share of the after cloud, θ")
    saved(figure, "method-mixture.png", dpi=100)


def registration(detection: Detection) -> None:
    """Both scans as given and as registered in a corner, and the distances between their surfaces."""
    figure, panels = pyplot.subplots(1, 3, figsize=(11, 3.6), layout="constrained", width_ratios=(1, 1, 1.3))
    before, after = (cloud.points for cloud in detection.clouds)
    registered = detection.changes.registration.apply(after)
    for ax, title, points in ((panels[0], "as given", after), (panels[1], "registered", registered)):
        overlaid(Pair(before, points), ax, axes=(0, 1), size=3.0)
        ax.set(xlim=(2.0, 4.4), ylim=(2.2, 3.7), title=title, xlabel="x (m)", ylabel="y (m)")
    plot_registration(detection.changes, *detection.clouds, ax=panels[2])
    saved(figure, "method-registration.png", dpi=90)


def differences(detection: Detection) -> None:
    """The offsets of the unchanged and the changed points, and the level of detection."""
    found, changes = detection.prepared.differences, detection.changes
    offsets = (
        detection.prepared.checked.after.to_rows(
            found.local.after.offset[detection.prepared.pair.working.clouds.after.member], np.nan
        )
        * 1000
    )
    labels = changes.labels_after
    limit = found.limits.offset * 1000
    figure, ax = pyplot.subplots(figsize=(7, 3.4), layout="constrained")
    bins = np.geomspace(0.02, 1500, 70)
    for name, rows, color in (("unchanged", labels < 0, "0.6"), ("changed", labels >= 0, "#009E73")):
        ax.hist(np.clip(offsets[rows], bins[0], bins[-1]), bins, color=color, alpha=0.8, label=f"reported as {name}")
    ax.axvline(limit, color="#D55E00", label=f"certain from here on: {limit:.0f} mm")
    error = found.limits.registration_error * 1000
    ax.axvline(error, color="#D55E00", linestyle="--", label=f"registration error: {error:.1f} mm")
    ax.set(xscale="log", yscale="log", xlabel="offset from the before surface (mm)", ylabel="points of the after scan")
    ax.legend(fontsize="small")
    saved(figure, "method-offsets.png", dpi=100)


def free_space(detection: Detection) -> None:
    """What the before survey observed half a metre above the floor, and the after points that lie there."""
    survey: ScanVisibility = detection.prepared.surveys.before
    assert survey.views is not None
    steps = np.arange(-5.2, 5.2, 0.03), np.arange(-3.7, 3.7, 0.03)
    x, y = np.meshgrid(*steps)
    level = 0.5
    places = np.stack([x.ravel(), y.ravel(), np.full(x.size, level)], axis=1)
    limits = detection.prepared.differences.limits
    seen = observation(places, survey, limits.distance).reshape(x.shape)
    colors = ("#BDBDBD", "#4D4D4D", "#D8ECF8")
    figure, ax = pyplot.subplots(figsize=(8, 5), layout="constrained")
    extent = (steps[0][0], steps[0][-1], steps[1][0], steps[1][-1])
    ax.imshow(seen, origin="lower", extent=extent, cmap=ListedColormap(colors), vmin=-1.5, vmax=1.5)
    ax.plot(*survey.views.poses[:, :2, 3].T, "k^", label="scanner, before")
    after = detection.prepared.pair.points.after
    own = after[np.abs(after[:, 2] - level) < 0.06]
    ax.scatter(*own[:, :2].T, s=5, color="#D55E00", linewidths=0, label="after scan")
    names = ("not observed", "surface", "free")
    handles = [Patch(color=color, label=f"before: {name}") for color, name in zip(colors, names, strict=True)]
    ax.legend(
        handles=[*handles, *ax.get_legend_handles_labels()[0]],
        fontsize="small",
        loc="upper left",
        bbox_to_anchor=(1, 1),
    )
    ax.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    saved(figure, "method-free-space.png", dpi=100)


def stations(detection: Detection) -> None:
    """The density of the storehouse's floor as its scanner measured it, from above, with the stations in it."""
    del detection  # Its points are fused in voxels.
    scene = storehouse(0, StorehouseSettings(points=1_000_000, rays=200_000)).scene
    points, places = scene.clouds.before, scene.views.before.poses[:, :3, 3]
    found = recognised_stations(points)
    floor = points[np.abs(points[:, 2]) < 0.03]
    figure, ax = pyplot.subplots(figsize=(8, 5), layout="constrained")
    size = 0.04
    edges = [np.arange(own.min(), own.max() + size, size) for own in floor[:, :2].T]
    *_, image = ax.hist2d(
        *floor[:, :2].T, bins=edges, norm=LogNorm(1 / size**2, 2e4), weights=np.full(len(floor), size**-2)
    )
    figure.colorbar(image, label="points per square metre", shrink=0.8)
    ax.set_facecolor("black")
    ax.plot(*places[:, :2].T, "^", color="white", markersize=9, label="station")
    ax.plot(*found[:, :2].T, "x", color="#D55E00", markersize=9, markeredgewidth=2.5, label="recognised")
    ax.legend(fontsize="small", loc="upper left", facecolor="#BDBDBD")
    ax.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    saved(figure, "method-stations.png", dpi=100)


def transport(detection: Detection) -> None:
    """Two mixtures, and how mass is moved from one to the other."""
    del detection

    def round_ones(weights: list[float], means: list[list[float]]) -> GaussianMixture:
        covariances = jnp.tile(0.05 * jnp.eye(2), (len(weights), 1, 1))
        return GaussianMixture(jnp.array(weights), jnp.array(means), covariances, live=jnp.ones(len(weights), bool))

    before = round_ones([0.5, 0.5], [[0.0, 0.0], [3.0, 0.0]])
    after = round_ones([0.4, 0.4, 0.2], [[0.2, 0.2], [3.0, 0.1], [1.8, 1.6]])
    figure, ax = pyplot.subplots(figsize=(6.5, 3.6), layout="constrained")
    plot_transport(before, after, earth_movers_distance(before, after), deviations=2.0, ax=ax)
    saved(figure, "method-transport.png", dpi=100)


def selection(detection: Detection) -> None:
    """A mixture that was fitted to a cloud, and how its number of Gaussians was found."""
    del detection
    random = np.random.default_rng(2)
    # The mean of each Gaussian, and what makes round noise of its shape.
    shapes = (
        ((0.0, 0.0), ((0.5, 0.2), (0.0, 0.3))),
        ((3.0, 0.5), ((0.3, 0.0), (0.0, 0.5))),
        ((1.2, 2.4), ((0.6, -0.3), (0.0, 0.2))),
        ((3.6, 2.8), ((0.25, 0.0), (0.0, 0.25))),
    )
    points = np.concatenate([mean + random.normal(size=(250, 2)) @ np.array(shape) for mean, shape in shapes])
    best = fit_mixture(points, key=jax.random.key(0), max_components=12, restarts=4)
    lengths = [
        fit_mixture(points, key=jax.random.key(1), max_components=count, settings=FitSettings(min_components=count))
        for count in range(1, 10)
    ]
    figure, panels = pyplot.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
    plot_mixture(best.mixture, points, ax=panels[0])
    plot_message_length(lengths, ax=panels[1])
    saved(figure, "method-selection.png", dpi=90)


FIGURES: dict[str, Callable[[Any], None]] = {
    "mixture": mixture,
    "registration": registration,
    "differences": differences,
    "free_space": free_space,
    "stations": stations,
    "transport": transport,
    "selection": selection,
}

if __name__ == "__main__":
    made = Detection()
    for name in sys.argv[1:] or FIGURES:
        FIGURES[name](made)
