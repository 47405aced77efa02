from gmmjax.evaluation import PairSource
from gmmjax.thesis.chapter4 import Plan, Table
from gmmjax.thesis.chapter4.records import LastPair
from tests.evaluation.scenes import box_pair


def test_a_quick_plan_does_less_of_everything():
    whole, quick = Plan(7), Plan.quick(7)
    assert list(whole.seeds(3)) == [7, 8, 9]
    assert quick.first_seed == 7
    for name in ("clustering_seeds", "trials", "survey_seeds", "filtering_seeds"):
        assert 0 < getattr(quick, name) < getattr(whole, name)


def test_a_table_as_comma_separated_values():
    table = Table(
        "4.9", "t", ({"method": "joint", "f1": 0.5, "pairs": 2}, {"method": "a, b", "f1": None, "pairs": None})
    )
    assert table.file_name == "figure-4.9.csv"
    assert table.to_csv() == 'method,f1,pairs\njoint,0.5,2\n"a, b",,\n'


def test_pairs_are_loaded_once_in_a_row():
    loads = []

    def source(name):
        return PairSource(name, "g", "c", lambda: loads.append(name) or box_pair(name=name))

    load, first, second = LastPair(), source("first"), source("second")
    assert load(first) is load(first)
    assert [load(own).name for own in (second, second, first)] == ["second", "second", "first"]
    assert loads == ["first", "second", "first"]
