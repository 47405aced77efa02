import numpy as np
from scipy.spatial.transform import Rotation

from gmmjax.geometry import Contact, UpwardSettings, upward_direction


def standing(direction, seed=0, count=40):
    """What stands on a surface with this normal, whose noise tilts the local planes."""
    random = np.random.default_rng(seed)
    normals = np.array(direction) + 0.05 * random.standard_normal((count, 3))
    senses = random.choice([-1, 1], (count, 1))
    return Contact(senses * normals / np.linalg.norm(normals, axis=1, keepdims=True), 0.2 * np.array(direction))


def test_upwards_is_from_the_surface_to_what_stands_on_it():
    for rotation in Rotation.random(5, random_state=0):
        direction = rotation.as_matrix()[:, 2]
        up = upward_direction([standing(direction, seed) for seed in range(3)])
        assert up @ direction > 0.99


def test_one_thing_on_a_wall_does_not_turn_it():
    up = upward_direction([*(standing((0, 0, 1.0), seed) for seed in range(3)), standing((1.0, 0, 0), 9)])
    assert up[2] > 0.99


def test_there_is_none_where_things_do_not_agree_or_touch_nothing():
    nothing = Contact(np.zeros((0, 3)), np.zeros(3))
    assert upward_direction([]) is None
    assert upward_direction([nothing, nothing]) is None
    assert upward_direction([standing((1.0, 0, 0)), standing((0, 1.0, 0)), standing((0, 0, 1.0))]) is None
    assert upward_direction([standing((1.0, 0, 0)), standing((0, 1.0, 0))], UpwardSettings(agreement=0.5)) is not None
