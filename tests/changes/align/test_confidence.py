import numpy as np
import pytest

from gmmjax.changes.align.confidence import ConfidenceModel
from gmmjax.changes.align.surface_fit import SurfaceFit


def test_confidence_falls_with_everything_that_speaks_against_a_transform():
    model, good = ConfidenceModel(), SurfaceFit(score=0.8, overlap=0.9, residual=0.001, noise=0.001)
    sure = model.of_surfaces(good, 0.5, False)
    assert sure > 0.99
    assert model.of_surfaces(good._replace(residual=0.01), 0.9, True) < 0.5
    assert model.of_surfaces(good._replace(overlap=0.1), 0.5, True) < 0.5
    assert model.of_surfaces(good, 1.0, False) == pytest.approx(0.5, abs=0.01)
    # Along a plane any transform fits as well as the frame that the clouds were given in.
    assert model.of_surfaces(good, 1.0, True) > 0.95
    assert model.of_surfaces(SurfaceFit(0.0, 0.0, float("inf"), float("inf")), 0.0, True) == 0


def test_a_transform_that_loses_what_agreed_is_contradicted():
    model = ConfidenceModel()
    given = SurfaceFit(0.6, 1.0, 0.1, 0.1, significance=np.repeat([1.0, 6.0], [60, 40]))
    other = given._replace(significance=np.repeat([6.0, 1.0, 6.0], [20, 60, 20]))
    nearly_all = given._replace(significance=np.repeat([6.0, 1.0], [1, 99]))
    assert other.agreement == pytest.approx(0.6)
    assert other.contradiction(given) == pytest.approx(20.5 / 20.5)
    assert model.doubt(other, given) > 1 > model.doubt(nearly_all, given)
    assert model.of_surfaces(other, 0.0, False, model.doubt(other, given)) < 0.1
    stated = model.of_surfaces(given, 0.0, True, 1.0, model.stated)
    assert stated > 0.95 > 0.6 > model.of_surfaces(given, 0.0, True, 1.0)
