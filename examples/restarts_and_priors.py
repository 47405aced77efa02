"""What random restarts gain, and a prior that is tuned by gradient: `gmmjax.compare` on artificial pairs.

Five Gaussians close to each other, of which one disappears and another appears. The probability that a point appeared
is averaged over ever more restarts, and scored against the truth. Then the noise floor and the concentration of the
joint mixture's prior are tuned by gradient through the fits, from a noise floor that is far too large. Other pairs show
what that gains.
"""

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from gmmjax import FitSettings, compare, compare_many
from gmmjax.comparison import Method, joint_prior
from gmmjax.scenes import GaussianScene, random_scene

COMPONENTS = 12
WRONG_NOISE = 0.7  # metres; the Gaussians have standard deviations of 0.1 to 0.3 m
SCORES = (0.003, 0.01, 0.03, 0.1)
COLORS = ("#7B3294", "#E69F00", "#0072B2")


def scenes(seeds: Sequence[int]) -> list[GaussianScene]:
    """Pairs of 300 points."""
    return [random_scene(jax.random.key(seed), overlap="medium", disappeared=1, points=60) for seed in seeds]


def brier_by_restarts(
    pairs: list[GaussianScene], method: Method, restarts: int
) -> dict[int, tuple[np.floating, np.floating]]:
    """The Brier score of the mean probability, and its standard error, by the number of restarts.

    The restarts are split into groups of 1, 2, 4, ..., at least four of them, which are averaged each by itself.
    """
    clouds = [(pair.before, pair.after) for pair in pairs]
    errors: dict[int, list[Float[np.ndarray, " groups"]]] = {}
    for found in compare_many(
        clouds, key=jax.random.key(0), restarts=restarts, max_components=COMPONENTS, method=method
    ):
        appeared = pairs[found.pair].truth_after >= 0
        for size in 2 ** np.arange(int(np.log2(restarts // 4)) + 1):
            means = np.asarray(found.restarts.probability_after).reshape(-1, size, len(appeared)).mean(axis=1)
            errors.setdefault(int(size), []).append(((means - appeared) ** 2).mean(axis=1))
    over_pairs = {size: np.mean(errors[size], axis=0) for size in sorted(errors)}
    return {size: (groups.mean(), groups.std(ddof=1) / np.sqrt(len(groups))) for size, groups in over_pairs.items()}


def brier(
    leaves: dict[str, Array],
    before: Float[Array, "n0 3"],
    after: Float[Array, "n1 3"],
    appeared: Bool[Array, " n1"],
    key: PRNGKeyArray,
) -> tuple[Float[Array, ""], Bool[Array, ""]]:
    """The score of one restart, and whether it has derivatives."""
    prior = joint_prior(noise_floor=jnp.exp(leaves["log_noise_floor"]), tolerance=0.0)
    prior = dataclasses.replace(prior, concentration=leaves["concentration"])
    settings = FitSettings(polish=True)
    found = compare(before, after, key=key, prior=prior, max_components=COMPONENTS, method="joint", settings=settings)
    return jnp.mean((found.probability_after - appeared) ** 2), found.at_rest


def mean_brier(leaves: dict[str, Array], pairs: tuple[Array, ...]) -> Float[Array, ""]:
    """The mean over pairs and restarts."""
    over_restarts = jax.vmap(brier, in_axes=(None, None, None, None, 0))
    scores, at_rest = jax.vmap(over_restarts, in_axes=(None, 0, 0, 0, 0))(leaves, *pairs)
    return jnp.mean(scores, where=at_rest)


def stacked(pairs: list[GaussianScene], restarts: int = 4) -> tuple[Array, ...]:
    """The arguments of `brier` with leading axes of pairs, and of restarts."""
    arrays = [jnp.stack([getattr(pair, name) for pair in pairs]) for name in ("before", "after", "truth_after")]
    return arrays[0], arrays[1], arrays[2] >= 0, jax.random.split(jax.random.key(1), (len(pairs), restarts))


def tuned(training: list[GaussianScene], unseen: list[GaussianScene], steps: int) -> list[tuple[float, float, float]]:
    """At each step the noise floor, the loss, and that of pairs which are not trained on."""
    leaves = {"log_noise_floor": jnp.log(jnp.float32(WRONG_NOISE)), "concentration": jnp.float32(-4.0)}
    optimiser = optax.adam(0.2)
    state = optimiser.init(leaves)
    value_and_gradient = jax.jit(jax.value_and_grad(mean_brier))
    pairs, others, course = stacked(training), stacked(unseen), []
    for _ in range(steps):
        loss, gradient = value_and_gradient(leaves, pairs)
        other, _ = value_and_gradient(leaves, others)
        course.append((float(jnp.exp(leaves["log_noise_floor"])), float(loss), float(other)))
        updates, state = optimiser.update(gradient, state)
        leaves = optax.apply_updates(leaves, updates)
    return course


def main() -> None:
    """Prints both, and draws them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--restarts", type=int, default=64, help="of each pair, a power of two")
    parser.add_argument("--steps", type=int, default=30, help="of the optimiser")
    parser.add_argument("--plot", type=Path, help="picture to write, such as course.png")
    options = parser.parse_args()
    methods: tuple[Method, ...] = ("greedy", "transport", "joint")
    curves = {method: brier_by_restarts(scenes(range(8)), method, options.restarts) for method in methods}
    for method, curve in curves.items():
        print(
            f"{method:9}",
            ", ".join(f"{size} restarts {mean:.4f} +- {error:.4f}" for size, (mean, error) in curve.items()),
        )
    course = tuned(scenes(range(8)), scenes(range(100, 108)), options.steps)
    for name, (noise, loss, other) in (("wrong", course[0]), ("tuned", course[-1])):
        print(f"{name} noise floor {noise:.2f} m: Brier score {loss:.4f}, of other pairs {other:.4f}")
    if options.plot:
        draw(options.plot, curves, course)


def draw(
    file: Path,
    curves: dict[Method, dict[int, tuple[np.floating, np.floating]]],
    course: list[tuple[float, float, float]],
) -> None:
    """The score by the number of restarts, and the course of the tuning."""
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for method, color in zip(curves, COLORS, strict=True):
        means, standard_errors = np.transpose(list(curves[method].values()))
        left.errorbar(list(curves[method]), means, standard_errors, fmt="o-", color=color, capsize=3, label=method)
    left.set(xscale="log", yscale="log", xlabel="restarts averaged", ylabel="Brier score", title="restarts of 8 pairs")
    left.set_xticks(list(curves["joint"]), labels=[str(size) for size in curves["joint"]])
    left.set_yticks(SCORES, labels=[f"{score:g}" for score in SCORES])
    left.minorticks_off()
    left.legend(frameon=False)
    noise, loss, other = np.transpose(course)
    right.semilogy(loss, color=COLORS[2], label="Brier score, pairs tuned on")
    right.semilogy(other, color="black", label="Brier score, other pairs")
    right.semilogy(noise, "--", color="grey", label="noise floor, metres")
    right.set(xlabel="steps of the optimiser", title="joint: prior tuned from a wrong noise floor")
    right.legend(frameon=False)
    for ax in (left, right):
        ax.spines[["top", "right"]].set_visible(False)
        ax.grid(which="major", color="0.92")
    figure.savefig(file, dpi=110)


if __name__ == "__main__":
    main()
