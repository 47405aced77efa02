import numpy as np
import pytest

from gmmjax.scenes import DepthCamera, Solid, TriangulatingCamera, looking_at

PIXELS = DepthCamera(columns=80, rows=60, flying=0.0, lost=0.0)
POSE = looking_at(np.array([0.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))


def wall(distance):
    return [Solid(np.array([0.0, distance + 0.5, 0.0]), np.array([9.0, 1.0, 9.0]))]


def depths(camera, distance, distortion=0.0, seed=0):
    """How far each point seems to be behind the wall, metres."""
    flat = np.zeros(80 * 60) + distortion
    points, _ = camera.frame(wall(distance), POSE, flat, np.random.default_rng(seed))
    return points[:, 1] - distance


@pytest.mark.parametrize("blur", [0.0, 1.0])
def test_noise_grows_with_the_square_of_the_range(blur):
    camera = TriangulatingCamera(PIXELS, noise=0.002, blur=blur, distortion=0.0)
    near, far = depths(camera, 1.0).std(), depths(camera, 2.0).std()
    assert near == pytest.approx(0.0022, rel=0.15)
    assert far / near == pytest.approx(4.0, rel=0.05)


def test_blurred_noise_is_alike_in_neighbouring_pixels():
    sharp, blurred = (depths(TriangulatingCamera(PIXELS, 0.002, blur, 0.0), 1.0).reshape(60, 80) for blur in (0.0, 1.0))
    alike = [np.corrcoef(image[:, 1:].ravel(), image[:, :-1].ravel())[0, 1] for image in (sharp, blurred)]
    assert abs(alike[0]) < 0.1 and alike[1] > 0.6


def test_the_distortion_differs_slowly_over_the_frame():
    camera = TriangulatingCamera(PIXELS, noise=0.0, blur=0.0, distortion=0.003)
    drawn = [camera.distortion_of(np.random.default_rng(seed)).reshape(60, 80) for seed in range(30)]
    assert np.sqrt(np.mean(np.square(drawn))) == pytest.approx(0.003, rel=0.3)
    assert np.abs(np.diff(drawn, axis=2)).max() < 0.1 * 0.003 * 5
    measured = depths(camera, 1.0, drawn[0].ravel())
    assert measured.std() > 0.3 * drawn[0].std()


def test_the_halves_of_a_frame_share_no_pixel():
    camera = TriangulatingCamera(PIXELS, noise=0.0, blur=0.0, distortion=0.0)
    even = np.arange(80 * 60) % 2 == 0
    halves = [
        camera.frame(wall(1.0), POSE, np.zeros(80 * 60), np.random.default_rng(0), pixels)[0]
        for pixels in (even, ~even)
    ]
    whole, _ = camera.frame(wall(1.0), POSE, np.zeros(80 * 60), np.random.default_rng(0))
    together = np.concatenate(halves)
    np.testing.assert_allclose(together[np.lexsort(together.T)], whole[np.lexsort(whole.T)])
