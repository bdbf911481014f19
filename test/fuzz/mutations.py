"""Changes to sound inputs, by what their formats are made of: records, chunks, arrays, rows, keys, and plain bytes."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import re
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from hypothesis import strategies as st

Draw = Callable[[st.SearchStrategy[Any]], Any]
Mutation = Callable[[bytes, Draw], bytes]

_MOST = 10 * 2**20  # bytes of an input
_MOST_VALUES = 2**20  # that are written anew
NUMBERS = [0, 1, 2, 7, 127, 128, 255, 65535, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63 - 1, 2**64 - 1]
VALUES: list[Any] = [
    None, True, 0, -1, 1, 10**6, 10**17, 1e-308, 1e308, float("nan"), float("inf"), -0.0, "", "x", "x" * 5000,
    "\x1b[31m\n", "2024-13-45", [], {}, [[]], [1, 2, 3], ["a"] * 50, {"a": {"b": [1]}}, [1e200] * 4,
]  # fmt: skip
SCALARS = ["!!int abc", "!!binary aaaa", "9" * 5000, "&a [*a]", "*nobody", "0x" + "f" * 300, "1e999", "- - -", "{", "%"]
TOKENS = ["0", "-1", "1e308", "nan", "inf", "9" * 5000, "", "x", "\x1b[31m", "[1, 2]", "{}", "1e-308"]
PICTURES = ["noise", "tiles", "stripes", "patches", "copies", "inverted", "flat", "deep", "large"]
SQL = [
    "UPDATE messages SET data = zeroblob({n})",
    "UPDATE messages SET timestamp = {n} WHERE id = 1",
    "UPDATE messages SET topic_id = 'x', timestamp = NULL",
    "UPDATE topics SET name = char(27) || hex(zeroblob(2000))",
    "UPDATE topics SET type = 'std_msgs/msg/String'",
    "INSERT INTO messages SELECT id + {n} % 1000000, topic_id, timestamp, data FROM messages",
    "DELETE FROM topics",
    "DROP TABLE messages",
    "ALTER TABLE messages RENAME TO kept; CREATE VIEW messages AS SELECT * FROM kept, kept AS b, kept AS c",
    "ALTER TABLE messages ADD COLUMN more GENERATED ALWAYS AS (hex(zeroblob({n} % 300000000)))",
    "CREATE TRIGGER t AFTER UPDATE ON topics BEGIN DELETE FROM messages; END",
]


def bytes_anywhere(content: bytes, draw: Draw) -> bytes:
    """Flipped, overwritten, cut, doubled, taken out: what storage and lines do to any file."""
    data = bytearray(content)
    for _ in range(draw(st.integers(1, 6))):
        del data[_MOST:]
        at = draw(st.integers(0, max(0, len(data) - 1)))
        length = draw(st.sampled_from([1, 2, 4, 8, 64, 1000, len(data)]))
        kind = draw(st.sampled_from(["flip", "number", "cut", "double", "remove", "noise", "zeros"]))
        if kind == "flip" and data:
            data[at] ^= 1 << draw(st.integers(0, 7))
        elif kind == "number":
            packed = struct.pack(draw(st.sampled_from("<>")) + "Q", draw(st.sampled_from(NUMBERS)))
            width = draw(st.sampled_from([1, 2, 4, 8]))
            data[at : at + width] = packed[:width]
        elif kind == "cut":
            del data[at:]
        elif kind == "double":
            data[at:at] = data[at : at + length] * draw(st.sampled_from([1, 2, 50 if length < 2**16 else 1]))
        elif kind == "remove":
            del data[at : at + length]
        else:
            data[at : at + length] = (draw(st.binary(min_size=1, max_size=64)) if kind == "noise" else bytes(length))[
                :length
            ]
    return bytes(data[:_MOST])


def yaml_values(content: bytes, draw: Draw) -> bytes:
    """A value, a key, or the whole replaced; aliases of aliases; scalars that are no plain data."""
    tree = yaml.safe_load(content)
    places: list[tuple[Any, Any]] = []
    seen: set[int] = set()  # an earlier change may have left aliases of aliases: a billion places of ninety nodes

    def visit(node: Any) -> None:
        if isinstance(node, dict | list) and id(node) not in seen:
            seen.add(id(node))
            for key in list(node) if isinstance(node, dict) else range(len(node)):
                places.append((node, key))
                visit(node[key])

    visit(tree)
    kind = draw(st.sampled_from(["value", "value", "value", "scalar", "key", "aliases", "deep", "whole"]))
    if kind == "whole" or not places:
        return yaml.safe_dump(draw(st.sampled_from(VALUES)), allow_unicode=True).encode()
    node, key = draw(st.sampled_from(places))
    if kind == "value":
        node[key] = draw(st.sampled_from(VALUES))
    elif kind == "key" and isinstance(node, dict):
        node[draw(st.sampled_from(["x" * 1000, "\x1b", "fx", "type", 5]))] = node.pop(key)
    elif kind == "scalar":
        node[key] = "SCALAR"
        return yaml.safe_dump(tree).replace("SCALAR", draw(st.sampled_from(SCALARS))).encode()
    elif kind == "aliases":
        node[key] = "SCALAR"
        inner = [",".join([f"*a{n - 1}" if n else "x"] * 10) for n in range(9)]
        levels = [f"a{n}: &a{n} [{inner[n]}]\n" for n in range(9)]
        return (
            ("".join(levels) + yaml.safe_dump(tree).replace("SCALAR", "*a8")).encode()
            if isinstance(tree, dict)
            else b""
        )
    elif kind == "deep":
        node[key] = "SCALAR"
        return yaml.safe_dump(tree).replace("SCALAR", "[" * 300 + "]" * 300).encode()
    return yaml.safe_dump(tree, allow_unicode=True).encode()


def npz_arrays(content: bytes, draw: Draw) -> bytes:
    """An array's values, type, shape, header or packing."""
    arrays = dict(np.load(io.BytesIO(content)))
    if sum(array.size for array in arrays.values()) > _MOST_VALUES:
        raise ValueError("an earlier change declares more than can be written again")
    key = draw(st.sampled_from(sorted(arrays)))
    array = arrays[key]
    kind = draw(st.sampled_from(["value", "value", "all", "type", "shape", "header", "packing", "remove"]))
    if kind in ("value", "all") and array.dtype.kind in "if" and array.size:
        changed = array.astype(float)
        new = draw(st.sampled_from([0.0, -1.0, 0.5, 1e-300, 1e6, 1e15, 1e200, 1e308, np.nan, np.inf]))
        if kind == "all":
            changed = changed * new
        else:
            changed.reshape(-1)[draw(st.integers(0, array.size - 1))] = new
        with np.errstate(all="ignore"):
            arrays[key] = changed.astype(array.dtype) if draw(st.booleans()) else changed
    elif kind == "type":
        arrays[key] = array.astype(draw(st.sampled_from(["U3", "S2", "f4", "i1", "c16", "?"])))
    elif kind == "shape":
        arrays[key] = draw(st.sampled_from([array[..., None], array.reshape(-1), array[:0] if array.ndim else array]))
    elif kind == "remove":
        del arrays[key]
    raw = io.BytesIO()
    np.savez(raw, **arrays)
    members = {info: zipfile.ZipFile(raw).read(info) for info in zipfile.ZipFile(raw).namelist()}
    name = f"{key}.npy"
    if kind == "header":
        head = io.BytesIO()
        shape = draw(st.sampled_from([(10**12,), (10**9, 10**9), (0, 10**18), (2**26, 2), ()]))
        descr = draw(st.sampled_from(["<f8", "<U0", "|V100000", "|O", "<U100000000"]))
        np.lib.format.write_array_header_1_0(head, {"descr": descr, "fortran_order": False, "shape": shape})
        members[name] = head.getvalue() + bytes(draw(st.sampled_from([0, 100, 2**24])))
    methods = [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA]
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", draw(st.sampled_from(methods)) if kind == "packing" else methods[1]) as archive:
        for member, data in members.items():
            archive.writestr(member, data)
    return packed.getvalue()


