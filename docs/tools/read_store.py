#!/usr/bin/env python3
"""Reads and checks a deaflow store without deaflow, as described in docs/store.md.

    python3 docs/tools/read_store.py STORE            checks every artifact and record, and lists them
    python3 docs/tools/read_store.py STORE KEY        shows one record: DIGEST of the artifact, parameters, inputs

Needs h5py. Uses the package `blake3` if it is installed, otherwise a slow implementation in this file.
"""

import struct
import sys
from pathlib import Path

import h5py

try:
    from blake3 import blake3

    def digest(data):
        return blake3(data).digest()

except ImportError:
    # The reference algorithm: https://github.com/BLAKE3-team/BLAKE3-specs, section 2.
    IV = (0x6A09E667, 0xBB67AE85, 0x3C6EF372, 0xA54FF53A, 0x510E527F, 0x9B05688C, 0x1F83D9AB, 0x5BE0CD19)
    PERMUTATION = (2, 6, 3, 10, 7, 0, 4, 13, 1, 11, 12, 5, 9, 14, 15, 8)
    QUARTERS = ((0, 4, 8, 12), (1, 5, 9, 13), (2, 6, 10, 14), (3, 7, 11, 15),
                (0, 5, 10, 15), (1, 6, 11, 12), (2, 7, 8, 13), (3, 4, 9, 14))
    START, END, PARENT, ROOT = 1, 2, 4, 8

    def compress(chain, block, counter, length, flags):
        v = list(chain) + list(IV[:4]) + [counter & 0xFFFFFFFF, counter >> 32, length, flags]
        m = list(struct.unpack("<16I", block.ljust(64, b"\0")))
        for _ in range(7):
            for i, (a, b, c, d) in enumerate(QUARTERS):
                for x, turn_d, turn_b in ((m[2 * i], 16, 12), (m[2 * i + 1], 8, 7)):
                    v[a] = (v[a] + v[b] + x) & 0xFFFFFFFF
                    y = v[d] ^ v[a]
                    v[d] = (y >> turn_d | y << (32 - turn_d)) & 0xFFFFFFFF
                    v[c] = (v[c] + v[d]) & 0xFFFFFFFF
                    y = v[b] ^ v[c]
                    v[b] = (y >> turn_b | y << (32 - turn_b)) & 0xFFFFFFFF
            m = [m[i] for i in PERMUTATION]
        return [v[i] ^ v[i + 8] for i in range(8)]

    def chunk(data, counter, root):
        blocks = [data[i:i + 64] for i in range(0, len(data), 64)] or [b""]
        chain = IV
        for i, block in enumerate(blocks):
            last = i + 1 == len(blocks)
            flags = START * (i == 0) | END * last | ROOT * (root and last)
            chain = compress(chain, block, counter, len(block), flags)
        return chain

    def tree(chunks, root):
        if len(chunks) == 1:
            return chunk(chunks[0][1], chunks[0][0], root)
        left = 1 << (len(chunks) - 1).bit_length() - 1
        pair = tree(chunks[:left], False) + tree(chunks[left:], False)
        return compress(IV, struct.pack("<16I", *pair), 0, 64, PARENT | ROOT * root)

    def digest(data):
        parts = [data[i:i + 1024] for i in range(0, len(data), 1024)] or [b""]
        return struct.pack("<8I", *tree(list(enumerate(parts)), True))


TEXT_WIDTH = 64
# Group of texts that are too long for attributes.
LONG = "long_attributes"
# Attributes that describe the content for readers and are not part of it.
WORDING = {"warnings"}
TYPES = {"uint8": "u8", "uint32": "u32", "uint64": "u64", "float32": "f32", "float64": "f64"}


def check_header(path):
    """Reads the header in the first 512 bytes: content digest, digest of all bytes after it, length."""
    data = path.read_bytes()
    title, content, file, size = data[:512].split(b"\0")[0].decode().splitlines()
    assert title == "deaflow-artifact 1", f"{path}: not an artifact"
    assert len(data) == int(size), f"{path}: {len(data)} bytes, {size} were written"
    assert digest(data[512:]).hex() == file, f"{path}: its bytes are not those that were written"
    assert content == path.stem, f"{path}: it holds artifact {content}"


def text_of(value):
    """Decodes an attribute: a text of fixed length, or of variable length in earlier builds."""
    return value if isinstance(value, bytes) else value.encode()


def attributes_of(group):
    """Returns texts by name, including long ones that are stored as datasets of bytes."""
    texts = {name: text_of(value) for name, value in group.attrs.items()}
    return texts | {name: item[()].tobytes() for name, item in group.get(LONG, {}).items()}


def write(out, data):
    out += struct.pack("<Q", len(data)) + data


def write_number(out, number):
    write(out, struct.pack("<Q", number))


