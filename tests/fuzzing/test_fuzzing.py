"""Two hundred mutants of each reader; `python -m tests.fuzzing` reads more."""

import pytest

from tests.fuzzing.campaign import Fuzzer
from tests.fuzzing.targets import all_targets


@pytest.fixture(scope="module")
def fuzzer():
    with Fuzzer() as running:
        yield running


@pytest.mark.parametrize("reader", all_targets())
def test_mutants_are_read_or_refused_in_one_line(fuzzer, reader):
    report = fuzzer.run(reader, 200)
    assert report.defects == []
    assert report.outcomes.total() == 200


@pytest.mark.parametrize(
    ("reader", "found"),
    [
        ("planted_raises", "UnicodeDecodeError"),
        ("planted_dies", "died (status -6)"),
        ("planted_slow", "took 5."),
        ("planted_large", "GB"),
        ("planted_hangs", "hung or died (status -9)"),
        ("planted_warns", "RuntimeWarning: overflow"),
        ("planted_nameless", "not one line with the name: cannot be read"),
    ],
)
def test_planted_defects_are_found(reader, found):
    with Fuzzer(hangs=20.0 if reader == "planted_hangs" else 60.0) as own:
        report = own.run(reader, 8 if reader in ("planted_raises", "planted_dies") else 1)
    assert report.defects
    assert all(found in detail for _, detail in report.defects)
    assert report.outcomes.total() == (8 if reader in ("planted_raises", "planted_dies") else 1)


def test_a_good_reader_has_no_defect(fuzzer):
    report = fuzzer.run("planted_good", 50)
    assert report.defects == []
    assert report.outcomes["read"] > 0
    assert report.outcomes["refused"] > 0


def test_the_same_seed_gives_the_same_mutants(fuzzer):
    first, again, other = (fuzzer.run("planted_good", 50, seed=seed).outcomes for seed in (1, 1, 2))
    assert first == again
    assert first != other
