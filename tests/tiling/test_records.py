"""What was computed of blocks, written and read again."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays, boolean_dtypes, floating_dtypes, integer_dtypes

from gmmjax.tiling.records import BlockRecords, write_record

NUMBERS = boolean_dtypes() | integer_dtypes() | floating_dtypes()


def written(folder, *results):
    records = BlockRecords(folder)
    for number, result in enumerate(results):
        records.add(write_record(folder, number, result))
    return records


def assert_same(found, expected):
    assert found.keys() == expected.keys()
    for name, own in expected.items():
        assert (found[name].dtype, found[name].shape) == (own.dtype, own.shape)
        assert found[name].tobytes() == own.tobytes()


@settings(max_examples=30, deadline=None)
@given(values=st.lists(arrays(NUMBERS, array_shapes(min_dims=0, min_side=0)), max_size=4))
def test_what_is_read_is_what_was_written(tmp_path_factory, values):
    named = {f"array {number}": own for number, own in enumerate(values)}
    records = written(tmp_path_factory.mktemp("records"), {}, named)
    assert_same(records.values(0), {})
    assert_same(records.values(1), named)


def test_arrays_that_are_not_contiguous_and_text_are_kept(tmp_path):
    values = {
        "turned": np.arange(12.0).reshape(3, 4).T,
        "every other": np.arange(9)[::2],
        "text": np.array(["a", "bc"]),
    }
    assert_same(written(tmp_path, values).values(0), values)


def test_only_what_is_asked_for_is_read_in_the_order_that_it_is_asked_for(tmp_path):
    records = written(tmp_path, {"a": np.zeros(2), "b": np.ones(3), "c": np.zeros(1)})
    assert list(records.values(0, "c", "b")) == ["c", "b"]
    np.testing.assert_array_equal(records.values(0, "b")["b"], np.ones(3))


def test_what_a_dead_worker_wrote_is_not_read(tmp_path):
    records = written(tmp_path, {"a": np.zeros(2)})
    write_record(tmp_path, 1, {"a": np.ones(2)})
    records.add(write_record(tmp_path, 2, {"a": np.full(2, 2.0)}))
    assert records.numbers == [0, 2]
    np.testing.assert_array_equal(records.values(2)["a"], [2.0, 2.0])


def test_python_objects_are_refused(tmp_path):
    with pytest.raises(TypeError, match="a: Python objects"):
        write_record(tmp_path, 0, {"a": np.array([{}])})


def test_a_file_that_was_cut_off_is_an_error(tmp_path):
    records = written(tmp_path, {"a": np.zeros(100)})
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(ValueError, match="reshape"):
        records.values(0)
