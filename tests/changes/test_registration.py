import json

import numpy as np

from gmmjax.changes.registration import Registration
from tests.changes.align.test_alignment import registered, room


def test_the_record_survives_json():
    result = registered(room(2), room(3) + 0.02)
    again = Registration.from_dict(json.loads(json.dumps(result.to_dict(), allow_nan=False)))
    np.testing.assert_array_equal(again.transform, result.transform)
    assert again.to_dict() == result.to_dict()
    assert Registration.none().to_dict()["residual"] is None


def test_points_are_taken_into_the_frame_of_the_before_cloud():
    result = registered(room(2), room(3) + 0.02)
    np.testing.assert_allclose(result.apply(np.ones((1, 3))), (result.transform @ [1, 1, 1, 1])[None, :3])
    assert Registration.none().apply(points := np.ones((2, 3))) is points
