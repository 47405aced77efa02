import numpy as np

from gmmjax.scenes import family_scene


def test_things_are_turned_or_shifted_within_their_places():
    shifts, angles = [], []
    for seed in range(6):
        scene = family_scene("small_motions", seed)
        assert set(scene.kinds) <= {"moved"}
        for number, motion in scene.motions.items():
            own = scene.registration @ motion
            middle = scene.clouds.before[scene.truth.before == number].mean(axis=0)
            shifts.append(np.linalg.norm(own[:3, :3] @ middle + own[:3, 3] - middle) / scene.unit)
            angles.append(np.degrees(np.arccos(np.clip((np.trace(own[:3, :3]) - 1) / 2, -1, 1))))
    assert len(shifts) >= 3
    # The middle of what was seen of a chair is not that of its rotation.
    assert np.nanmax(shifts) < 0.35 and max(angles) < 61
    assert all(shift > 0.015 or angle > 4.9 for shift, angle in zip(shifts, angles, strict=True))
