import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.thesis.chapter4 import survey_pairs
from gmmjax.thesis.chapter4.survey_pairs import survey_sources
from gmmjax.thesis.laboratory import THINGS
from gmmjax.thesis.laboratory.room import ROOM


def test_seeds_go_round_the_runs_there_and_back():
    sources = survey_sources(range(1000, 1008), "localised")
    assert len({source.name.split(",")[0] for source in sources}) == 8
    for source in sources:
        appeared = source.name.startswith("run5 to")
        assert source.condition == ("appeared" if appeared else "disappeared")
        assert appeared or "to run5" in source.name
        assert source.group == "localised"


def test_a_pair_has_all_that_scores_need():
    sources = survey_sources([0, 4], "frame")
    for source in sources:
        pair = source.load()
        changed, other = (pair.after, pair.before) if source.condition == "appeared" else (pair.before, pair.after)
        assert (changed.truth >= 0).any() and (other.truth < 0).all()
        for cloud in (changed, other):
            assert cloud.views is not None and cloud.unseen is not None and cloud.things is not None
            assert len(cloud.points) == len(cloud.truth) == len(cloud.unseen) == len(cloud.things)
            unchanged = cloud.things[(cloud.truth < 0) & (cloud.things >= 0)]
            assert {THINGS[thing] for thing in np.unique(unchanged)} <= set(ROOM)
    assert {source.condition for source in sources} == {"appeared", "disappeared"}


def test_volumetric_maps_need_open3d(monkeypatch):
    def missing(purpose):
        raise InputError(f"{purpose} needs Open3D: pip install '.[open3d]'")

    monkeypatch.setattr(survey_pairs, "load_open3d", missing)
    with pytest.raises(InputError, match="simulating volumetric maps needs Open3D"):
        survey_sources([0], "volumetric")


def test_an_unknown_kind_is_named(as_users):
    with pytest.raises(InputError, match="kind='mesh' is unknown"):
        survey_sources([0], "mesh")
