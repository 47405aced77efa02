"""Precision on thin planes, memory of a large fit, and how a fit grows with points and components."""

import jax
import pytest

from gmmjax import Prior, fit_mixture
from tests.benchmarks import peers, tasks
from tests.benchmarks.bench_fit import a_step, long_and_short
from tests.benchmarks.scenes import GAUSSIANS, exact_length, gaussian_cloud, planes
from tests.benchmarks.workers import worker


@pytest.mark.benchmark(group="precision")
@pytest.mark.parametrize("millimetres", [20, 5, 1])
def test_float32_on_planes(bench, quick, millimetres):
    """What a float32 fit says of its message length, against the same mixture's in float64 on the same points."""
    if quick and millimetres == 5:
        pytest.skip("--quick")
    points = planes(millimetres / 1000, 1500 if quick else 6000)
    prior = Prior.figueiredo_jain(3, millimetres / 1000 / 10)
    timings = bench.compare(
        fit=lambda: fit_mixture(points, key=jax.random.key(0), prior=prior, precision="float32", throw=False)
    )
    fit = timings["fit"].answer
    exact = exact_length(fit.mixture, points)
    bench.row(
        f"float32 message length against float64, planes of {millimetres} mm",
        asked=0.1,
        measured=abs(float(fit.message_length) - exact),
        unit="nats",
        least=False,
        ours=f"{float(fit.message_length):.2f}, computed in float{int(fit.bits)}",
        peer=f"{exact:.2f}",
    )


@pytest.mark.benchmark(group="memory")
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_memory(bench, quick, precision):
    """The peak of a process that fits 1,000,000 points, over what it held before. All steps need the same: few do."""
    if quick and precision == "float64":
        pytest.skip("--quick")
    size = 100_000 if quick else 1_000_000
    peaks = []

    def measure():
        with worker(2) as fresh:
            done = fresh(tasks.peak_memory, size, precision, 2)
        peaks.append(done.answer)
        return done

    bench.compare(ours=measure)
    peak, data = max(peaks)
    bench.row(f"memory of a fit of {size:,} points over the data, {precision}", asked=1.0, measured=peak / 1e9,
              unit="GB", least=False, ours=f"{peak / 1e9:.2f} GB", peer=f"data {data / 1e9:.3f} GB")  # fmt: skip


@pytest.mark.benchmark(group="scaling")
@pytest.mark.parametrize("size", [5_000, 20_000, 100_000, 300_000, 1_000_000])
def test_scaling_in_points(bench, quick, size):
    """A whole fit, K_max 25, beside one fit of scikit-learn that is given the true K."""
    if quick and size > 5_000:
        pytest.skip("--quick")
    points = gaussian_cloud(size)
    timings = bench.compare(
        float64=lambda: tasks.fit(points),
        float32=lambda: tasks.fit(points, "float32"),
        sklearn=lambda: peers.sklearn_fixed(points, GAUSSIANS),
    )
    names = {"float64": "float64, K found", "float32": "float32, K found", "sklearn": "scikit-learn, K given"}
    for name, line in names.items():
        bench.curve("points", line, [size], [timings[name].cpu])


@pytest.mark.benchmark(group="scaling")
@pytest.mark.parametrize("components", [8, 16, 25, 40, 80])
def test_scaling_in_components(bench, quick, components):
    """One EM iteration on 20,000 points."""
    if quick and components > 8:
        pytest.skip("--quick")
    points = gaussian_cloud(4000 if quick else 20000)
    timings = bench.compare(**long_and_short(points, components, peer_long=15))
    names = {"float64": "float64", "float32": "float32", "sklearn": "scikit-learn", "gmmx": "gmmx"}
    for name, line in names.items():
        bench.curve("components", line, [components], [a_step(timings, name)])
