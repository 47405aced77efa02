import dataclasses
import shutil
import struct

import laspy
import numpy as np
import pytest
from laspy.vlrs.known import WktCoordinateSystemVlr

from gmmjax.changes import DetectionConfig, detect_changes
from gmmjax.changes.prepare.units import common_unit, stated_systems
from gmmjax.cli import main
from gmmjax.clouds import PointCloud, open_survey, read_survey
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


def test_systems_without_a_code_may_be_equal():
    """Two programs describe one system in different words."""
    assert stated({"crs": 'PROJCS["a",UNIT["metre",1]]'}, {"crs": "EPSG:25833"}) is None
    assert stated({"crs": 'PROJCS["a",UNIT["metre",1]]'}, {"crs": 'PROJCS["b",UNIT["metre",1]]'}) is None


def in_degrees(longitude, latitude, unit="degree"):
    points = POINTS / 1e5 + [longitude, latitude, 50]
    return dataclasses.replace(PointCloud.from_rows(points, source="a <1>.las"), unit=unit, crs="EPSG:4326")


@pytest.mark.parametrize(
    ("longitude", "latitude", "code"),
    [(7.1, 51.2, 32632), (-74.0, 40.7, 32618), (151.2, -33.9, 32756), (179.9, 1.0, 32660), (-179.9, -1.0, 32701)],
)
@pytest.mark.parametrize("settings", [{}, {"unit": "m"}])
def test_degrees_are_refused_with_what_to_project_them_to(longitude, latitude, code, settings):
    clouds = Pair(POINTS, in_degrees(longitude, latitude))
    with pytest.raises(InputError, match=rf"after \(a <1>.las\): .*EPSG:4326.*in degrees.*out_srs=EPSG:{code} "):
        common_unit(clouds, DetectionConfig(**settings))


def test_other_angles_have_no_zone():
    with pytest.raises(InputError, match=r"x and y are angles, and .*out_srs=EPSG:CODE"):
        common_unit(Pair(in_degrees(2, 54, "angle"), POINTS), DetectionConfig())


def test_a_geographic_system_of_what_are_hardly_angles():
    """A file that states the wrong one: its coordinates are used where the user says what they are in."""
    wrong = dataclasses.replace(PointCloud.from_rows(POINTS * 20), unit="degree", crs="EPSG:4326")
    with pytest.raises(InputError, match=r"before: states .*hardly angles; correct .*--unit"):
        common_unit(Pair(wrong, wrong), DetectionConfig())
    assert common_unit(Pair(wrong, wrong), DetectionConfig(unit="m")) == "m"
    assert stated_systems(Pair(wrong, POINTS)) == Pair(None, None)


def test_a_survey_of_which_one_file_is_in_degrees(tmp_path):
    """The other one states nothing."""
    keys = struct.pack("<12H", 1, 1, 0, 2, 1024, 0, 1, 2, 2048, 0, 1, 4979)
    records = (vlr(b"LASF_Projection", 34735, keys),)
    data = las_bytes(2, 3, vlrs=records, scale=1e-8, offset=(7.0, 51.0, 0.0))
    (tmp_path / "b.las").write_bytes(data)
    (tmp_path / "a.las").write_bytes(las_bytes(2, 3, scale=1e-8, offset=(7.0, 51.0, 0.0)))
    paths = [tmp_path / "a.las", tmp_path / "b.las"]
    for survey in (open_survey(paths), read_survey(paths)):
        with pytest.raises(InputError, match=r"a.las, b.las.*EPSG:32632"):
            common_unit(Pair(survey, POINTS), DetectionConfig())


@pytest.mark.parametrize("command", ["detect", "tiles", "greedy", "fit"])
def test_the_commands_refuse_degrees(tmp_path, capsys, command):
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [1e-8, 1e-8, 1e-3], [7, -51, 0]
    wkt = 'GEOGCRS["GDA",DATUM["x"],CS[ellipsoidal,2],ANGLEUNIT["degree",0.0174532925199433]]'
    header.vlrs.append(WktCoordinateSystemVlr(wkt))
    header.global_encoding.wkt = True
    scan = laspy.LasData(header)
    scan.x, scan.y, scan.z = (POINTS / 1e5 + [7.5, -51.5, 20]).T
    scan.write(tmp_path / "scan 1.las")
    path, out = str(tmp_path / "scan 1.las"), str(tmp_path / "out")
    (tmp_path / "other").mkdir()
    other = shutil.copy(path, tmp_path / "other")
    options = {"detect": [], "tiles": ["--tile-size", "3"], "greedy": ["--method", "greedy"]}
    words = ["fit", path] if command == "fit" else ["detect", path, str(other), *options[command]]
    assert main([*words, "--out", out]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "scan 1.las" in said and "degrees" in said and "EPSG:32732" in said
    assert not (tmp_path / "out").exists()


def test_the_record_has_the_system_of_the_before_cloud():
    clouds = [dataclasses.replace(PointCloud.from_rows(POINTS), crs=crs) for crs in ("EPSG:25832", None)]
    assert detect_changes(*clouds, config=DetectionConfig(restarts=1)).crs == "EPSG:25832"
    assert detect_changes(*clouds[::-1], config=DetectionConfig(restarts=1)).crs is None


@pytest.mark.parametrize("unit", ["", " m", "=1+1", "m\n", "a name of many letters", "\x1b[31m"])
def test_what_is_no_unit(unit):
    with pytest.raises(InputError, match=r"unit=.* must be a name"):
        DetectionConfig(unit=unit)


def test_the_record_has_the_unit():
    changes = detect_changes(POINTS, POINTS, config=DetectionConfig(unit="mm", restarts=1))
    assert changes.unit == "mm"
