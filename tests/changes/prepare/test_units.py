import dataclasses
import struct

import numpy as np
import pytest

from gmmjax.changes import DetectionConfig, detect_changes
from gmmjax.changes.prepare.units import common_unit
from gmmjax.clouds import PointCloud, open_survey
from gmmjax.errors import InputError
from gmmjax.pair import Pair
from tests.clouds.las_files import GEOTIFF, las_bytes, vlr

POINTS = np.random.default_rng(0).normal(size=(300, 3))


def stated(before, after, **settings):
    clouds = Pair(*(dataclasses.replace(PointCloud.from_rows(POINTS), **own) for own in (before, after)))
    return common_unit(clouds, DetectionConfig(**settings))


def test_a_unit_that_both_files_state_is_used():
    assert stated({"unit": "m"}, {"unit": "m"}) == "m"
    assert stated({"unit": "m"}, {}) is None
    assert common_unit(Pair(POINTS, POINTS), DetectionConfig()) is None


def test_the_setting_wins():
    assert stated({"unit": "m"}, {"unit": "ft"}, unit="mm") == "mm"


def test_two_units_are_refused():
    with pytest.raises(InputError, match="before is in m and after in ftUS, as their files state; convert one"):
        stated({"unit": "m"}, {"unit": "ftUS"})


def test_only_where_a_unit_can_be_given_it_is_asked_for():
    clouds = Pair(*(dataclasses.replace(PointCloud.from_rows(POINTS), unit=unit) for unit in ("m", "ftUS")))
    with pytest.raises(InputError, match=r"give the unit of both .DetectionConfig.unit=.*, --unit"):
        common_unit(clouds, DetectionConfig())
    with pytest.raises(InputError, match=r"convert one of them$"):
        common_unit(clouds)


def test_two_reference_systems_are_refused():
    with pytest.raises(InputError, match=r"EPSG:25832 and after in EPSG:25833.*reproject one of them"):
        stated({"crs": "EPSG:25832"}, {"crs": "EPSG:25833"})


def test_surveys_in_their_files_are_looked_at_too(tmp_path):
    for name, keys in (("a", GEOTIFF), ("b", GEOTIFF.replace(struct.pack("<H", 25832), struct.pack("<H", 25833)))):
        (tmp_path / f"{name}.las").write_bytes(las_bytes(2, 3, vlrs=(vlr(b"LASF_Projection", 34735, keys),)))
    first, second = (open_survey([tmp_path / f"{name}.las"]) for name in "ab")
    assert common_unit(Pair(first, first), DetectionConfig()) == "m"
    with pytest.raises(InputError, match="reproject one of them"):
        common_unit(Pair(first, second), DetectionConfig())


@pytest.mark.parametrize("unit", ["", " m", "=1+1", "m\n", "a name of many letters", "\x1b[31m"])
def test_what_is_no_unit(unit):
    with pytest.raises(InputError, match=r"unit=.* must be a name"):
        DetectionConfig(unit=unit)


def test_the_record_has_the_unit():
    changes = detect_changes(POINTS, POINTS, config=DetectionConfig(unit="mm", restarts=1))
    assert changes.unit == "mm"
