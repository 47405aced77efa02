"""One fit, one EM iteration, voxel masses: mixtures against what a user could pick instead."""

import pytest

from tests.benchmarks import peers, tasks
from tests.benchmarks.scenes import GAUSSIANS, exact_length, gaussian_cloud


@pytest.mark.benchmark(group="fit")
def test_one_fit(bench, quick):
    """5,000 points, K_max 25, all contenders on the same clouds; several clouds, as the number of steps is luck."""
    clouds = [gaussian_cloud(1000 if quick else 5000, seed) for seed in range(1 if quick else 3)]
    most = 12 if quick else tasks.MAX_COMPONENTS

    def each(function, *arguments):
        return lambda: [function(cloud, *arguments) for cloud in clouds]

    timings = bench.compare(
        float64=each(lambda cloud: tasks.fit(cloud, "float64", most).mixture.live_part()),
        float32=each(lambda cloud: tasks.fit(cloud, "float32", most).mixture.live_part()),
        plain_numpy=each(peers.plain_figueiredo_jain, most),
        lean_numpy=each(peers.figueiredo_jain, most),
        sklearn_grid=each(peers.sklearn_grid, most),
        sklearn_bayesian=each(peers.sklearn_bayesian, most),
        gmmx_fixed_k=each(lambda cloud: peers.gmmx_fit(cloud, GAUSSIANS)[0]),
    )
    answers = {name: [len(mixture.weights) for mixture in timing.answer] for name, timing in timings.items()}
    lengths = {
        name: [exact_length(mixture, cloud) for mixture, cloud in zip(timing.answer, clouds, strict=True)]
        for name, timing in timings.items()
    }
    bench.answers(components=answers, message_lengths=lengths)
    # Nothing is asked against the others: they find another answer, or are given K.
    others = {"float32": ("gmmx_fixed_k",), "float64": ("sklearn_grid", "sklearn_bayesian")}
    for precision, asked in (("float32", 100), ("float64", 40)):
        for name in ("plain_numpy", "lean_numpy"):
            bench.ratio(f"one fit, {precision}, against {name}", asked, timings, precision, name)
        for name in others[precision]:
            bench.ratio(f"one fit, {precision}, against {name}", None, timings, precision, name)
        excess = max(own - peer for own, peer in zip(lengths[precision], lengths["plain_numpy"], strict=True))
        bench.row(
            f"one fit, {precision}: message length above NumPy's, the worst of {len(clouds)}",
            asked=0.1,
            measured=excess,
            unit="nats",
            least=False,
            ours=f"K {answers[precision]}",
            peer=f"K {answers['plain_numpy']}",
        )


@pytest.mark.benchmark(group="EM iteration")
def test_em_iteration(bench, quick):
    """The difference of a long and a short run over the difference of their steps: starts and compilation cancel."""
    points, components = gaussian_cloud(4000 if quick else 20000), tasks.MAX_COMPONENTS
    timings = bench.compare(**long_and_short(points, components))
    # gmmx knows float32 only.
    for precision, peer, asked in (("float64", "sklearn", 20), ("float32", "gmmx", None)):
        what = f"EM iteration, K = {components}, {len(points):,} points, {precision}, against {peer}"
        bench.ratio(what, asked, timings, a_step(timings, precision), a_step(timings, peer))


def long_and_short(points, components, short=5, long=45, peer_long=25):
    """Contenders for `a_step`; each returns how many steps it made."""
    steps = {
        "float64": (lambda number: tasks.steps(points, components, number), long),
        "float32": (lambda number: tasks.steps(points, components, number, "float32"), long),
        "sklearn": (lambda number: peers.sklearn_steps(points, components, number), peer_long),
        "gmmx": (lambda number: peers.gmmx_fit(points, components, number, 0.0)[1], peer_long),
    }
    return {
        f"{name}_{length}": lambda run=run, number=number: run(number)
        for name, (run, longest) in steps.items()
        for length, number in (("short", short), ("long", longest))
    }


def a_step(timings, name):
    """CPU seconds of one step."""
    longer, shorter = timings[f"{name}_long"], timings[f"{name}_short"]
    return (longer.cpu - shorter.cpu) / (longer.answer - shorter.answer)


@pytest.mark.benchmark(group="voxels")
def test_voxel_masses(bench, quick):
    """100,000 points end to end: as they are, and by at most 4,096 voxels with their masses and the scatter within."""
    points = gaussian_cloud(20_000 if quick else 100_000)
    timings = bench.compare(voxels=lambda: tasks.fit_voxels(points), all_points=lambda: tasks.fit(points))
    bench.ratio(f"{len(points):,} points with voxel masses, against all points", 8, timings, "voxels", "all_points")
    reduced, whole = (timings[name].answer.mixture.live_part() for name in ("voxels", "all_points"))
    lengths = exact_length(reduced, points), exact_length(whole, points)
    bench.row(
        "voxel masses: difference of the message length on all points",
        asked=0.1,
        measured=100 * abs(lengths[0] / lengths[1] - 1),
        unit="%",
        least=False,
        ours=f"K {len(reduced.weights)}, {lengths[0]:.1f}",
        peer=f"K {len(whole.weights)}, {lengths[1]:.1f}",
    )
