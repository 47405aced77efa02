import numpy as np
import pytest

from gmmjax.clouds import SensorViews
from gmmjax.scenes import Beam
from gmmjax.scenes.families.flights import Flight


@pytest.mark.parametrize(("lines", "heading"), [(1, 0.0), (3, 0.0), (2, 0.8)])
def test_a_flight_sees_the_whole_area_beneath(lines, heading):
    flight = Flight(edge=80.0, altitude=300.0, lines=lines, overlap=0.2, heading=heading)
    scanner = flight.scanner(Beam(max_range=900.0), rays=20_000.0)
    views = SensorViews(flight.poses(), (scanner.across, scanner.along), 900.0)
    steps = np.linspace(-39.9, 39.9, 30)
    x, y = (axis.ravel() for axis in np.meshgrid(steps, steps))
    turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    places = np.column_stack([np.stack([x, y], axis=1) @ turn.T, np.zeros(len(x))])
    covered = [views.in_field_of_view(views.in_camera(places, view)) for view in range(len(views))]
    assert np.any(covered, axis=0).all()
    assert len(views) == 6 * lines


def test_the_rays_are_shared_by_all_scans():
    flight = Flight(edge=80.0, altitude=300.0, lines=2, overlap=0.2, heading=0.0)
    assert flight.scanner(Beam(), rays=24_000.0).rays == 2000
