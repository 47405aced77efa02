import dataclasses

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.colors import to_hex

from gmmjax import InputError, PointCloud
from gmmjax.plotting import DIRECTIONS, plot_changes, plot_distance, plot_overview
from gmmjax.reporting.palette import KIND_COLORS, color_bytes

SMALL = 120


def texts(ax):
    return [text.get_text() for text in ax.texts]


def pixels_of(image, color):
    """The places, in the unit of the axes, of the pixels of a colour."""
    picture = np.asarray(image.get_array())
    rows, columns = np.nonzero((picture[..., :3] == color_bytes(color)).all(axis=2) & (picture[..., 3] > 0))
    left, right, lower, upper = image.get_extent()
    height, width = picture.shape[:2]
    return np.c_[left + (columns + 0.5) / width * (right - left), upper - (rows + 0.5) / height * (upper - lower)]


def test_changed_points_are_where_they_are_in_the_colour_of_their_kind(changes):
    ax = plot_changes(changes, pixels=SMALL)
    marked = ax.images[1]
    for kind, corner in (("disappeared", [1, 1]), ("appeared", [3, 2])):
        places = pixels_of(marked, KIND_COLORS[kind])
        assert len(places) > 20
        # Of points in [corner, corner + 0.4]; a square reaches three pixels of 4 m / 120 beyond.
        assert (places > np.array(corner) - 0.12).all() and (places < np.array(corner) + 0.52).all()


def test_equal_axes_have_their_names_and_unit(changes):
    names = {direction: plot_changes(changes, direction=direction, pixels=SMALL) for direction in DIRECTIONS}
    labels = {direction: (ax.get_xlabel(), ax.get_ylabel()) for direction, ax in names.items()}
    assert labels["above"] == ("x (m)", "y (m)")
    assert labels["front"] == ("x (m)", "z (m)")
    assert labels["side"] == ("y (m)", "z (m)")
    assert all(ax.get_aspect() == 1 for ax in names.values())
    # The oblique view is along no axis, and has a scale.
    assert labels["oblique"] == ("", "") and "1 m" in texts(names["oblique"])


def test_a_plot_without_a_unit_names_none(changes):
    ax = plot_changes(dataclasses.replace(changes, unit=None), pixels=SMALL)
    assert ax.get_xlabel() == "x"


def test_a_cloud_is_shown_with_its_own_changes(changes):
    kinds = {}
    for show in ("before", "after", "changes"):
        ax = plot_changes(changes, show=show, pixels=SMALL)
        kinds[show] = [text.get_text() for text in ax.get_legend().get_texts()], texts(ax)
    assert kinds["before"] == (["disappeared", "unchanged"], ["0"])
    assert kinds["after"] == (["appeared", "unchanged"], ["1"])
    assert kinds["changes"] == (["appeared", "disappeared", "unchanged"], ["0", "1"])


def test_an_arrow_goes_from_where_an_object_was_to_where_it_is(changes):
    items = tuple(dataclasses.replace(item, kind="moved", partner=1 - label) for label, item in enumerate(changes))
    ax = plot_changes(dataclasses.replace(changes, items=items), pixels=SMALL)
    (arrow,) = (text for text in ax.texts if text.get_text() == "")
    np.testing.assert_allclose([arrow.xyann, arrow.xy], [item.box.centre[:2] for item in changes])


def test_what_is_drawn_goes_into_the_axes_that_are_given(changes):
    figure, given = pyplot.subplots()
    assert plot_changes(changes, ax=given, legend=False, pixels=SMALL) is given
    assert given.get_legend() is None and pyplot.get_fignums() == [figure.number]


def test_forgotten_clouds_are_asked_for_and_taken(changes, forgetful):
    with pytest.raises(InputError, match=r"before: the changes do not know their clouds.*give before and after"):
        plot_changes(forgetful)
    assert plot_changes(forgetful, *changes.clouds, pixels=SMALL).images
    with pytest.raises(InputError, match=r"after: has 5 points, the changes have labels for 1,000"):
        plot_changes(forgetful, changes.clouds.before, np.zeros((5, 3)))


def test_arrays_with_rows_without_a_position_keep_their_labels(changes):
    """Labels are for all rows of an array; the rows that are drawn are those with a position."""
    rows = changes.clouds.before.points.copy()
    rows[950:] = np.nan
    ax = plot_changes(changes, rows, changes.clouds.after.points, show="before", pixels=SMALL)
    assert texts(ax) == ["0"]
    assert len(pixels_of(ax.images[1], KIND_COLORS["disappeared"])) > 10


