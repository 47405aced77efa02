import pytest
from hypothesis import given
from hypothesis import strategies as st

from gmmjax.clouds.pcd import expand_lzf

REPETITIVE = st.lists(st.sampled_from([b"a", b"ab", b"abc", b"\x00" * 300, b"xyzzy", bytes(range(256))])).map(b"".join)


@given(st.one_of(st.binary(max_size=2000), REPETITIVE))
def test_undoes_compression(lzf_compress, data):
    assert expand_lzf(lzf_compress(data), len(data)) == data


@pytest.mark.parametrize(
    ("compressed", "expanded"),
    [
        (b"\x02abc", b"abc"),
        (b"\x02abc\x20\x02", b"abcabc"),  # reference: length 3, distance 3
        (b"\x00a\xe0\x02\x00", b"a" * 12),  # long reference that overlaps what it writes
        (b"\x01ab\x60\x01", b"abababa"),  # overlap with a remainder: 5 bytes at distance 2
    ],
)
def test_tokens(compressed, expanded):
    assert expand_lzf(compressed, len(expanded)) == expanded


@pytest.mark.parametrize(
    ("compressed", "size"),
    [(b"\x05abc", 6), (b"\x20\x05", 3), (b"\x00a\xe0", 9), (b"\x02abc", 4), (b"", 1), (b"\x00a", 2**40)],
)
def test_damage_is_an_error(compressed, size):
    with pytest.raises(ValueError):
        expand_lzf(compressed, size)


@given(st.binary(max_size=300), st.integers(0, 1000))
def test_garbage_is_an_error_or_has_the_size_asked_for(data, size):
    try:
        assert len(expand_lzf(data, size)) == size
    except ValueError:
        pass
