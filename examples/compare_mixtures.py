"""How far apart two mixtures are: the earth mover's distance, its plan, and its gradient."""

import argparse
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from gmmjax import GaussianMixture, TransportStatus, earth_movers_distance


def mixture(weights: list[float], means: list[list[float]]) -> GaussianMixture:
    """Round Gaussians with a standard deviation of 0.2."""
    count, dimension = len(weights), len(means[0])
    covariances = jnp.tile(0.04 * jnp.eye(dimension), (count, 1, 1))
    return GaussianMixture(jnp.asarray(weights), jnp.asarray(means), covariances, live=jnp.ones(count, bool))


def main(plot: Path | None) -> None:
    before = mixture([0.5, 0.5], [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    after = mixture([0.4, 0.4, 0.2], [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 3.0, 0.0]])

    result = earth_movers_distance(before, after)
    assert result.result == TransportStatus.optimal
    print(f"EMD {result.cost:.3f}")
    print("what moves from where (rows) to where (columns):")
    print(np.round(np.asarray(result.plan), 3))

    def distance_from(means: jax.Array) -> jax.Array:
        return earth_movers_distance(before, eqx.tree_at(lambda other: other.means, after, means)).cost

    print("gradient with respect to the means after:")
    print(np.round(np.asarray(jax.grad(distance_from)(after.means)), 3) + 0.0)

    smooth = earth_movers_distance(before, after, solver="sinkhorn", epsilon=0.5)
    print(f"Sinkhorn, epsilon 0.5: {smooth.cost:.3f}")
    if plot:
        from gmmjax.plotting import plot_transport

        plot_transport(before, after, result, direction="above").figure.savefig(plot)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plot", type=Path, help="picture to write, such as scans.png")
    main(parser.parse_args().plot)
