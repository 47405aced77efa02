import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gmmjax.changes.differences import Differences
from gmmjax.changes.evidence.examination import measured_candidates, observed_places
from gmmjax.changes.evidence.facts import FACTS, measured, names_of, sphere_directions
from gmmjax.changes.evidence.free_space import Observed
from gmmjax.changes.evidence.scan_visibility import ScanVisibility
from gmmjax.changes.evidence.surroundings import Areas
from gmmjax.changes.fit.restart_values import RestartValues
from gmmjax.clouds import SensorViews
from gmmjax.pair import Pair
from tests.changes.evidence.floors import (
    FROM_ABOVE,
    LIMITS,
    SPACING,
    candidates_of,
    cube,
    in_square,
    nothing_of,
    plane,
    surveys_of,
)

FLOOR, OTHER = plane((0, 0), (2, 2), 0.0), plane((0, 0), (2, 2), 0.0, 5)
CUBE = cube((1.0, 1.0), 0.4)
UPWARDS = np.array([0.0, 0.0, 1.0])
FROM_BELOW = SensorViews([[[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, -2], [0, 0, 0, 1]]], (53.0, 53.0), 3.0)


def scene(thing, own_floor, other, views=None, unit=1.0, rotation=np.eye(3), order=None, noise=None):
    """The facts of a thing on a floor that the other survey has without it, in any unit and frame."""
    points = np.concatenate([own_floor, thing])
    labels = np.repeat([-1, 0], [len(own_floor), len(thing)])
    order = np.arange(len(points)) if order is None else order
    points, labels = points[order], labels[order]
    limits = LIMITS._replace(
        **{
            name: unit * getattr(LIMITS, name)
            for name in ("spacing", "median_distance", "registration_error", "distance", "offset")
        }
    )
    pair = Pair(candidates_of(points, labels), nothing_of(other))
    if noise is not None:
        difference = pair.before.difference._replace(noise=np.full(len(points), noise))
        pair = Pair(pair.before._replace(difference=difference), pair.after)
    pair = pair.map(
        lambda own: own._replace(
            points=unit * own.points @ rotation.T,
            difference=own.difference._replace(
                **{name: unit * values for name, values in own.difference._asdict().items() if values is not None}
            ),
        )
    )
    surveys = surveys_of(pair, *([] if views is None else [views]))
    observed = observed_places(
        pair.map(lambda own: own.points), surveys, Differences(pair.map(lambda own: own.difference), limits)
    )
    pair = Pair(pair.before._replace(observed=observed.before), pair.after)
    pieces = measured_candidates(pair, surveys, limits).before
    largest = max(pieces, key=lambda piece: len(piece.rows))
    return measured(largest)


BARE = FLOOR[~in_square(FLOOR, (1, 1), 0.4)]


@pytest.fixture(scope="module")
def of_cube():
    return scene(CUBE, BARE, OTHER, FROM_ABOVE)


@pytest.fixture(scope="module")
def of_hole():
    """Floor that the other survey has not."""
    hole = in_square(FLOOR, (1, 1), 0.5)
    return scene(FLOOR[hole], FLOOR[~hole], OTHER[~in_square(OTHER, (1, 1), 0.5)])


def test_a_new_cube_on_a_floor_that_the_other_survey_saw_bare(of_cube):
    assert of_cube["seen_free"] > 0.9 and of_cube["seen_through"] > 0.9 and of_cube["depth_beyond"] > 1
    assert of_cube["unreached"] < 0.1
    assert of_cube["shown"] > 0.5
    assert of_cube["continued"] < 0.1
    assert of_cube["compactness"] > 0.5
    assert of_cube["count"] > 1000
    assert of_cube["of_cluster"] > 0.9


def test_a_floor_that_the_other_survey_did_not_see(of_hole):
    assert of_hole["continued"] > 0.9
    assert of_hole["shown"] < 0.2
    assert of_hole["compactness"] < 0.1
    assert "seen_free" not in of_hole


def test_eroded_ground_is_displaced_though_it_is_nearer_to_the_old_one_than_points_to_each_other():
    inside = in_square(FLOOR, (1, 1), 0.6)
    eroded = scene(FLOOR[inside] - SPACING / 2 * UPWARDS, FLOOR[~inside], OTHER)
    assert eroded["displaced"] > 0.95
    # The distance tells nothing there: it is that of a sure change, three spacings.
    assert 2.5 < eroded["gap"] <= 3


def test_ground_is_not_displaced_where_all_of_it_is_off_by_the_same():
    inside = in_square(FLOOR, (1, 1), 0.6)
    everything_off = scene(FLOOR[inside], FLOOR[~inside], OTHER + SPACING / 2 * UPWARDS)
    assert everything_off["displaced"] < 0.05


