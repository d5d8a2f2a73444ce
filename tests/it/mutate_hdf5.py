"""Changes bytes of HDF5 files at random and has deaflow read them: no crash, no hang, no more than a GiB of memory.

    python3 tests/it/mutate_hdf5.py BINARY FOLDER [--count N] [--first SEED] [FORMAT ...]

FOLDER is where files are made. Each format has COUNT files, each made from the same sound file by its number alone; what is found
is printed with the number, and the file is kept.
"""

import argparse
import pathlib
import os
import random
import resource
import shutil
import subprocess
import sys
import time

import h5py
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "docs/tools"))
import read_store  # noqa: E402

# Of processor time: other programs may hold up a sound command. One that does nothing for PATIENCE seconds hangs.
SECONDS, PATIENCE, MEMORY = 10, 60, 1 << 20  # KiB
BLOCK = 512

SCENE = """geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 20 }
material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
drive: { voltage: 5.25 kV }
effects: {}
"""
PIPELINE = (
    "version: 1\nname: small\nscene: scene.yaml\nstages:\n"
    "  small:    { kind: sample, family: small-grid, count: 4, seed: 1 }\n"
    "  solved:   { kind: solve, needs: [small], elements_per_cell: 1, method: linear }\n"
    "  balanced: { kind: balance, needs: [solved], bins: 5, range: [0 mm, 2.5 mm], target: 4, symmetry: d4, seed: 4 }\n"
    "  model:    { kind: train, needs: [solved], network: physics, epochs: 1, seed: 5 }\n"
)
ENVIRONMENT = {k: v for k, v in os.environ.items() if not k.startswith(("DEAFLOW", "RAYON", "RUST"))}
ENVIRONMENT["HDF5_USE_FILE_LOCKING"] = "FALSE"


class Program:
    def __init__(self, binary, folder):
        self.binary, self.folder = binary, folder

    def run(self, *arguments):
        """How it ended, and what is wrong with that."""
        start = time.monotonic()
        with open(self.folder / "stderr", "w+") as errors:
            child = subprocess.Popen(
                [self.binary, *arguments], cwd=self.folder, env=ENVIRONMENT, stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL, stderr=errors,
            )
            status, usage = self.wait(child.pid, start)
            errors.seek(0)
            said = errors.read()
        code = os.waitstatus_to_exitcode(status)
        wrong = []
        if code not in (0, 1, 2, 3, 4, 5):
            wrong.append(f"ended with {code}")
        taken = usage.ru_utime + usage.ru_stime
        if taken > SECONDS:
            wrong.append(f"took {taken:.1f} s")
        if usage.ru_maxrss > MEMORY:
            wrong.append(f"took {usage.ru_maxrss >> 10} MiB")
        if "panicked" in said:
            wrong.append("panicked")
        return code, wrong, said

    def wait(self, pid, start):
        while True:
            done, status, usage = os.wait4(pid, os.WNOHANG)
            if done:
                return status, usage
            if time.monotonic() - start > PATIENCE:
                os.kill(pid, 9)
                _, status, usage = os.wait4(pid, 0)
                return status, usage
            time.sleep(0.002)

    def must(self, *arguments):
        """Makes a sound file, however long that takes."""
        ended = subprocess.run([self.binary, *arguments], cwd=self.folder, env=ENVIRONMENT, capture_output=True, text=True)
        assert ended.returncode == 0, (arguments, ended)


def metadata(path):
    """Where in a file something else stands than elements."""
    size, inside = path.stat().st_size, []
    with h5py.File(path) as file:
        def visit(_, item):
            if isinstance(item, h5py.Dataset) and item.id.get_offset() is not None and item.nbytes > 64:
                # h5py counts from the user block.
                start = item.id.get_offset()
                inside.append((start, start + item.nbytes))
        file.visititems(visit)
    free = np.ones(size, bool)
    for start, end in inside:
        free[start:end] = False
    return np.flatnonzero(free)


