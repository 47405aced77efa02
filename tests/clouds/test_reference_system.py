"""What files state of their coordinates, as the programs write it that surveyors use."""

import struct

import pytest

from gmmjax.clouds.reference_system import epsg_code, is_geocentric_system, is_wkt, of_geotiff_keys, of_wkt, system_name

BASE = (
    'GEOGCS["NAD83",DATUM["North_American_Datum_1983",SPHEROID["GRS 1980",6378137,298.257]],PRIMEM["Greenwich",0],'
    'UNIT["degree",0.01745]]'
)
ALBERS = f'PROJCS["my albers",{BASE},PROJECTION["Albers_Conic_Equal_Area"],UNIT["metre",1]]'
BASE_2 = (
    'DATUM["WGS 84",ELLIPSOID["WGS 84",6378137,298.25,LENGTHUNIT["metre",1]]],'
    'PRIMEM["Greenwich",0,ANGLEUNIT["degree",0.0174]]'
)
DEGREES = 'CS[ellipsoidal,2],AXIS["lat",north],AXIS["lon",east],ANGLEUNIT["degree",0.0174532925199433]'
UTM_2 = (
    f'PROJCRS["UTM 32",BASEGEOGCRS["WGS 84",{BASE_2}],'
    'CONVERSION["UTM",METHOD["TM"],PARAMETER["k",0.9996,SCALEUNIT["unity",1]]],'
    'CS[Cartesian,2],AXIS["E",east],AXIS["N",north],LENGTHUNIT["metre",1]]'
)
HEIGHT = 'VERT_CS["NAVD88 (ftUS)",VERT_DATUM["x",2005],UNIT["US survey foot",0.304800609601219]]'


@pytest.mark.parametrize(
    ("text", "unit", "crs"),
    [
        (ALBERS, "m", ALBERS),
        (ALBERS.replace(",", " ,\n "), "m", ALBERS),
        (ALBERS.replace('["metre",1]]', '["metre",1],AUTHORITY["ESRI","102003"]]'), "m", ...),
        (ALBERS.replace('"metre",1]', '"US survey foot",0.304800609601219]'), "ftUS", ...),
        (f'COMPD_CS["both",{ALBERS},{HEIGHT},AUTHORITY["EPSG","7415"]]', None, ALBERS),
        (UTM_2, "m", UTM_2),
        (UTM_2[:-1] + ',ID["EPSG",32632]]', "m", "EPSG:32632"),
        (BASE, "degree", BASE),
        (BASE[:-1] + ',AUTHORITY["EPSG","4269"]]', "degree", "EPSG:4269"),
        (f'COMPD_CS["both",{BASE},{HEIGHT}]', "degree", BASE),
        (BASE.replace('"degree",0.01745', '"grad",0.015707963'), "angle", ...),
        (BASE.replace('"degree",0.01745', '"radian",1'), "angle", ...),
        (f'GEOGCRS["WGS 84",{BASE_2},{DEGREES},ID["EPSG",4326]]', "degree", "EPSG:4326"),
        (f'GEODCRS["WGS 84",{BASE_2},{DEGREES}]', "degree", ...),
        (
            f'GEOGCRS["WGS 84",{BASE_2},CS[ellipsoidal,3],AXIS["lat",north,ANGLEUNIT["degree",0.0174532925199433]],'
            'AXIS["h",up,LENGTHUNIT["metre",1]],ID["EPSG",4979]]',
            "degree",
            "EPSG:4979",
        ),
        (f'COMPOUNDCRS["both",GEOGCRS["WGS 84",{BASE_2},{DEGREES}],{HEIGHT}]', "degree", ...),
        (f'PROJCS["plate carree",{BASE},PROJECTION["x"],UNIT["Degree",0.0174532925199433]]', "degree", ...),
        (f'GEODCRS["WGS 84",{BASE_2},CS[Cartesian,3],AXIS["X",geocentricX],LENGTHUNIT["metre",1]]', "m", ...),
        ('GEOCCS["WGS 84",DATUM["x"],UNIT["metre",1],AUTHORITY["EPSG","4978"]]', "m", ...),
        ('LOCAL_CS["site",UNIT["foot",0.3048]]', "ft", None),
        ("", None, None),
        (ALBERS[:-1], None, None),
    ],
)
def test_well_known_text(text, unit, crs):
    found = of_wkt(text)
    assert found.unit == unit
    if crs is ...:
        assert found.crs is not None and is_wkt(found.crs) and found.crs in text
    else:
        assert found.crs == crs


