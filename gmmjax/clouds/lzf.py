"""LibLZF decompression (Lehmann, LibLZF 3.6), which PCD's binary_compressed data use."""

LONGEST_EXPANSION = 90
"""No three bytes of LZF stand for more than 264 bytes: data that claim more are damaged."""


def decompress(data: bytes, size: int) -> bytes:
    """Expand LZF data.

    A control byte below 32 starts a run of that many bytes plus one, copied as they are. Any other one refers back:
    its top three bits are the length (7: a further byte is added) less two, its other bits and the next byte the
    distance less one.

    Args:
        data: compressed bytes.
        size: how many bytes they stand for.

    Returns:
        The `size` bytes.

    Raises:
        ValueError: the data end early, refer back to before their start, or stand for another number of bytes.
    """
    if size > LONGEST_EXPANSION * len(data):
        raise ValueError(f"{len(data)} compressed bytes cannot stand for {size}")
    expanded = bytearray()
    position, end = 0, len(data)
    try:
        while position < end:
            control = data[position]
            position += 1
            if control < 32:
                expanded += data[position : position + control + 1]
                position += control + 1
                continue
            length = (control >> 5) + 2
            if length == 9:
                length += data[position]
                position += 1
            distance = ((control & 31) << 8) + data[position] + 1
            position += 1
            start = len(expanded) - distance
            if start < 0:
                raise ValueError("a reference goes back to before the start")
            if length <= distance:
                expanded += expanded[start : start + length]
            else:
                # The reference overlaps what it writes: the last `distance` bytes repeat.
                expanded += (expanded[start:] * (length // distance + 1))[:length]
    except IndexError:
        raise ValueError("the compressed data end early") from None
    if position > end or len(expanded) != size:
        raise ValueError(f"the data expand to {len(expanded)} bytes, not {size}")
    return bytes(expanded)
