"""Grey PNG files, read and written without other packages (PNG specification, third edition)."""

import struct
import zlib


def read_png(path):
    """Rows of a grey PNG, of 8 or 16 bits."""
    with open(path, "rb") as file:
        data = file.read()
    at, body = 8, b""
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        part = data[at + 8:at + 8 + size]
        if kind == b"IHDR":
            width, height, bits = struct.unpack(">IIB", part[:9])
        elif kind == b"IDAT":
            body += part
        at += size + 12
    step = bits // 8
    body, stride, rows, before = zlib.decompress(body), width * step, [], bytearray(width * step)
    for v in range(height):
        method, row = body[v * (stride + 1)], bytearray(body[v * (stride + 1) + 1:(v + 1) * (stride + 1)])
        for i in range(stride if method else 0):
            a, b = row[i - step] if i >= step else 0, before[i]
            c = before[i - step] if i >= step else 0
            if method == 4:
                p = a + b - c
                best = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            else:
                best = (0, a, b, (a + b) // 2)[method]
            row[i] = (row[i] + best) & 255
        rows.append(row if step == 1 else struct.unpack(f">{width}H", row))
        before = row
    return rows


def write_png(path, rows):
    """Rows of a 16-bit grey PNG."""
    def part(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    body = b"".join(b"\0" + struct.pack(f">{len(row)}H", *row) for row in rows)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + part(b"IHDR", struct.pack(">IIBBBBB", len(rows[0]), len(rows), 16, 0, 0, 0, 0))
                   + part(b"IDAT", zlib.compress(body)) + part(b"IEND", b""))