def mcap_records(content: bytes, draw: Draw) -> bytes:
    """Records repeated, left out, moved, or with other numbers in them; chunks of nothing."""
    position, records = 8, []
    while position + 9 <= len(content) - 8:
        (length,) = struct.unpack_from("<Q", content, position + 1)
        records.append(bytearray(content[position : position + 9 + length]))
        position += 9 + length
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(records) - 1))
        kind = draw(st.sampled_from(["repeat", "remove", "swap", "number", "number", "length", "bomb"]))
        if kind == "repeat":
            records[at:at] = [records[at]] * draw(st.sampled_from([1, 20, 3000 if len(records[at]) < 500 else 20]))
        elif kind == "remove" and len(records) > 1:
            del records[at]
        elif kind == "swap":
            other = draw(st.integers(0, len(records) - 1))
            records[at], records[other] = records[other], records[at]
        elif kind == "number" and len(records[at]) > 10:
            width = draw(st.sampled_from([2, 4, 8]))
            place = draw(st.integers(9, min(len(records[at]) - 1, 200)))
            records[at][place : place + width] = struct.pack("<Q", draw(st.sampled_from(NUMBERS)))[:width]
        elif kind == "length":
            records[at][1:9] = struct.pack("<Q", draw(st.sampled_from(NUMBERS)))
        elif kind == "bomb":
            import zstandard

            packed = zstandard.compress(bytes(2**26))
            head = struct.pack("<QQQII", 0, 9, 2**26, 0, 4) + b"zstd" + struct.pack("<Q", len(packed))
            records[at:at] = [bytearray(struct.pack("<BQ", 6, len(head + packed)) + head + packed)] * draw(
                st.sampled_from([1, 30])
            )
    return (content[:8] + b"".join(map(bytes, records)) + content[-8:])[:_MOST]


