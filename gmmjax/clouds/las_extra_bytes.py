"""The record of extra bytes (LAS 1.4): what the bytes of a point behind its format's own are."""

import struct
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from gmmjax.clouds.columns import free_name

EXTRA_BYTES_USER, EXTRA_BYTES_RECORD = b"LASF_Spec", 4
DESCRIPTOR = 192
NAME, NAME_LENGTH = 4, 32
DESCRIPTION, DESCRIPTION_LENGTH = 160, 32
# The numbers of the types 1 to 10; 11 to 20 are two of them, and 21 to 30 three. Type 0 is any bytes.
EXTRA_TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")
UNDOCUMENTED = "undocumented"
MOST_UNDOCUMENTED = 255


@dataclass(frozen=True)
class ExtraBytes:
    """The descriptors of the extra bytes of a point, as bytes.

    Attributes:
        descriptors: of 192 bytes each, in the order of the bytes in a point.
    """

    descriptors: tuple[bytes, ...]

    @classmethod
    def parse(cls, content: bytes, available: int) -> tuple["ExtraBytes", int]:
        """The descriptors in a record, as far as points have bytes for them.

        Args:
            content: of the record.
            available: bytes of a point behind those of its format.

        Returns:
            The descriptors, which describe all of these bytes; and the number of those that were left out, because the
            points have no bytes for them or they are damaged.
        """
        whole = [content[start : start + DESCRIPTOR] for start in range(0, len(content), DESCRIPTOR)]
        kept: list[bytes] = []
        for descriptor in whole:
            size = _size(descriptor)
            if size is None or size > available:
                break
            kept.append(descriptor)
            available -= size
        left_out = len(whole) - len(kept)
        while available:
            size = min(available, MOST_UNDOCUMENTED)
            kept.append(_descriptor(UNDOCUMENTED, "", 0, size))
            available -= size
        return cls(tuple(kept)), left_out

    @property
    def names(self) -> list[str]:
        """Of the dimensions, in their order; any byte is a letter."""
        return [one[NAME : NAME + NAME_LENGTH].split(b"\0")[0].decode("latin-1") for one in self.descriptors]

    def avoiding(self, reserved: Collection[str]) -> "ExtraBytes":
        """The same, where dimensions with one of these names have another one, `input_NAME`."""
        names = self.names
        renamed = []
        for name, descriptor in zip(names, self.descriptors, strict=True):
            new = free_name(name, {*reserved, *names}) if name in reserved else name
            renamed.append(_with_text(descriptor, NAME, NAME_LENGTH, new) if new != name else descriptor)
        return ExtraBytes(tuple(renamed))

    def with_dimensions(self, descriptions: Mapping[str, tuple[np.dtype, str]]) -> "ExtraBytes":
        """The same with more dimensions at the end.

        Args:
            descriptions: type of each by name, one of the `EXTRA_TYPES`, and what it is, in ASCII, at most 32 letters.
        """
        more = [
            _descriptor(name, text, EXTRA_TYPES.index(kind.str[1:]) + 1, 0)
            for name, (kind, text) in descriptions.items()
        ]
        return ExtraBytes((*self.descriptors, *more))

    def content(self) -> bytes:
        """Of the record."""
        return b"".join(self.descriptors)


def _size(descriptor: bytes) -> int | None:
    """Bytes of a dimension in a point; None where the descriptor is damaged."""
    if len(descriptor) < DESCRIPTOR or descriptor[2] > 3 * len(EXTRA_TYPES):
        return None
    kind, options = descriptor[2], descriptor[3]
    if kind == 0:
        return options
    numbers, index = divmod(kind - 1, len(EXTRA_TYPES))
    return (numbers + 1) * np.dtype(EXTRA_TYPES[index]).itemsize


def _descriptor(name: str, description: str, kind: int, options: int) -> bytes:
    empty = struct.pack("<HBB", 0, kind, options).ljust(DESCRIPTOR, b"\0")
    return _with_text(_with_text(empty, NAME, NAME_LENGTH, name), DESCRIPTION, DESCRIPTION_LENGTH, description)


def _with_text(descriptor: bytes, start: int, length: int, text: str) -> bytes:
    return descriptor[:start] + text.encode("latin-1")[:length].ljust(length, b"\0") + descriptor[start + length :]