def mutate(sound, places, number):
    """The same file for the same number."""
    chance = random.Random(number)
    data = bytearray(sound)
    for _ in range(chance.choice((1, 1, 2, 4, 8, 16))):
        # Most of a header is zeros: what is not is changed more often.
        at = int(places[chance.randrange(len(places))])
        for _ in range(3):
            if data[at] == 0:
                at = int(places[chance.randrange(len(places))])
        kind = chance.randrange(5)
        if kind == 0:
            data[at] = chance.randrange(256)
        elif kind == 1:
            data[at] ^= 1 << chance.randrange(8)
        elif kind == 2:
            data[at] = (data[at] + chance.choice((1, -1))) % 256
        elif kind == 3:
            data[at] = chance.choice((0, 255, 127, 128))
        else:
            value = chance.choice((0, 2**64 - 1, 2**63, 2**40, len(data), chance.randrange(len(data))))
            data[at:at + 8] = value.to_bytes(8, "little")[:len(data) - at]
    return bytes(data)


def compress(chains, blocks, counters, flags):
    """BLAKE3's compression of many blocks of 64 bytes at once: what the reader in docs/tools does one by one."""
    state = [chains[:, i].copy() for i in range(8)]
    state += [np.full(len(chains), word, "u4") for word in read_store.IV[:4]]
    state += [counters.astype("u4"), (counters >> 32).astype("u4")]
    state += [np.full(len(chains), word, "u4") for word in (64, flags)]
    words = [blocks[:, i] for i in range(16)]
    for _ in range(7):
        for i, (a, b, c, d) in enumerate(read_store.QUARTERS):
            for word, turn_d, turn_b in ((words[2 * i], 16, 12), (words[2 * i + 1], 8, 7)):
                state[a] += state[b] + word
                turned = state[d] ^ state[a]
                state[d] = turned >> turn_d | turned << (32 - turn_d)
                state[c] += state[d]
                turned = state[b] ^ state[c]
                state[b] = turned >> turn_b | turned << (32 - turn_b)
        words = [words[i] for i in read_store.PERMUTATION]
    return np.stack([state[i] ^ state[i + 8] for i in range(8)], 1)


