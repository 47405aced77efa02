"""LAS files of all versions and point formats, made byte by byte, and read back by nothing of gmmjax or laspy."""

import struct

import numpy as np

HEADER_SIZES = (227, 227, 227, 235, 375)
SIZES = (20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67)
# The first version of each point format.
FIRST_VERSION = (0, 0, 2, 2, 3, 3, 4, 4, 4, 4, 4)
VERSIONS_AND_FORMATS = [
    (minor, point_format) for minor in range(5) for point_format in range(11) if minor >= FIRST_VERSION[point_format]
]
WKT = (
    'PROJCS["ETRS89 / UTM zone 32N",GEOGCS["ETRS89",DATUM["x",SPHEROID["GRS 1980",6378137,298.257222101]],'
    'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
    'UNIT["metre",1],AUTHORITY["EPSG","25832"]]'
)
# Header, then key, location, count and value: a projected system, ETRS89 / UTM zone 32N, metres.
GEOTIFF = struct.pack("<16H", 1, 1, 0, 3, 1024, 0, 1, 1, 3072, 0, 1, 25832, 3076, 0, 1, 9001)
TYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")


def extra_descriptor(name: bytes, kind: int, options: int = 0, description: bytes = b"") -> bytes:
    return struct.pack("<HBB32s", 0, kind, options, name).ljust(160, b"\0") + description.ljust(32, b"\0")


def vlr(user: bytes, number: int, content: bytes) -> bytes:
    return struct.pack("<H16sHH32s", 0, user, number, len(content), b"made by hand") + content


def evlr(user: bytes, number: int, content: bytes) -> bytes:
    return struct.pack("<H16sHQ32s", 0, user, number, len(content), b"made by hand") + content


def las_bytes(
    minor: int,
    point_format: int,
    *,
    count: int = 30,
    extra: bytes = b"",
    extra_size: int = 0,
    vlrs: tuple[bytes, ...] = (),
    evlrs: tuple[bytes, ...] = (),
    scale: float = 0.001,
    offset: tuple[float, float, float] = (500_000.0, 5_400_000.0, 100.0),
    seed: int = 0,
) -> bytes:
    """A file whose points are random bytes but for X, Y and Z, with a gap before them as LAS 1.0 has it."""
    generator = np.random.default_rng(seed)
    size = SIZES[point_format] + extra_size
    rows = generator.integers(0, 256, (count, size), dtype=np.uint8)
    places = generator.integers(-20_000, 20_000, (count, 3)).astype("<i4")
    rows[:, :12] = places.view(np.uint8)
    rows[:, 14] = 0b0010_0001 if point_format >= 6 else 0b0001_0001
    records = [*vlrs, *([vlr(b"LASF_Spec", 4, extra)] if extra else [])]
    header_size = HEADER_SIZES[minor]
    start = header_size + sum(map(len, records)) + 2
    head = bytearray(header_size)
    internal = bool(evlrs) and minor == 3
    struct.pack_into("<4sHH", head, 0, b"LASF", 7, 2 * internal + 16 * (point_format >= 6))
    struct.pack_into("<16sBB32s32sHH", head, 8, b"project id of 16", 1, minor, b"some system", b"by hand", 33, 2024)
    struct.pack_into("<HIIBHI", head, 94, header_size, start, len(records), point_format, size, count)
    struct.pack_into("<5I", head, 111, count, 0, 0, 0, 0)
    struct.pack_into("<6d", head, 131, scale, scale, scale, *offset)
    low, high = (edge * scale + offset for edge in (places.min(axis=0), places.max(axis=0)))
    struct.pack_into("<6d", head, 179, *np.stack([high, low], axis=1).ravel())
    end = start + rows.size
    if internal:
        struct.pack_into("<Q", head, 227, end)
    if minor == 4:
        struct.pack_into("<QI16Q", head, 235, end if evlrs else 0, len(evlrs), count, count, *[0] * 14)
        if point_format >= 6:
            struct.pack_into("<6I", head, 107, *[0] * 6)
    return bytes(head) + b"".join(records) + b"\xdd\xcc" + rows.tobytes() + b"".join(evlrs)


def parsed(data: bytes) -> dict:
    """What an uncompressed file holds, after nothing but the specification."""
    header_size, start, number = struct.unpack_from("<HII", data, 94)
    point_format, length, count = struct.unpack_from("<BHI", data, 104)
    minor = data[25]
    if minor == 4:
        count = struct.unpack_from("<Q", data, 247)[0]
    records, place = [], header_size
    for _ in range(number):
        _, user, record, size, _ = struct.unpack_from("<H16sHH32s", data, place)
        records.append((user.rstrip(b"\0"), record, data[place + 54 : place + 54 + size]))
        place += 54 + size
    first, extended_count = struct.unpack_from("<QI", data, 235) if minor == 4 else (0, 0)
    if minor == 3 and data[6] & 2:
        first, extended_count = struct.unpack_from("<Q", data, 227)[0], 1
    extended = []
    for _ in range(extended_count):
        _, user, record, size, _ = struct.unpack_from("<H16sHQ32s", data, first)
        extended.append((user.rstrip(b"\0"), record, data[first + 60 : first + 60 + size]))
        first += 60 + size
    rows = np.frombuffer(data, np.uint8, count * length, start).reshape(count, length)
    scale = struct.unpack_from("<6d", data, 131)
    xyz = np.ascontiguousarray(rows[:, :12]).view("<i4")
    described = next((content for user, record, content in records if (user, record) == (b"LASF_Spec", 4)), b"")
    return {
        "head": data[:header_size],
        "minor": minor,
        "format": point_format,
        "records": records,
        "gap": data[place:start],
        "extended": extended,
        "rows": rows,
        "points": xyz * np.array(scale[:3]) + np.array(scale[3:]),
        "extra": _extra(described, rows[:, SIZES[point_format & 63] :]) if described else {},
    }


def _extra(content: bytes, rows: np.ndarray) -> dict[bytes, np.ndarray]:
    values, place = {}, 0
    for start in range(0, len(content), 192):
        kind, options, name = struct.unpack_from("<BB32s", content, start + 2)
        size = options if kind == 0 else np.dtype(TYPES[(kind - 1) % 10]).itemsize * ((kind - 1) // 10 + 1)
        own = np.ascontiguousarray(rows[:, place : place + size])
        numbers = own if kind == 0 else own.view("<" + TYPES[(kind - 1) % 10])
        values[name.rstrip(b"\0")] = numbers[:, 0] if numbers.shape[1] == 1 else numbers
        place += size
    assert place == rows.shape[1]
    return values