def content_digest(path):
    """Returns the digest of the content, the kind, and the digests of the chunks if the artifact is a manifest."""
    with h5py.File(path) as file:
        datasets, parts = {}, []

        def visit(name, item):
            own = name.split("/")[0] in ("provenance", LONG)
            if isinstance(item, h5py.Dataset) and not own and "CLASS" not in item.attrs:
                datasets[name] = item

        file.visititems(visit)
        if "parts" in file:
            parts = [bytes(text).rstrip(b"\0").decode() for text in file["parts"][()]]
            # The arrays of a manifest are views of its chunks and not part of its content.
            datasets = {}
        out = bytearray()
        texts = attributes_of(file)
        kind = texts.pop("kind", b"")
        attributes = sorted(set(texts) - WORDING, key=str.encode)
        write(out, b"deaflow object 2")
        write(out, kind)
        write_number(out, len(attributes))
        for name in attributes:
            write(out, name.encode())
            write(out, texts[name])
        write_number(out, len(datasets))
        for name in sorted(datasets, key=str.encode):
            dataset = datasets[name]
            text = dataset.dtype.kind == "S"
            values = dataset[()]
            write(out, name.encode())
            write(out, text_of(dataset.attrs["units"]))
            write(out, b"text" if text else TYPES[dataset.dtype.name].encode())
            write_number(out, len(dataset.shape))
            for extent in dataset.shape:
                write_number(out, extent)
            if dataset.dtype.kind == "f":
                values = values + 0.0  # −0 is 0
            write(out, values.tobytes() if dataset.size else b"")
            assert not text or dataset.dtype.itemsize == TEXT_WIDTH
        write_number(out, len(parts))
        for part in parts:
            write(out, bytes.fromhex(part))
        return digest(bytes(out)).hex(), kind.decode(), parts


class Reader:
    """Decodes records: little-endian numbers of fixed width, lengths of eight bytes before texts and lists."""

    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, form):
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return values[0] if len(values) == 1 else values

    def bytes(self, n):
        self.at += n
        return self.data[self.at - n:self.at]

    def text(self):
        return self.bytes(self.take("Q")).decode()

    def digest(self):
        return self.bytes(32).hex()

    def list(self, item):
        return [item() for _ in range(self.take("Q"))]

    def canonical(self):
        kind = self.take("I")
        if kind == 0:
            return None
        if kind == 1:
            return bool(self.take("B"))
        if kind == 2:
            mantissa, exponent = self.take("qi")
            unit = self.text()
            return f"{mantissa}e{exponent} {unit}".strip()
        if kind == 3:
            return self.text()
        if kind == 4:
            return self.list(self.canonical)
        assert kind == 5, f"value of kind {kind}"
        return dict(self.list(lambda: (self.text(), self.canonical())))


def read_record(path):
    data = path.read_bytes()
    body, trailer = data[:-32], data[-32:]
    assert digest(body) == trailer, f"{path}: its bytes are not those that were written"
    reader = Reader(body)
    record = {"key": reader.digest()}
    begin = reader.at
    record["kind"] = reader.text()
    record["recipe"] = reader.take("I")
    record["parameters"] = reader.canonical()
    record["inputs"] = reader.list(reader.digest)
    # The action key is the digest of these four fields.
    assert digest(body[begin:reader.at]).hex() == record["key"] == path.name, f"{path}: its key is not its action's"
    record["artifact"] = reader.digest()
    record["file_digest"] = reader.digest()
    record["size"] = reader.take("Q")
    record["seconds"] = reader.take("d")
    record["unstable"] = reader.take("Q")
    record["created"] = reader.text()
    record["version"] = reader.text()
    record["target"] = reader.text()
    assert reader.at == len(body), f"{path}: {len(body) - reader.at} bytes too many"
    return record


def main(store, key=None):
    store = Path(store)
    assert (store / "format").read_text().strip() == "deaflow-store 2", f"{store}: not a store of this format"
    if key:
        for name, value in read_record(store / "records" / key[:2] / key).items():
            print(f"{name}: {value}")
        return
    objects = {}
    for path in sorted((store / "objects").glob("??/*.h5")):
        check_header(path)
        found, kind, parts = content_digest(path)
        assert found == path.stem, f"{path}: its content has the digest {found}"
        objects[found] = kind, parts
        print("artifact", found, kind, f"({len(parts)} chunks)" if parts else "")
    for found, (_, parts) in objects.items():
        assert all(part in objects for part in parts), f"manifest {found} lacks a chunk"
    count = 0
    for path in sorted((store / "records").glob("??/*")):
        record = read_record(path)
        assert record["artifact"] in objects, f"{path}: its artifact is missing"
        assert record["kind"] == objects[record["artifact"]][0], f"{path}: its artifact is of another kind"
        print("record  ", record["key"], record["kind"], "->", record["artifact"])
        count += 1
    print(f"sound: {len(objects)} artifacts, {count} records")


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
