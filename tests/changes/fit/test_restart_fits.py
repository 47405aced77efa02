import numpy as np
import pytest

from gmmjax import InputError
from gmmjax.changes import RestartFits
from gmmjax.changes.fit.restart_fits import JOINT, SEPARATE

DTYPES = {"f": float, "b": bool, "i": np.int32}


def fits(layout=JOINT, restarts=3, slots=4, first=0):
    """Fits whose numbers tell the restart."""
    arrays = {}
    for name, (kind, shape) in layout.items():
        size = tuple({"k": slots, "3": 3}[axis] for axis in shape)
        numbers = np.arange(first, first + restarts).reshape(-1, *(1,) * len(size)) % 2
        arrays[name] = np.broadcast_to(numbers, (restarts, *size)).astype(DTYPES[kind])
    return RestartFits("joint" if layout is JOINT else "greedy", arrays)


@pytest.mark.parametrize("layout", [JOINT, SEPARATE])
def test_what_was_saved_is_read_in_every_bit(layout, tmp_path):
    written = fits(layout)
    written.save(tmp_path / "fits.npz")
    read = RestartFits.load(tmp_path / "fits.npz")
    assert read.method == written.method and len(read) == 3 and read.slots == 4
    for name, values in written.arrays.items():
        np.testing.assert_array_equal(read.arrays[name], values)
        assert read.arrays[name].dtype == values.dtype


def test_fits_are_followed_by_those_of_the_next_restarts():
    together = fits(restarts=2).followed_by(fits(restarts=3, first=2))
    assert len(together) == 5 and len(together.first(4)) == 4 and len(together.first(9)) == 5
    for name, values in fits(restarts=5).arrays.items():
        np.testing.assert_array_equal(together.arrays[name], values)
    nothing = RestartFits("joint", {})
    assert len(nothing) == 0 and len(nothing.followed_by(together)) == 5


def with_array(name, values):
    return {**fits().arrays, name: values}


def without_array(name):
    return {own: values for own, values in fits().arrays.items() if own != name}


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        (without_array("steps"), "has no array steps"),
        (without_array("share_after"), "has no array"),
        (with_array("steps", np.arange(2, dtype=np.int32)), r"steps is int32 \[2\], not whole numbers \[3\]"),
        (with_array("means", np.zeros((3, 4, 2))), r"means is float64 \[3, 4, 2\], not numbers \[3, 4, 3\]"),
        (with_array("live", np.ones((3, 4))), r"live is float64 \[3, 4\], not bools \[3, 4\]"),
        (with_array("weights", np.zeros(())), "weights is float64"),
        (with_array("weights", np.zeros((0, 4))), "weights is float64"),
        (with_array("result", np.array([0, 1, 7], np.int32)), "result is no status of a fit"),
        (with_array("message_length", np.array([0.0, np.nan, 1.0])), "message_length has numbers that are not finite"),
        (with_array("extra", np.zeros(3)), "has an unknown array extra"),
        ({}, "has no arrays"),
    ],
)
def test_a_file_that_holds_no_fits_is_named(arrays, message, tmp_path):
    file = tmp_path / "fits.npz"
    np.savez(file, method=np.array("joint"), **arrays)
    with pytest.raises(
        InputError, match=rf"fits\.npz: holds no fits of restarts \(.*{message}.*run the detection again"
    ):
        RestartFits.load(file)


def test_numbers_of_a_restart_without_a_mixture_may_be_anything(tmp_path):
    arrays = with_array("message_length", np.array([0.0, np.nan, 1.0]))
    arrays["result"] = np.array([0, 2, 1], np.int32)
    np.savez(tmp_path / "fits.npz", method=np.array("joint"), **arrays)
    assert len(RestartFits.load(tmp_path / "fits.npz")) == 3


@pytest.mark.parametrize("keep", [0, 10, 700])
def test_a_file_that_was_cut_off_is_named(keep, tmp_path):
    file = tmp_path / "fits.npz"
    fits().save(file)
    file.write_bytes(file.read_bytes()[:keep])
    with pytest.raises(InputError, match=r"fits\.npz"):
        RestartFits.load(file)


def test_pickles_and_other_methods_are_not_read(tmp_path):
    file = tmp_path / "fits.npz"
    np.savez(file, method=np.array("joint"), weights=np.array([object()]), allow_pickle=True)
    with pytest.raises(InputError, match=r"fits\.npz: is no NPZ file of numbers"):
        RestartFits.load(file)
    np.savez(file, method=np.arange(3), **fits().arrays)
    with pytest.raises(InputError, match=r"fits\.npz: holds no fits of restarts \(its method is"):
        RestartFits.load(file)
    with pytest.raises(InputError, match=r"missing\.npz"):
        RestartFits.load(tmp_path / "missing.npz")


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match=r"fits\.npz: cannot be written"):
        fits().save(tmp_path / "none" / "fits.npz")
