import dataclasses

import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.changes import Registration
from gmmjax.plotting import plot_registration


def test_registered_surfaces_are_closer(changes):
    """The floor was tilted by a hundredth; registered it is at its noise, 2 mm."""
    tilt = np.eye(4)
    tilt[2, 0], tilt[0, 2] = 0.01, -0.01
    after = changes.clouds.after.points @ np.linalg.inv(tilt)[:3, :3].T
    registered = dataclasses.replace(changes, registration=Registration(tilt, True, 0.02, 0.002, 0.02, 0.9))
    ax = plot_registration(registered, after=after)
    given, moved = (text.get_text() for text in ax.get_legend().get_texts())
    assert given.startswith("as given, median 0.02") and moved.startswith("registered, median 0.00")
    assert [line.get_xdata()[0] for line in ax.lines] == [0.02, 0.002]
    assert ax.get_xlabel() == "distance from the surface of the before scan (m)"


def test_without_a_registration_there_is_one_histogram(changes):
    alone = dataclasses.replace(changes, registration=Registration.none())
    assert len(plot_registration(alone).get_legend().get_texts()) == 1


def test_a_cloud_that_changed_as_a_whole_is_refused(changes):
    everything = dataclasses.replace(changes, labels_after=np.ones(1000, int))
    with pytest.raises(InputError, match="every point of the after cloud changed"):
        plot_registration(everything)
