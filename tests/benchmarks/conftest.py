"""The fixture `bench`, which times contenders in turns and keeps rows and curves for `report.py`."""

import importlib.metadata
import os
from collections.abc import Callable, Sequence
from typing import Any

import jax
import pytest

from tests.benchmarks.interleaved import Interleaved, Timing, load

PACKAGES = ("gmmjax", "jax", "numpy", "scipy", "scikit-learn", "POT", "ott-jax", "gmmx", "numba")


def pytest_addoption(parser):
    parser.addoption("--quick", action="store_true", help="benchmarks: few repeats and small sizes, to try them")


@pytest.fixture
def quick(request) -> bool:
    """Whether few repeats and small sizes are wanted."""
    return request.config.getoption("--quick")


class Bench:
    """What one benchmark measures and says, on its way into pytest-benchmark's JSON."""

    def __init__(self, benchmark: Any, quick: bool):
        self.benchmark = benchmark
        self.repeats = 2 if quick else 5
        benchmark.extra_info.update(rows=[], curves=[], contenders={}, quick=quick, cores=len(os.sched_getaffinity(0)))

    def compare(self, **contenders: Callable[[], Any]) -> dict[str, Timing]:
        """The medians of the contenders; one round of pytest-benchmark's is one turn of them all."""
        turns, before = Interleaved(contenders), load()
        self.benchmark.pedantic(turns.turn, rounds=self.repeats, warmup_rounds=1)
        self.benchmark.extra_info["load"] = [before, load()]
        self.benchmark.extra_info["contenders"] = {name: timing.summary() for name, timing in turns.timings.items()}
        return turns.timings

    def ratio(
        self, what: str, asked: float | None, timings: dict[str, Timing], ours: str | float, peer: str | float
    ) -> None:
        """A row that says how many times the CPU seconds of ours the peer takes; either may be seconds already."""
        own, other = (timings[part].cpu if isinstance(part, str) else part for part in (ours, peer))
        self.row(what, asked=asked, measured=other / own, unit="x", ours=seconds(own), peer=seconds(other))

    def answers(self, **answers: Any) -> None:
        """What the contenders found."""
        self.benchmark.extra_info["answers"] = answers

    def row(
        self,
        what: str,
        *,
        asked: float | None,
        measured: float,
        unit: str,
        ours: str,
        peer: str,
        least: bool = True,
    ) -> None:
        """A row of the table; `least`: whether `measured` must be at least `asked`, or at most. None: nothing asked."""
        row = {"what": what, "asked": asked, "measured": measured, "unit": unit, "ours": ours, "peer": peer}
        self.benchmark.extra_info["rows"].append({**row, "least": least})

    def curve(self, figure: str, line: str, x: Sequence[float], y: Sequence[float]) -> None:
        """A line of a figure of the report."""
        self.benchmark.extra_info["curves"].append({"figure": figure, "line": line, "x": list(x), "y": list(y)})


def seconds(value: float) -> str:
    """Three digits and a unit."""
    scale, unit = next(pair for pair in ((1, "s"), (1e3, "ms"), (1e6, "µs")) if value * pair[0] >= 1 or pair[0] == 1e6)
    return f"{value * scale:.3g} {unit}"


@pytest.fixture
def bench(benchmark, quick) -> Bench:
    """See `Bench`."""
    return Bench(benchmark, quick)


@pytest.hookimpl(optionalhook=True)
def pytest_benchmark_update_machine_info(config, machine_info):
    """The device and the versions; the machine's name stays out."""
    machine_info.pop("node", None)
    machine_info["device"] = jax.devices()[0].device_kind
    machine_info["versions"] = {name: importlib.metadata.version(name) for name in PACKAGES if _installed(name)}


def _installed(name: str) -> bool:
    try:
        return bool(importlib.metadata.version(name))
    except importlib.metadata.PackageNotFoundError:
        return False