def digest(data):
    whole = (len(data) - 1) // 1024
    if not hasattr(read_store, "IV") or whole < 1:
        return read_store.digest(data)
    blocks = np.frombuffer(data[:whole * 1024], "<u4").reshape(whole, 16, 16)
    nodes, counters = np.tile(np.array(read_store.IV, "u4"), (whole, 1)), np.arange(whole, dtype="u8")
    for i in range(16):
        flags = read_store.START * (i == 0) | read_store.END * (i == 15)
        nodes = compress(nodes, blocks[:, i], counters, flags)
    last = read_store.chunk(data[whole * 1024:], whole, False)
    nodes = np.vstack([nodes, np.array([last], "u4")])
    while len(nodes) > 1:
        pairs = nodes[:len(nodes) // 2 * 2].reshape(-1, 16)
        flags = read_store.PARENT | read_store.ROOT * (len(nodes) == 2)
        start = np.tile(np.array(read_store.IV, "u4"), (len(pairs), 1))
        joined = compress(start, pairs, np.zeros(len(pairs), "u8"), flags)
        nodes = np.vstack([joined, nodes[len(pairs) * 2:]])
    return nodes[0].astype("<u4").tobytes()


def seal(data):
    """With the checksum that fits, as a program that wants to do harm would write it."""
    title, content = bytes(data[:BLOCK]).split(b"\n")[:2]
    head = b"\n".join((title, content, digest(data[BLOCK:]).hex().encode(), str(len(data)).encode())) + b"\n"
    return head.ljust(BLOCK, b"\0") + data[BLOCK:]


def prepare(program):
    folder = program.folder
    (folder / "scene.yaml").write_text(SCENE)
    (folder / "small.yaml").write_text(PIPELINE)
    cells = (np.add.outer(np.arange(20), np.arange(20)) // 2 % 2).astype("u1")
    np.savetxt(folder / "p.csv", cells, fmt="%d", delimiter=",")
    with h5py.File(folder / "patterns.sound", "w") as file:
        file["plain"] = cells
        file.create_dataset("packed", data=np.stack([cells] * 3), compression="gzip", shuffle=True)
        file["group/family"] = ["checker"] * 3
        # Nothing is active and nothing moves: an audit finds that sound, and quickly.
        file["patterns"] = np.zeros((3, 20, 20), "u1")
        file["displacement"] = np.zeros((3, 21, 21, 2), "f4")
        file["family"] = ["checker"] * 3
        file["split"] = np.array([b"train", b"test", b"train"])
        file.attrs["scene"] = SCENE
    program.must("solve", "scene.yaml", "p.csv", "-o", "solved.h5", "--method", "linear")
    os.replace(folder / "solved.h5", folder / "solution.sound")
    program.must("run", "small.yaml")
    (folder / "store").rename(folder / "store.sound")


def objects(folder):
    """An artifact of each kind: path in the store, by stage."""
    found = {}
    for path in sorted((folder / "store.sound/objects").glob("*/*.h5")):
        assert read_store.digest(path.read_bytes()[BLOCK:5000]) == digest(path.read_bytes()[BLOCK:5000])
        with h5py.File(path) as file:
            kind = file.attrs.get("kind", b"")
            found[kind.decode() if isinstance(kind, bytes) else kind] = path.relative_to(folder / "store.sound")
    return found


def patterns(program, name, number, sound, places):
    (program.folder / name).write_bytes(mutate(sound, places, number))
    for dataset in ("plain", "packed"):
        yield ("solve", "scene.yaml", f"{name}:/{dataset}", "-o", "out.h5", "--method", "linear")
    yield ("audit", name, "--scene", "scene.yaml", "--samples", "0")


def solution(program, name, number, sound, places):
    (program.folder / name).write_bytes(mutate(sound, places, number))
    yield ("solve", "scene.yaml", f"{name}:/patterns", "-o", "out.h5", "--method", "linear")
    yield ("audit", name, "--scene", "scene.yaml", "--samples", "0")


def model(program, name, number, sound, places):
    data = mutate(sound, places, number)
    # One in ten is only damaged; the others bear the checksum of what they are.
    (program.folder / name).write_bytes(data if number % 10 == 0 else seal(data))
    yield ("predict", name, "p.csv", "-o", "out.h5")


def store(program, name, number, sound, places):
    chosen = sorted(sound)[number % len(sound)]
    path = program.folder / "store" / chosen
    if (program.folder / "store").exists():
        shutil.rmtree(program.folder / "store")
    shutil.copytree(program.folder / "store.sound", program.folder / "store")
    data = mutate(sound[chosen], places[chosen], number)
    (program.folder / name).write_bytes(data if number % 10 == 0 else seal(data))
    path.unlink()
    shutil.copy(program.folder / name, path)
    yield ("show", "small.yaml:balanced")
    yield ("show", chosen.stem[:16])
    yield ("fsck",)


def check(program, kind, numbers):
    folder = program.folder
    if kind is store:
        paths = {folder / "store.sound" / path: path for path in objects(folder).values()}
        sound = {path: full.read_bytes() for full, path in paths.items()}
        places = {path: metadata(full)[BLOCK:] for full, path in paths.items()}
    else:
        full = folder / f"{kind.__name__}.sound"
        if kind is model:
            full = folder / "store.sound" / objects(folder)["train"]
        sound, places = full.read_bytes(), metadata(full)
        places = places[BLOCK:] if kind is model else places
    codes, slowest, faults = {}, 0.0, 0
    for number in numbers:
        name = f"{kind.__name__}-{number}.h5"
        for arguments in kind(program, name, number, sound, places):
            start = time.monotonic()
            code, wrong, said = program.run(*arguments)
            slowest = max(slowest, time.monotonic() - start)
            codes[code] = codes.get(code, 0) + 1
            if wrong:
                faults += 1
                print(f"{name}: {' '.join(arguments)}: {', '.join(wrong)}: {said[-400:]}")
                shutil.copy(folder / name, folder / f"kept-{name}")
        (folder / name).unlink()
    ended = ", ".join(f"{count} with {code}" for code, count in sorted(codes.items()))
    print(f"{kind.__name__}: {len(numbers)} files; commands ended: {ended}; the slowest took {slowest:.1f} s; {faults} faults")
    return faults


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("binary", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("formats", nargs="*", default=["patterns", "solution", "model", "store"])
    arguments = parser.parse_intermixed_args()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    arguments.folder.mkdir(parents=True, exist_ok=True)
    program = Program(arguments.binary.resolve(), arguments.folder.resolve())
    prepare(program)
    kinds = {kind.__name__: kind for kind in (patterns, solution, model, store)}
    numbers = range(arguments.first, arguments.first + arguments.count)
    sys.exit(any([check(program, kinds[name], numbers) for name in arguments.formats]))


if __name__ == "__main__":
    main()
