# SPDX-License-Identifier: Apache-2.0
"""8-bit PNG images with only the standard library, and the part of a view where one render is worst."""
import base64
import struct
import zlib


class Picture:
    """8-bit RGB image: `rows` is a list of bytearrays of length 3 × width."""

    def __init__(self, width, rows):
        self.width, self.height, self.rows = width, len(rows), rows

    def crop(self, x, y, width, height):
        return Picture(width, [row[3 * x:3 * (x + width)] for row in self.rows[y:y + height]])

    def data_uri(self):
        raw = b"".join(b"\0" + bytes(row) for row in self.rows)
        header = struct.pack(">IIBBBBB", self.width, self.height, 8, 2, 0, 0, 0)
        chunks = b"".join(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
                          for kind, data in ((b"IHDR", header), (b"IDAT", zlib.compress(raw, 9)), (b"IEND", b"")))
        return "data:image/png;base64," + base64.b64encode(b"\x89PNG\r\n\x1a\n" + chunks).decode()


def unfilter(kind, row, above, step):
    """Reverses a PNG filter in place. `above` is the previous row, unfiltered; `step` the number of bytes per pixel."""
    if kind == 1:
        for i in range(step, len(row)):
            row[i] = (row[i] + row[i - step]) & 255
    elif kind == 2:
        for i in range(len(row)):
            row[i] = (row[i] + above[i]) & 255
    elif kind == 3:
        for i in range(len(row)):
            left = row[i - step] if i >= step else 0
            row[i] = (row[i] + (left + above[i]) // 2) & 255
    elif kind == 4:
        for i in range(len(row)):
            left, corner = (row[i - step], above[i - step]) if i >= step else (0, 0)
            up = above[i]
            estimate = left + up - corner
            a, b, c = abs(estimate - left), abs(estimate - up), abs(estimate - corner)
            row[i] = (row[i] + (left if a <= b and a <= c else up if b <= c else corner)) & 255
    elif kind != 0:
        raise ValueError(f"a row has filter {kind}")


def read(path):
    """Reads a file with 8 bits per channel, RGB, RGBA (drops alpha) or grey, not interlaced; otherwise ValueError."""
    data = path.read_bytes()
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        raise ValueError(f"{path}: not a PNG file")
    at, packed, header = 8, b"", None
    while at + 8 <= len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        if kind == b"IHDR":
            header = struct.unpack(">IIBBBBB", data[at + 8:at + 21])
        elif kind == b"IDAT":
            packed += data[at + 8:at + 8 + size]
        at += 12 + size
    if header is None or header[2] != 8 or header[3] not in (0, 2, 6) or header[6] != 0:
        raise ValueError(f"{path}: not an 8-bit RGB or grey picture")
    width, height, channels = header[0], header[1], {0: 1, 2: 3, 6: 4}[header[3]]
    try:
        raw = zlib.decompress(packed)
    except zlib.error as error:
        raise ValueError(f"{path}: {error}")
    stride = 1 + channels * width
    if len(raw) != stride * height:
        raise ValueError(f"{path}: damaged")
    rows, above = [], bytearray(channels * width)
    for y in range(height):
        row = bytearray(raw[y * stride + 1:(y + 1) * stride])
        unfilter(raw[y * stride], row, above, channels)
        rows.append(row)
        above = row
    if channels != 3:
        for y, row in enumerate(rows):
            rows[y] = bytearray(3 * width)
            for c in range(3):
                rows[y][c::3] = row[c::4] if channels == 4 else row
    return Picture(width, rows)


def worst_window(truth, reference, render, width, height):
    """Corner (x, y) of the window in which the squared error of `render` exceeds that of `reference` the most.
    Windows are tried in steps of half their size."""
    step_x, step_y = max(1, width // 2), max(1, height // 2)
    best, corner = None, (0, 0)
    for y in range(0, max(1, truth.height - height + 1), step_y):
        for x in range(0, max(1, truth.width - width + 1), step_x):
            excess = 0
            for t, a, b in zip(truth.rows[y:y + height:2], reference.rows[y:y + height:2], render.rows[y:y + height:2]):
                part = slice(3 * x, 3 * (x + width), 2)
                excess += sum((v - s) ** 2 - (u - s) ** 2 for s, u, v in zip(t[part], a[part], b[part]))
            if best is None or excess > best:
                best, corner = excess, (x, y)
    return corner