@pytest.mark.usefixtures("as_users")
def test_unknown_words_are_refused(changes):
    with pytest.raises(InputError, match="direction='below' is unknown; choose from oblique, above, front, side"):
        plot_changes(changes, direction="below")
    with pytest.raises(InputError, match="show='all' is unknown"):
        plot_changes(changes, show="all")


def test_overview_says_what_it_shows(changes):
    axes = plot_overview(changes, pixels=SMALL)
    figure = axes[0, 0].figure
    assert axes.shape == (2, 2)
    assert [ax.get_title() for ax in axes.flat] == [
        *("Before: 1,000 points", "After: 1,000 points", "Changes from above", "Changes from the side")
    ]
    assert figure.get_suptitle() == "2 changes: 1 appeared, 1 disappeared\nfirst.ply → the after cloud"
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["appeared", "disappeared", "unchanged"]
    assert "moved by 50 cm" in legend.get_title().get_text()


def test_overview_leaves_the_figure_of_given_axes_alone(changes):
    figure, axes = pyplot.subplots(1, 4)
    found = plot_overview(changes, axes=axes, pixels=SMALL)
    assert list(found.flat) == list(axes) and figure.get_suptitle() == "" and not figure.legends
    with pytest.raises(InputError, match="axes: must be four axes, not 2"):
        plot_overview(changes, axes=axes[:2])


def test_no_change_is_drawn_too(changes):
    nothing = dataclasses.replace(changes, items=(), labels_before=np.full(1000, -1), labels_after=np.full(1000, -1))
    axes = plot_overview(nothing, pixels=SMALL)
    assert axes[0, 0].figure.get_suptitle().startswith("No change found")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a $x^2_1$ b.ply", "_hidden<b>&.ply", "c:\\frac{1}{2}.ply", "前 пре.ply"])
@pytest.mark.filterwarnings("ignore:Glyph .* missing from:UserWarning")
def test_names_are_text(changes, name):
    before = PointCloud.from_rows(changes.clouds.before.points, source=f"/scans/{name}")
    figure = plot_overview(changes, before=before, pixels=SMALL)[0, 0].figure
    assert name in figure.get_suptitle() and not figure._suptitle.get_parse_math()
    figure.canvas.draw()


def test_long_names_are_shortened(changes):
    before = PointCloud.from_rows(changes.clouds.before.points, source="x" * 300 + ".ply")
    title = plot_overview(changes, before=before, pixels=SMALL)[0, 0].figure.get_suptitle()
    assert max(map(len, title.splitlines())) < 100 and "x…x" in title


def test_survey_coordinates_keep_their_digits(changes):
    """A projection of coordinates of millions of metres is as sharp as one near the origin."""
    far = np.array([5e5, 5.4e6, 100.0])
    items = tuple(
        dataclasses.replace(item, box=dataclasses.replace(item.box, centre=item.box.centre + far)) for item in changes
    )
    moved = dataclasses.replace(changes, items=items, registration=dataclasses.replace(changes.registration))
    before, after = (cloud.points + far for cloud in changes.clouds)
    near, away = (plot_changes(*given, pixels=SMALL) for given in ((changes,), (moved, before, after)))
    difference = np.array(away.images[1].get_extent()) - np.array(near.images[1].get_extent())
    np.testing.assert_allclose(difference, [far[0]] * 2 + [far[1]] * 2, atol=1e-6)


def test_signed_distance_is_coloured(changes):
    ax = plot_distance(changes, limit=0.02, pixels=SMALL)
    bar = ax.figure.axes[1]
    assert bar.get_ylabel() == "signed distance (m)" and bar.get_ylim() == (-0.02, 0.02)
    picture = np.asarray(ax.images[0].get_array())
    colors = picture[picture[..., 3] > 0][:, :3].astype(int)
    assert (colors[:, 0] > colors[:, 2] + 40).any() and (colors[:, 2] > colors[:, 0] + 40).any()
    with pytest.raises(InputError, match="have no signed distances"):
        plot_distance(dataclasses.replace(changes, distance_after=None))


def test_kinds_are_those_of_the_report(changes):
    handles = plot_changes(changes, pixels=SMALL).get_legend().get_patches()
    assert [to_hex(handle.get_facecolor()).upper() for handle in handles[:2]] == [
        KIND_COLORS["appeared"].upper(),
        KIND_COLORS["disappeared"].upper(),
    ]
