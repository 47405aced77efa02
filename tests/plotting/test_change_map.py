"""The map from above as a picture."""

import dataclasses

import numpy as np
import pytest
from matplotlib import pyplot

from gmmjax import InputError
from gmmjax.pair import Pair
from gmmjax.plotting import check_map_file, map_figure, plot_map, write_map
from tests.reporting.test_map_cells import OFFSET, surveyed

SMALL = {"cell": 0.1, "pixels": 120}


def test_changes_are_coloured_outlined_and_numbered_in_their_place():
    changes, clouds = surveyed()
    ax = plot_map(changes, *clouds, **SMALL)
    assert [text.get_text() for text in ax.texts][-3:-1] == ["0", "1"]
    assert ax.texts[-1].get_text() == "2 m"
    colours = ax.images[-1]
    left, _, _, upper = colours.get_extent()
    picture = np.asarray(colours.get_array())

    def colour(x, y):
        return picture[int((upper - OFFSET[1] - y) / 0.1), int((OFFSET[0] + x - left) / 0.1)]

    # Red rose, blue sank, both opaque.
    assert colour(6.5, 4.5)[0] > 2 * colour(6.5, 4.5)[2] and colour(6.5, 4.5)[3] == 1
    assert colour(1.5, 1.5)[2] > 2 * colour(1.5, 1.5)[0] and colour(1.5, 1.5)[3] == 1
    assert colour(4.0, 3.0)[3] < 0.01
    # Coordinates of a survey are written out.
    ax.figure.canvas.draw()
    assert ax.xaxis.get_offset_text().get_text() == ""
    pyplot.close(ax.figure)


def test_the_figure_tells_what_was_found_and_names_are_text():
    changes, clouds = surveyed()
    clouds = Pair(*(dataclasses.replace(own, source=f"$x_1$ <b>{n}.las") for n, own in enumerate(clouds)))
    items = tuple(
        dataclasses.replace(item, volume=0.3, volume_error=0.01, gain_or_loss=effect)
        for item, effect in zip(changes, ("loss", "gain"), strict=True)
    )
    figure = map_figure(dataclasses.replace(changes, items=items), clouds, **SMALL)
    title = figure.axes[0].get_title()
    assert "2 changes: 1 appeared, 1 disappeared" in title and "$x_1$ <b>0.las → $x_1$ <b>1.las" in title
    assert "gained" in figure.get_supxlabel() and "lost" in figure.get_supxlabel()
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["appeared", "disappeared"]


def test_a_map_without_changes_is_drawn():
    changes, clouds = surveyed()
    nothing = dataclasses.replace(
        changes, items=(), labels_before=np.full(20_600, -1), labels_after=np.full(20_600, -1)
    )
    ax = plot_map(nothing, *clouds, **SMALL)
    assert [text.get_text() for text in ax.texts] == ["2 m"]


def test_the_ending_tells_what_is_written(tmp_path):
    pytest.importorskip("rasterio")
    changes, clouds = surveyed()
    write_map(tmp_path / "a.TIF", changes, clouds)
    assert (tmp_path / "a.TIF").read_bytes()[:2] in (b"II", b"MM")
    write_map(tmp_path / "a.png", changes, clouds)
    assert (tmp_path / "a.png").read_bytes()[1:4] == b"PNG"


def test_a_file_that_cannot_be_written_is_told_before_the_work(tmp_path):
    pytest.importorskip("rasterio")
    for name, message in (("no/x.tif", "missing"), ("x.docx", "no figures"), ("no/x.png", "missing")):
        with pytest.raises(InputError, match=message):
            check_map_file(tmp_path / name)
    (tmp_path / "x.tif").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        check_map_file(tmp_path / "x.tif")