GEOCENTRIC = 'GEOCCS["WGS 84",DATUM["x"],UNIT["metre",1],AUTHORITY["EPSG","4978"]]'


def test_a_system_from_the_centre_of_the_earth():
    cartesian = f'GEODCRS["WGS 84",{BASE_2},CS[Cartesian,3],AXIS["X",geocentricX],LENGTHUNIT["metre",1]]'
    for crs in (GEOCENTRIC, cartesian, f"BOUNDCRS[SOURCECRS[{cartesian}]]"):
        assert is_geocentric_system(crs)
    # What a projected system is based on, or shifted to, is no system of its points.
    shifted = f"BOUNDCRS[SOURCECRS[{UTM_2}],TARGETCRS[{cartesian}]]"
    for crs in (UTM_2, ALBERS, shifted, "EPSG:32632", "a site"):
        assert not is_geocentric_system(crs)


def keys(*entries):
    return struct.pack("<4H", 1, 1, 0, len(entries)) + b"".join(struct.pack("<4H", *entry) for entry in entries)


PROJECTED, GEOGRAPHIC, METRES = (1024, 0, 1, 1), (1024, 0, 1, 2), (3076, 0, 1, 9001)
NAMED = (3073, 34737, 6, 0)


@pytest.mark.parametrize(
    ("directory", "unit", "crs"),
    [
        (keys(PROJECTED, (3072, 0, 1, 25832), METRES), "m", "EPSG:25832"),
        (keys(PROJECTED, (2048, 0, 1, 4258), (3072, 0, 1, 25832), METRES), "m", "EPSG:25832"),
        (keys(PROJECTED, (3072, 0, 1, 32767), NAMED, METRES), "m", "UTM 7"),
        (keys(PROJECTED, (3072, 0, 1, 32767), METRES), "m", "a system of GeoTIFF parameters"),
        (keys(GEOGRAPHIC, (2048, 0, 1, 4326), (2054, 0, 1, 9102)), "degree", "EPSG:4326"),
        (keys((2048, 0, 1, 4326)), "degree", "EPSG:4326"),
        (keys(GEOGRAPHIC, (2048, 0, 1, 32767), (2054, 0, 1, 9105)), "angle", "a system of GeoTIFF parameters"),
        (keys((1024, 0, 1, 3), (2048, 0, 1, 4978)), None, "EPSG:4978"),
        (keys(METRES), "m", None),
        (keys(), None, None),
        (b"", None, None),
    ],
)
def test_geotiff_keys(directory, unit, crs):
    found = of_geotiff_keys(directory, b"UTM 7|")
    assert (found.unit, found.crs) == (unit, crs)


@pytest.mark.parametrize(
    ("found", "heights"),
    [
        (of_wkt(f'COMPD_CS["both",{ALBERS},{HEIGHT}]'), "ftUS"),
        (of_wkt(f'COMPD_CS["both",{ALBERS},{HEIGHT.replace("0.304800609601219", "1")}]'), None),
        (of_geotiff_keys(keys(PROJECTED, (3072, 0, 1, 25832), METRES, (4099, 0, 1, 9002))), "ft"),
        (of_geotiff_keys(keys(PROJECTED, (3072, 0, 1, 25832), METRES, (4099, 0, 1, 9001))), None),
    ],
)
def test_heights_in_another_unit_are_told(found, heights):
    assert found.heights == heights
    assert (found.unit is None) == (heights is not None)


def test_the_shift_of_a_datum_is_kept_with_the_system():
    shifted = f'BOUNDCRS[SOURCECRS[{UTM_2}],TARGETCRS[GEOGCRS["WGS 84",{BASE_2}]],ABRIDGEDTRANSFORMATION["shift"]]'
    assert of_wkt(shifted).crs == shifted and of_wkt(shifted).unit == "m" and is_wkt(shifted)
    assert of_wkt(f'COMPOUNDCRS["both",{shifted},{HEIGHT}]').crs == shifted


def test_wkt_in_a_name_of_geotiff_keys():
    """As ArcGIS writes systems without a code."""
    text = f"ESRI PE String = {ALBERS}|".encode()
    found = of_geotiff_keys(keys(PROJECTED, (3072, 0, 1, 32767), (3073, 34737, len(text), 0), METRES), text)
    assert (found.unit, found.crs) == ("m", ALBERS)


def test_names():
    assert [system_name(crs) for crs in ("EPSG:25832", ALBERS, "UTM (north)")] == [
        "EPSG:25832",
        "my albers",
        "UTM (north)",
    ]
    assert [epsg_code(crs) for crs in ("EPSG:25832", ALBERS, None)] == ["EPSG:25832", None, None]
