import pytest

from gmmjax.reporting.quantities import (
    area_text,
    degrees_text,
    length_text,
    metric_text,
    number_text,
    volume_text,
)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.1, "0.10"),
        (0.0996, "0.10"),
        (0.00423, "0.0042"),
        (0.996, "1.00"),
        (1.234, "1.23"),
        (-12.34, "-12.3"),
        (12_345.0, "12,300"),
        (3e-9, "3.00e-09"),
    ],
)
def test_numbers_have_the_digits_that_matter(value, text):
    assert number_text(value) == text


def test_lengths_are_in_the_unit_of_the_clouds():
    assert length_text(0.1, "m") == "0.10 m"
    assert length_text(120.0, "mm") == "120 mm"
    assert length_text(0.1, None) == "0.10"


@pytest.mark.parametrize(
    ("values", "unit", "text"),
    [
        ((0.3,), "m", "30 cm"),
        ((0.0033, 0.0013), "m", "3.3 to 1.3 mm"),
        ((0.03, 0.0042), "m", "3 to 0.42 cm"),
        ((0.14, 0.0013), "m", "14 cm to 1.3 mm"),
        ((12.0,), "m", "12 m"),
        ((0.0,), "m", "0 mm"),
        ((0.3,), "ft", "0.3 ft"),
        ((3.3, 1.3), None, "3.3 to 1.3"),
    ],
)
def test_metres_are_shown_in_a_readable_unit(values, unit, text):
    assert metric_text(values, unit) == text


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.35, "m", "0.35 m³"),
        (0.00035, "m", "350 cm³"),
        (1200.0, "mm", "1,200 mm³"),
        (0.2, None, "0.20"),
    ],
)
def test_volumes_have_their_unit(value, unit, text):
    assert volume_text(value, unit) == text


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (17.29, 0.43, "17.3 ± 0.4 m³"),
        (12.0, 1.23, "12.0 ± 1.2 m³"),
        (0.0004, 0.00003, "400 ± 30 cm³"),
        (1_234_567.0, 23_456.0, "1,230,000 ± 20,000 m³"),
        (-90.1, 3.2, "−90 ± 3 m³"),
        (0.3, 0.0, "0.30 m³"),
        (5.7e9, 4e7, "5.7e+09 ± 4e+07 m³"),
    ],
)
def test_a_volume_has_the_digits_that_its_error_leaves(value, error, text):
    assert volume_text(value, "m", error) == text


def test_areas_have_their_unit():
    assert [area_text(area, "m") for area in (12.34, 0.0035)] == ["12.3 m²", "35.0 cm²"]
    assert area_text(0.2, None) == "0.20"


def test_angles_have_a_decimal_below_ten():
    assert [degrees_text(angle) for angle in (0.0, 0.41, 6.0, 34.6)] == ["0°", "0.4°", "6°", "35°"]
