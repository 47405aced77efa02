import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gmmjax.errors import InputError
from gmmjax.surveys import Trajectory, TransformTree, pose_matrix
from gmmjax.surveys.transforms import Edge


def random_poses(count, seed):
    random = np.random.default_rng(seed)
    rotations = Rotation.random(count, random_state=seed).as_quat()
    return np.stack([pose_matrix(random.normal(size=3), rotation) for rotation in rotations])


def moving(times, seed=0):
    return Edge(Trajectory(np.asarray(times, float), random_poses(len(times), seed)), fixed=False)


def fixed(seed=1):
    return Edge(Trajectory(np.zeros(1), random_poses(1, seed)), fixed=True)


def tree():
    """A world in which a robot moves, with a camera and a lamp on it."""
    edges = {
        ("world", "odom"): moving(np.arange(0, 4.1, 0.4), seed=2),
        ("odom", "body"): moving(np.arange(1, 6.1, 0.1), seed=3),
        ("body", "camera"): fixed(4),
        ("body", "lamp"): fixed(5),
    }
    return TransformTree(edges)


def test_a_path_is_the_product_of_its_edges():
    edges = tree().edges
    found = tree().trajectory("world", "camera")
    world, body = edges["world", "odom"].motion, edges["odom", "body"].motion
    assert found.times.tolist() == [time for time in body.times if time <= world.times[-1]]
    for time, pose in zip(found.times, found.poses, strict=True):
        expected = world.at([time])[0][0] @ body.at([time])[0][0] @ edges["body", "camera"].pose
        np.testing.assert_allclose(pose, expected, atol=1e-12)


def test_the_way_up_is_the_inverse_of_the_way_down():
    down, up = tree().trajectory("world", "camera"), tree().trajectory("camera", "world")
    np.testing.assert_allclose(down.poses @ up.poses, np.tile(np.eye(4), (len(down), 1, 1)), atol=1e-9)


def test_a_fixed_path_leads_over_a_common_parent():
    edges = tree().edges
    expected = np.linalg.inv(edges["body", "camera"].pose) @ edges["body", "lamp"].pose
    np.testing.assert_allclose(tree().fixed_pose("camera", "lamp"), expected, atol=1e-12)


def test_the_root_and_what_is_connected():
    apart = TransformTree({**tree().edges, ("map", "table"): fixed()})
    assert apart.root_of("lamp") == "world"
    assert apart.connects("camera", "world")
    assert not apart.connects("camera", "table")
    assert not apart.connects("camera", "moon")


def test_a_circle_of_edges_has_an_end():
    circle = TransformTree({("a", "b"): fixed(1), ("b", "a"): fixed(2)})
    assert circle.root_of("a") == "b"
    assert circle.connects("a", "b")


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda: tree().trajectory("world", "moon"), "no frame 'moon'; the frames are: body, camera"),
        (lambda: tree().root_of("moon"), "no frame 'moon'"),
        (lambda: tree().trajectory("body", "lamp"), "does not move"),
        (lambda: tree().fixed_pose("world", "body"), "moves in 'world'"),
        (lambda: TransformTree({**tree().edges, ("a", "b"): fixed()}).trajectory("a", "body"), "no path .* a > b"),
        (
            lambda: TransformTree({("a", "b"): moving([0, 0.1]), ("b", "c"): moving([5, 5.1])}).trajectory("a", "c"),
            "share no time",
        ),
    ],
)
def test_what_is_not_there_is_an_input_error(act, words):
    with pytest.raises(InputError, match=words):
        act()
