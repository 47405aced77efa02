"""The exact earth mover's distance and Algorithm 1, against POT, SciPy and Sinkhorn."""

import jax
import numpy as np
import ot
import pytest

from tests.benchmarks import peers, tasks
from tests.benchmarks.scenes import changed_mixtures, mixtures


@pytest.mark.benchmark(group="transport")
@pytest.mark.parametrize(("components", "asked"), [(8, 12), (16, 5), (25, 2)])
def test_exact_distance(bench, quick, components, asked):
    """A batch of 1,000 in float64; the slow peers get the first 50 of them, and are compared by the problem."""
    count, few = (100, 10) if quick else (1000, 50)
    before, after = mixtures(count, components), mixtures(count, components, seed=1)
    timings = bench.compare(
        exact=lambda: tasks.batch_of_distances(before, after, "exact"),
        pot=lambda: [peers.pot_distance(*pair) for pair in peers.live_pairs(before, after)],
        scipy=lambda: [peers.linear_programme(*pair) for pair in peers.live_pairs(*first(few, before, after))],
        sinkhorn=lambda: tasks.batch_of_distances(*first(few, before, after), "sinkhorn"),
    )
    numbers = {"exact": count, "pot": count, "scipy": few, "sinkhorn": few}
    each = {name: timing.cpu / numbers[name] for name, timing in timings.items()}
    size = number_of(components)
    for peer in ("pot", "scipy", "sinkhorn"):
        bench.ratio(
            f"exact EMD, {size}, batch of {count:,}, against {peer}",
            asked if peer == "pot" else None,
            timings,
            each["exact"],
            each[peer],
        )
    difference = np.abs(np.asarray(timings["exact"].answer) - timings["pot"].answer).max()
    bench.row(f"exact EMD, {size}: largest difference from POT", asked=1e-9, measured=float(difference), unit="",
              least=False, ours="", peer="")  # fmt: skip


@pytest.mark.benchmark(group="transport")
@pytest.mark.parametrize("components", [10, 25, 100])
def test_exact_distance_one_by_one(bench, quick, components):
    """One call after the other, from NumPy arrays to a number; POT with the costs of `ot.dist`, and of SciPy."""
    count, size = 20 if quick else 200, number_of(components)
    stacks = mixtures(count, components), mixtures(count, components, seed=1)
    before, after = ([jax.tree.map(lambda leaf, i=i: leaf[i], own).live_part() for i in range(count)] for own in stacks)
    pairs = peers.live_pairs(*stacks)
    timings = bench.compare(
        exact=lambda: tasks.single_distances(before, after),
        pot=lambda: [peers.pot_distance(*pair, costs=ot.dist) for pair in pairs],
        pot_with_scipy=lambda: [peers.pot_distance(*pair) for pair in pairs],
    )
    for peer in ("pot", "pot_with_scipy"):
        own, other = (timings[name].cpu / count for name in ("exact", peer))
        bench.ratio(f"exact EMD, {size}, one by one, against {peer}", 1, timings, own, other)
    difference = np.abs(np.subtract(timings["exact"].answer, timings["pot_with_scipy"].answer)).max()
    bench.row(f"exact EMD, {size}, one by one: largest difference from POT", asked=1e-9,
              measured=float(difference), unit="", least=False, ours="", peer="")  # fmt: skip


@pytest.mark.benchmark(group="transport")
def test_entropic_distance(bench, quick):
    """A batch in float64, both until 1e-6 of the mass is in the wrong place; 0.1 is some 5 % of the mean cost."""
    count, components, epsilon = 64 if quick else 256, 25, 0.1
    before, after = mixtures(count, components), mixtures(count, components, seed=1)
    timings = bench.compare(
        ours=lambda: tasks.batch_of_distances(before, after, "sinkhorn", epsilon),
        ott=lambda: peers.ott_distances(before, after, epsilon),
    )
    own, other = (timings[name].cpu / count for name in ("ours", "ott"))
    bench.ratio(f"Sinkhorn, K = {components}, batch of {count}, against ott-jax", None, timings, own, other)
    difference = np.abs(timings["ours"].answer - timings["ott"].answer).max()
    bench.row(f"Sinkhorn, K = {components}: largest difference from ott-jax", asked=1e-4, measured=float(difference),
              unit="", least=False, ours="", peer="")  # fmt: skip


def number_of(components):
    """As `mixtures` has them."""
    return f"K <= {components}" if components <= 16 else f"K = {components}"


def first(count, *stacks):
    """The first of each stack."""
    return jax.tree.map(lambda leaf: leaf[:count], stacks)


@pytest.mark.benchmark(group="transport")
@pytest.mark.parametrize(("components", "asked"), [(8, 12), (25, 4)])
def test_greedy_removal(bench, quick, components, asked):
    """Algorithm 1 for pairs of mixtures of which one Gaussian is gone elsewhere; as many pairs as 16 restarts make."""
    count = 16 if quick else 256
    before = mixtures(count, components)
    after = changed_mixtures(before)
    timings = bench.compare(
        ours=lambda: tasks.removals(before, after),
        pot=lambda: [peers.pot_greedy(*pair) for pair in peers.live_pairs(before, after)],
    )
    size = number_of(components)
    bench.ratio(f"greedy change detection, {size}, {count} pairs, against POT", asked, timings, "ours", "pot")
    ours = timings["ours"].answer
    agree = [
        set(np.flatnonzero(gone)) == set(theirs[0]) and set(np.flatnonzero(new)) == set(theirs[1])
        for gone, new, theirs in zip(ours.disappeared, ours.appeared, timings["pot"].answer, strict=True)
    ]
    bench.row(f"greedy change detection, {size}: pairs with the same removals as POT", asked=99.0,
              measured=100 * float(np.mean(agree)), unit="%", ours="", peer="")  # fmt: skip