def test_ground_is_not_displaced_by_what_noise_explains():
    inside = in_square(FLOOR, (1, 1), 0.6)
    eroded = FLOOR[inside] - SPACING / 2 * UPWARDS
    assert scene(eroded, FLOOR[~inside], OTHER, noise=SPACING / 4)["displaced"] < 0.05


def test_what_has_nothing_opposite_or_lies_to_both_sides_is_not_displaced(of_hole):
    assert of_hole["displaced"] < 0.1
    inside = in_square(FLOOR, (1, 1), 0.6)
    sides = SPACING / 2 * np.random.default_rng(0).choice([-1, 1], inside.sum())
    rough = scene(FLOOR[inside] + sides[:, None] * UPWARDS, FLOOR[~inside], OTHER)
    assert rough["displaced"] < 0.6


@pytest.mark.parametrize(("own_views", "unreached"), [(FROM_BELOW, 1), (FROM_ABOVE, 0), (None, 0)])
def test_the_side_of_a_sheet_that_faces_away_from_the_other_survey_was_not_reached(own_views, unreached):
    """The other survey sees the same sheet, from above."""
    labels = np.where(in_square(FLOOR, (1, 1), 0.6), 0, -1)
    observed = np.full(len(FLOOR), Observed.surface, np.int8)
    pair = Pair(candidates_of(FLOOR, labels, observed), nothing_of(OTHER))
    surveys = Pair(ScanVisibility.of(FLOOR, own_views), ScanVisibility.of(OTHER, FROM_ABOVE))
    (piece,) = measured_candidates(pair, surveys, LIMITS).before
    assert measured(piece)["unreached"] == unreached


@pytest.mark.parametrize("both", [True, False])
def test_the_hidden_side_of_what_was_seen_through_is_known_by_it(both):
    """A block that reaches below the floor, where no survey from above sees; and its lower half without the upper."""
    upper, lower = CUBE, CUBE - [0, 0, 0.42]
    points = np.concatenate([BARE, lower, *([upper] if both else [])])
    labels = np.repeat([-1, 0, 1], [len(BARE), len(lower), len(points) - len(BARE) - len(lower)])
    observed = np.array([Observed.surface, Observed.unobserved, Observed.free], np.int8)[labels + 1]
    pair = Pair(candidates_of(points, labels, observed), nothing_of(OTHER))
    hidden, *_ = measured_candidates(pair, surveys_of(pair, FROM_ABOVE), LIMITS).before
    facts = measured(hidden)
    assert facts["not_seen"] == 1 and facts["seen_free"] == facts["cluster_free"] == 0
    assert facts["unreached"] > 0.9
    if both:
        assert 0.05 < facts["free_contact"] < 0.5 and facts["free_nearby"] > 0.3
    else:
        assert facts["free_contact"] == facts["free_nearby"] == 0


def pieces_of(points, labels, other, areas=None):
    pair = Pair(candidates_of(points, labels), nothing_of(other))
    return [measured(piece) for piece in measured_candidates(pair, surveys_of(pair), LIMITS, areas=areas).before]


def test_how_much_else_differs_is_told_by_area():
    small, large = cube((0.5, 0.5), 0.2), cube((1.4, 1.4), 0.4)
    points, labels = np.concatenate([FLOOR, small, large]), np.repeat([-1, 0, 1], [len(FLOOR), len(small), len(large)])
    of_small, of_large = sorted(pieces_of(points, labels, OTHER), key=lambda facts: facts["count"])
    differing = len(small) + len(large)
    assert of_small["differing_elsewhere"] == pytest.approx(len(large) / differing)
    assert of_large["differing_elsewhere"] == pytest.approx(len(small) / differing)
    overall = differing / len(points)
    assert of_small["differing_overall"] == of_large["differing_overall"] == pytest.approx(overall)
    # Of a part of a cloud the whole one counts, and a coarse point for as many fine ones as it stands for.
    parts = Areas.of(np.array([0, 0, -1]), np.array([1.0, 2.0, 2.0])), Areas.of(np.array([-1]), 1.0)
    assert parts[0] == (5.0, 9.0)
    only = np.where(labels == 1, 1, -1)
    (facts,) = pieces_of(points, only, OTHER, Pair(*parts))
    assert facts["differing_overall"] == pytest.approx(5 / 9)
    assert facts["differing_elsewhere"] == pytest.approx(1 - len(large) * SPACING**2 / 5)