def database(content: bytes, draw: Draw) -> bytes:
    connection = sqlite3.connect(":memory:")
    if not hasattr(connection, "deserialize"):  # before Python 3.11
        return bytes_anywhere(content, draw)
    connection.deserialize(content)
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, 5 * 2**20)  # the harness is not what is to be filled
    try:
        connection.executescript(draw(st.sampled_from(SQL)).format(n=draw(st.sampled_from(NUMBERS[:13]))))
        connection.commit()
    except (sqlite3.Error, OverflowError):
        pass
    changed: bytes = connection.serialize()
    return changed if draw(st.booleans()) else bytes_anywhere(changed, draw)


def bag_fields(content: bytes, draw: Draw) -> bytes:
    """The numbers of a ROS 1 bag's records."""
    data = bytearray(content)
    for _ in range(draw(st.integers(1, 3))):
        name = draw(st.sampled_from([b"index_pos=", b"conn_count=", b"chunk_count=", b"size=", b"conn=", b"chunk_pos=", b"ver=", b"count=", b"op="]))  # fmt: skip  # noqa: E501
        places = [at for at in range(len(data)) if data.startswith(name, at)]
        if places:
            at = draw(st.sampled_from(places)) + len(name)
            width = 8 if name in (b"index_pos=", b"chunk_pos=") else 1 if name == b"op=" else 4
            data[at : at + width] = struct.pack("<Q", draw(st.sampled_from(NUMBERS)))[:width]
    return bytes(data)


def png_chunks(content: bytes, draw: Draw) -> bytes:
    """A chunk's content changed, with a checksum that is right."""
    position, chunks = 8, []
    while position + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, position)
        chunks.append((content[position + 4 : position + 8], bytearray(content[position + 8 : position + 8 + length])))
        position += 12 + length
    kind, data = draw(st.sampled_from(chunks))
    if data:
        at = draw(st.integers(0, min(len(data) - 1, 40)))
        width = draw(st.sampled_from([1, 2, 4]))
        data[at : at + width] = struct.pack(">I", draw(st.sampled_from(NUMBERS[:12])))[:width]
    if draw(st.booleans()):
        chunks.insert(
            1, (draw(st.sampled_from([b"zTXt", b"iCCP", b"acTL", b"tRNS"])), bytearray(zlib.compress(bytes(2**22))))
        )
    result = content[:8]
    for name, body in chunks:
        result += struct.pack(">I", len(body)) + name + bytes(body) + struct.pack(">I", zlib.crc32(name + bytes(body)))
    return result


def jpeg_segments(content: bytes, draw: Draw) -> bytes:
    """Scans repeated, numbers of the frame's header changed."""
    frame, scan = content.find(b"\xff\xc2"), content.rfind(b"\xff\xda")
    if draw(st.booleans()):
        return content[:scan] + content[scan:-2] * draw(st.sampled_from([2, 50, 300])) + content[-2:]
    data = bytearray(content)
    at = frame + draw(st.integers(4, 18))
    data[at : at + 2] = struct.pack(">H", draw(st.sampled_from([0, 1, 255, 3000, 30000, 65535])))
    return bytes(data)


def numbers_in_text(content: bytes, draw: Draw) -> bytes:
    """One number or word of a text replaced: of formats that are no plain YAML."""
    places = list(re.finditer(rb"[-+.\w]+", content))
    place = draw(st.sampled_from(places))
    new = draw(
        st.sampled_from(["0", "-1", "1e308", "nan", "inf", "9" * 5000, "", "x", "\x1b[31m", "[1, 2]", "{}", "1e-308"])
    )
    return content[: place.start()] + new.encode() + content[place.end() :]


