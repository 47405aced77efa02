"""The fit in a loss of one's own: two scans of a room are aligned by the message length of their common mixture.

Where the scans lie on each other the walls are thin, and the mixture of both takes the fewest nats. Its gradient with
respect to a rigid motion goes through the fit: the mixture follows the motion.
"""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from scipy.spatial.transform import Rotation

from gmmjax import FitSettings, Prior, fit_mixture
from gmmjax.scenes import laboratory_scene

SLOTS = 15
# From coarse to fine, metres: a wide floor leaves few Gaussians, and smooths what keeps the clouds apart.
NOISE_FLOORS = (0.1, 0.05, 0.02, 0.02)
KEY = jax.random.key(0)
# As many as there are slots: while the motion is sought no Gaussian dies, and the loss is smooth.
HELD = FitSettings(polish=True, min_components=SLOTS)


def misaligned(seed: int, points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two scans of a room of 2 m, the second turned by 3 degrees and shifted by 5 cm, and the second as it was."""
    room = laboratory_scene(jax.random.key(seed)).before
    generator = np.random.default_rng(seed)
    first, second = np.split(generator.permutation(room)[: 2 * points], 2)
    axis, direction = (vector / np.linalg.norm(vector) for vector in generator.normal(size=(2, 3)))
    turned = Rotation.from_rotvec(np.deg2rad(3) * axis).apply(second - room.mean(axis=0)) + room.mean(axis=0)
    return first, turned + 0.05 * direction, second


def moved(points: jax.Array, motion: jax.Array) -> jax.Array:
    """Points turned about their mean by the vector motion[:3] (Rodrigues), and shifted by motion[3:]."""
    angle = jnp.sqrt(jnp.sum(motion[:3] ** 2) + 1e-24)
    x, y, z = motion[:3] / angle
    cross = jnp.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation = jnp.eye(3) + jnp.sin(angle) * cross + (1 - jnp.cos(angle)) * cross @ cross
    centre = jnp.mean(points, axis=0)
    return (points - centre) @ rotation.T + centre + motion[3:]


def loss(motion, arguments):
    """Message length of both clouds, nats a point, as a function of the motion of the second."""
    first, second, start, prior = arguments
    both = jnp.concatenate([first, moved(second, motion)])
    return fit_mixture(both, key=KEY, prior=prior, start=start, settings=HELD).message_length / len(both)


def aligned(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The motion of the second cloud that makes the mixture of both the shortest."""
    motion = jnp.zeros(6)
    for round_, noise_floor in enumerate(NOISE_FLOORS):
        prior = jax.tree.map(jnp.asarray, Prior.figueiredo_jain(3, noise_floor))
        both = np.concatenate([first, np.asarray(moved(jnp.asarray(second), motion))])
        key = jax.random.fold_in(KEY, round_)
        fit = fit_mixture(both, key=key, prior=prior, max_components=SLOTS, settings=FitSettings(patience=0.02))
        arguments = (jnp.asarray(first), jnp.asarray(second), jax.tree.map(jnp.asarray, fit.mixture), prior)
        solver = optx.BFGS(rtol=1e-8, atol=1e-8)
        motion = optx.minimise(loss, solver, motion, arguments, max_steps=60, throw=False).value
        length = float(loss(motion, arguments))
        print(f"noise floor {noise_floor:.2f} m, {int(fit.mixture.live.sum()):2} Gaussians: {length:.4f} nats a point")
    return np.asarray(motion)


def main() -> None:
    """Aligns two scans, and says how far off they were and are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=4000, help="of each scan")
    parser.add_argument("--seed", type=int, default=0, help="of the room and the motion")
    parser.add_argument("--plot", type=Path, help="picture to write, such as scans.png")
    options = parser.parse_args()
    with jax.enable_x64(True):
        first, second, truth = misaligned(options.seed, options.points)
        scans = {}
        for name, motion in (("before", np.zeros(6)), ("after", aligned(first, second))):
            placed = scans[name] = np.asarray(moved(jnp.asarray(second), jnp.asarray(motion)))
            left, _ = Rotation.align_vectors(placed - placed.mean(axis=0), truth - truth.mean(axis=0))
            shift = np.linalg.norm(placed.mean(axis=0) - truth.mean(axis=0))
            print(f"{name}: {1000 * shift:.2f} mm and {np.rad2deg(left.magnitude()):.3f} degrees off")
    if options.plot:
        draw(options.plot, first, scans)


def draw(file: Path, first: np.ndarray, scans: dict[str, np.ndarray]) -> None:
    """Both scans from above, a slice of 20 cm at half the height of the room: the walls show how they lie."""
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 2, figsize=(9, 4.6), layout="constrained", sharex=True, sharey=True)
    level = np.median(first[:, 2])
    for ax, name in zip(panels, ("before", "after"), strict=True):
        for points, color in ((first, "#0072B2"), (scans[name], "#D55E00")):
            near = points[np.abs(points[:, 2] - level) < 0.1]
            ax.scatter(near[:, 0], near[:, 1], s=3, color=color, linewidths=0)
        ax.set(title=f"{name} the alignment", xlabel="x (m)", ylabel="y (m)", aspect="equal")
    figure.savefig(file)


if __name__ == "__main__":
    main()