@pytest.mark.parametrize("hides", [True, False])
def test_a_floor_is_not_beside_what_stands_on_it_but_a_shifted_box_is_beside_itself(hides):
    hole = in_square(FLOOR, (1, 1), 0.4)
    thing, later = (FLOOR[hole], CUBE) if hides else (CUBE, CUBE + np.array([2 * SPACING, 0, 0]))
    pair = Pair((FLOOR[~hole], thing), (OTHER[~in_square(OTHER, (1, 1), 0.4)], later)).map(
        lambda own: candidates_of(np.concatenate(own), np.repeat([-1, 0], [*map(len, own)]))
    )
    facts = measured(max(measured_candidates(pair, surveys_of(pair), LIMITS).before, key=lambda own: len(own.rows)))
    assert (facts["supports"] > 0.9) == hides
    assert facts["opposite_contact"] < 0.1 if hides else facts["opposite_contact"] > 0.9


def test_clutter_of_which_both_surveys_have_some_points_is_interspersed(of_cube):
    random = np.random.default_rng(0)
    clutter = [random.uniform(0.8, 1.2, (400, 3)) + np.array([0, 0, 0.2]) for _ in range(2)]
    points, labels = np.concatenate([FLOOR, clutter[0]]), np.repeat([-1, 0], [len(FLOOR), 400])
    (both,) = pieces_of(points, labels, np.concatenate([OTHER, clutter[1]]))
    (alone,) = pieces_of(points, labels, OTHER)
    assert 0.7 < both["interspersed"] < 1.3 and alone["interspersed"] == 0
    assert of_cube["interspersed"] < 0.3


def test_every_fact_is_finite_in_its_range_and_has_a_sentence(of_cube, of_hole):
    assert tuple(of_cube) == names_of(poses=True) and tuple(of_hole) == names_of(poses=False)
    for values in (of_cube, of_hole):
        for name, value in values.items():
            fact = FACTS[name]
            assert np.isfinite(fact.scaled(value)), name
            assert fact.scale != "share" or 0 <= value <= 1, name
            assert value >= (1 if fact.scale == "count" else 0), name
            assert "{" not in fact.in_words(value)


@pytest.mark.slow
@given(st.sampled_from([1.0, 1e-3, 1e3, 39.37]), st.integers(0, 2**31 - 1))
@settings(max_examples=5, deadline=None)
def test_facts_have_no_unit_and_no_frame(of_cube, unit, seed):
    rotation = Rotation.random(random_state=seed).as_matrix()
    poses = FROM_ABOVE.poses.copy()
    poses[:, :3, :3], poses[:, :3, 3] = rotation @ poses[:, :3, :3], unit * poses[:, :3, 3] @ rotation.T
    views = SensorViews(poses, FROM_ABOVE.field_of_view, unit * FROM_ABOVE.max_range)
    order = np.random.default_rng(seed).permutation(len(BARE) + len(CUBE))
    there = scene(CUBE, BARE, OTHER, views, unit, rotation, order)
    for name, value in of_cube.items():
        # Voxels, bins and directions lie otherwise; whether the top passes for a wall at the edge depends on them.
        tolerance = 0.3 if name == "at_edge" else 0.15
        assert FACTS[name].scaled(there[name]) == pytest.approx(FACTS[name].scaled(value), abs=tolerance), name


def test_directions_are_evenly_spread():
    directions = sphere_directions(200)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    np.testing.assert_allclose(directions.T @ directions / 200, np.eye(3) / 3, atol=0.01)


def test_a_fact_is_a_pure_function(of_cube):
    again = scene(CUBE, BARE, OTHER, FROM_ABOVE)
    assert again == of_cube


@pytest.mark.parametrize(
    ("posteriors", "excess", "agreement"),
    [
        ([0.7], 0.7, 1.0),
        ([0.9, 0.6], 0.75, 0.7),
        # The mean over all pairs: it does not grow with the number of restarts, as the range does.
        ([0.9, 0.6, 0.9, 0.6], 0.75, 0.8),
        ([0.2, 0.5, 0.5, 1.0], 0.55, 0.6),
    ],
)
def test_restarts_agree_as_nearly_as_two_of_them_do(posteriors, excess, agreement):
    points = np.concatenate([BARE, CUBE])
    candidates = candidates_of(points, np.repeat([-1, 0], [len(BARE), len(CUBE)]))
    by_restart = RestartValues(len(posteriors), lambda restart, rows: np.full(len(points), posteriors[restart])[rows])
    pair = Pair(candidates._replace(excess=by_restart), nothing_of(OTHER))
    (piece,) = measured_candidates(pair, surveys_of(pair), LIMITS).before
    facts = measured(piece)
    assert (facts["excess"], facts["agreement"]) == (pytest.approx(excess), pytest.approx(agreement))
