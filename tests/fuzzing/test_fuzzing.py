"""Eighty mutants of each reader; `python -m tests.fuzzing` reads more."""

import pytest

from tests.fuzzing.campaign import Fuzzer, Limits
from tests.fuzzing.targets import all_targets

pytest.importorskip("resource", reason="the worker measures its memory by it")


@pytest.fixture(scope="module")
def fuzzer():
    with Fuzzer() as running:
        yield running


@pytest.mark.slow
@pytest.mark.parametrize("reader", all_targets())
def test_mutants_are_read_or_refused_in_one_line(fuzzer, reader):
    report = fuzzer.run(reader, 80)
    assert report.defects == []
    assert report.outcomes.total() == 80


def test_a_good_reader_has_no_defect(fuzzer):
    report = fuzzer.run("planted_good", 50)
    assert report.defects == []
    assert report.outcomes["read"] > 0
    assert report.outcomes["refused"] > 0


def test_the_same_seed_gives_the_same_mutants(fuzzer):
    first, again, other = (fuzzer.run("planted_good", 50, seed=seed).outcomes for seed in (1, 1, 2))
    assert first == again
    assert first != other


@pytest.mark.slow
@pytest.mark.parametrize(
    ("reader", "found"),
    [
        ("planted_raises", "KeyError: 'a.txt'"),
        ("planted_slow", "took 0."),
        ("planted_large", "and 0.3 GB"),
        ("planted_warns", "RuntimeWarning: overflow"),
        ("planted_nameless", "not one line with the name: cannot be read"),
        # Last, as the others go on with the process.
        ("planted_dies", "hung or died (status -6)"),
    ],
)
def test_planted_defects_are_found(fuzzer, reader, found):
    report = fuzzer.run(reader, 2, limits=Limits(seconds=0.2, memory=200 << 20))
    assert found in dict(report.defects)[0]
    assert report.outcomes.total() == 2


@pytest.mark.slow
def test_a_reader_that_hangs_is_found():
    with Fuzzer(hangs=15.0) as own:
        report = own.run("planted_hangs", 1)
    assert report.defects == [(0, "the process hung or died (status -9)")]
