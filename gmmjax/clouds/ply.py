"""Reading the vertices of PLY files."""

from pathlib import Path

import numpy as np

from gmmjax.clouds.columns import AXES, cast_column, cloud_of_columns, require_axes
from gmmjax.clouds.files import read_bytes
from gmmjax.clouds.number_table import NumberedLines, parse_table
from gmmjax.clouds.ply_header import PlyHeader, parse_header
from gmmjax.clouds.point_cloud import PointCloud
from gmmjax.clouds.records import RecordFile, require_records
from gmmjax.clouds.source_file import SourceFile

# Bytes of the longest header.
LONGEST_HEADER = 1 << 20


def open_ply(path: Path) -> RecordFile | PointCloud:
    """Open a PLY file: ascii or binary of either byte order, a cloud or a mesh.

    red, green and blue become colours, other scalar properties of the vertices become fields in their declared type;
    faces and other elements are passed over. Names are in upper or lower case.

    Args:
        path: the file.

    Returns:
        The file, with its header read; where it is ascii, its points in the order of the file.

    Raises:
        InputError: the file cannot be read, is no PLY, is cut off, or has no x, y, z.
    """
    source = SourceFile.of(path)
    with path.open("rb") as stream:
        header = parse_header(stream.read(LONGEST_HEADER), str(path))
    row_type, count = header.vertex.row_type, header.vertex.count
    require_axes(row_type.names or (), str(path))
    if header.encoding == "ascii":
        return cloud_of_columns(_ascii_columns(read_bytes(path), header, str(path)), str(path))
    offset = header.body + sum(element.count * element.row_type.itemsize for element in header.before)
    require_records(path, source.size - offset, row_type, count, "vertices")
    return RecordFile(path=path, source=source, count=count, offset=offset, row_type=row_type)


def _ascii_columns(data: bytes, header: PlyHeader, source: str) -> dict[str, np.ndarray]:
    row_type = header.vertex.row_type
    names = row_type.names or ()
    lines = NumberedLines(data[header.body :], first=header.lines + 1)
    before = sum(element.count for element in header.before if element.properties)
    table = parse_table(lines, len(names), source, count=header.vertex.count, what="vertices", skip=before)
    # Coordinates keep all the digits of the text, even where the header says float.
    return {
        name: column if name in AXES else cast_column(column, row_type[name], name, source)
        for name, column in zip(names, table.T, strict=True)
    }