def pixels(content: bytes, draw: Draw) -> bytes:
    """Another picture in a file that is sound: what a detector may take for its board, or without end."""
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
    if image is None:
        return bytes_anywhere(content, draw)
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    kind = draw(
        st.sampled_from(["noise", "tiles", "stripes", "patches", "copies", "inverted", "flat", "deep", "large"])
    )
    height, width = image.shape
    if kind == "noise":
        image = rng.integers(0, 256, (draw(st.sampled_from([1, 7, 240, 1000])), width)).astype(np.uint8)
    elif kind == "tiles":
        small = rng.choice([0, 255], (8, 8)).astype(np.uint8)
        image = np.tile(np.kron(small, np.ones((draw(st.integers(1, 6)),) * 2, np.uint8)), (30, 30))
    elif kind == "stripes":
        image[:] = np.where(np.arange(width) % draw(st.integers(2, 30)) < 3, 0, 255)
    elif kind == "patches":
        for _ in range(draw(st.integers(1, 30))):
            x, y = rng.integers(0, width), rng.integers(0, height)
            image[y : y + 30, x : x + 30] = rng.integers(0, 256)
    elif kind == "copies":
        image = np.tile(image, draw(st.sampled_from([(1, 2), (2, 2), (4, 5)])))
    elif kind == "inverted":
        image = 255 - image
    elif kind == "flat":
        image = np.full_like(image, draw(st.sampled_from([0, 128, 255])))
    elif kind == "deep":
        image = image.astype(np.uint16) * draw(st.sampled_from([1, 3, 257]))
    elif draw(st.integers(0, 4)) == 0 and image.size <= _MOST_VALUES:
        image = cv2.resize(image, None, fx=16, fy=16, interpolation=cv2.INTER_NEAREST)
    suffix = ".png" if image.dtype == np.uint16 or content[:4] == b"\x89PNG" else ".jpg"
    return bytes(cv2.imencode(suffix, image)[1].tobytes()[:_MOST])


def packed_tar(content: bytes, draw: Draw) -> bytes:
    """Headers changed, with sums that are right; packed otherwise; gigabytes of nothing behind."""
    data = bytearray(zlib.decompressobj(wbits=31).decompress(content, _MOST))  # it may be a bomb from an earlier change
    header = data[:512]
    at, width = draw(st.sampled_from([(0, 100), (100, 8), (124, 12), (156, 1), (157, 100), (257, 8)]))
    new = draw(
        st.sampled_from([b"77777777777", b"../../../evil.png", b"2", b"L", b"x", b"S", b"\x80" + b"\xff" * 11, b""])
    )
    header[at : at + width] = new[:width].ljust(width, b"\0")
    header[148:156] = b" " * 8
    header[148:156] = b"%06o\0 " % sum(header)
    repeats = draw(st.sampled_from([1, 1, 2000]))
    data[:512] = bytes(header) * repeats
    pack = draw(st.sampled_from([gzip.compress, bz2.compress, lzma.compress, bytes]))
    behind = pack(bytes(2**26)) * 30 if draw(st.integers(0, 9)) == 0 and pack is not bytes else b""
    return pack(bytes(data)) + behind


MUTATIONS: dict[str, tuple[Mutation, ...]] = {
    "yaml": (yaml_values, yaml_values, numbers_in_text, bytes_anywhere),
    "npz": (npz_arrays, npz_arrays, bytes_anywhere),
    "mcap": (mcap_records, bytes_anywhere),
    "db3": (database, bytes_anywhere),
    "bag": (bag_fields, bytes_anywhere),
    "png": (png_chunks, pixels, bytes_anywhere),
    "jpg": (jpeg_segments, pixels, bytes_anywhere),
    "json": (numbers_in_text, yaml_values, bytes_anywhere),
    "txt": (numbers_in_text, bytes_anywhere),
    "cameramodel": (numbers_in_text, bytes_anywhere),
    "gz": (packed_tar, bytes_anywhere),
}


def mutated(path: Path, draw: Draw) -> bytes:
    """The content of a seed with one or more changes of its kind."""
    content = path.read_bytes()
    for _ in range(draw(st.sampled_from([1, 1, 2]))):
        change = draw(st.sampled_from(MUTATIONS.get(path.suffix[1:], (bytes_anywhere,))))
        try:
            content = change(content, draw)
        except Exception:  # a second change of structure may find none left
            content = bytes_anywhere(content, draw)
    return content
