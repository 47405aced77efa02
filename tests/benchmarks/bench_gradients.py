"""What a gradient by the prior costs beside the fit, and beside the unrolled steps of EM; and its memory."""

import jax
import numpy as np
import pytest

from gmmjax.scenes import random_scene
from tests.benchmarks import tasks
from tests.benchmarks.gradients import Contenders, fit_and_gradient
from tests.benchmarks.scenes import GAUSSIANS, gaussian_cloud

STEPS = (50, 200, 800)


def cloud(scene, size):
    """Points of eight Gaussians that lie apart, or overlap."""
    if scene == "overlapping":
        return gaussian_cloud(size)
    return random_scene(jax.random.key(0), start=GAUSSIANS, appeared=0, points=size // GAUSSIANS).before


def size_of(quick):
    return 2000 if quick else 20_000


@pytest.mark.benchmark(group="gradients")
@pytest.mark.parametrize("size", [2000, 20_000])
@pytest.mark.parametrize("scene", ["apart", "overlapping"])
def test_gradient_beside_the_fit(bench, quick, scene, size):
    """A polished fit from 25 components, and the same with its gradient by every leaf of the prior."""
    points = cloud(scene, 2000 if quick else size)
    fit, gradient = fit_and_gradient(points, tasks.MAX_COMPONENTS)
    timings = bench.compare(fit=fit, gradient=gradient)
    alone, both = timings["fit"].cpu, timings["gradient"].cpu
    bench.row(
        f"gradient by all of the prior, {len(points):,} points, {scene}: excess over the fit, by the fit's time",
        asked=0.3,
        measured=(both - alone) / alone,
        unit="x",
        least=False,
        ours=f"{1e3 * both:.0f} ms with gradient",
        peer=f"{1e3 * alone:.0f} ms fit",
    )
    (_, (steps, count)), ((_, (own_steps, own_count)), _) = timings["fit"].answer, timings["gradient"].answer
    bench.answers(
        components={"fit": [int(count)], "gradient": [int(own_count)]},
        steps={"fit": [int(steps)], "gradient": [int(own_steps)]},
    )


@pytest.mark.benchmark(group="gradients")
@pytest.mark.parametrize("scene", ["apart", "overlapping"])
def test_implicit_against_unrolled(bench, quick, scene):
    """A fit from 25 components with its implicit gradient, and as many steps of EM differentiated one by one."""
    ways = Contenders(cloud(scene, size_of(quick)), tasks.MAX_COMPONENTS)
    timings = bench.compare(implicit=ways.gradient("implicit", 5000), unrolled=ways.gradient("unrolled", ways.steps))
    what = f"fit and gradient, {scene}, {ways.steps} steps: implicit against unrolled on the components that won"
    bench.ratio(what, None, timings, "implicit", "unrolled")


@pytest.mark.benchmark(group="gradients")
def test_memory_of_gradients(bench, quick):
    """What the compiled programs say that they need; of the unrolled steps only the compilation is run."""
    ways = Contenders(cloud("overlapping", size_of(quick)), tasks.MAX_COMPONENTS)
    bench.compare(implicit=ways.gradient("implicit", STEPS[0]))
    for kind, asked in (("implicit", 1.0), ("unrolled", None)):
        megabytes = np.array([ways.memory(kind, steps) for steps in STEPS]) / 1e6
        bench.curve("steps", kind, STEPS, megabytes.tolist())
        bench.row(
            f"memory of the {kind} gradient: of {STEPS[-1]} steps against {STEPS[0]}",
            asked=asked,
            measured=megabytes[-1] / megabytes[0],
            unit="x",
            least=False,
            ours=f"{megabytes[-1]:.3g} MB",
            peer=f"{megabytes[0]:.3g} MB",
        )
