#!/usr/bin/env python3
"""Times workflow managers beside deaflow in one run: benches/peers/workflow.py [--chunks 1000] [--large] [--deaflow PROGRAM]

DVC and Snakemake come from PyPI into a virtual environment under target/. Each tool gets the same pipelines: 7 stages, and
chunks gathered in one result; --large adds 10,000 chunks for deaflow alone. deaflow draws 50 patterns in each chunk;
the others write a file as large as such a chunk with `head`, which is all their commands do, and have two jobs where they
can. Times are those of whole processes. The overhead of a chunk is the time of the first build, less what the commands take on
their own (nothing is taken off for deaflow's own drawing), divided by the chunks.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
WORK = ROOT / "target" / "workflow-peers"
BIN = WORK / "venv" / "bin"
SIZE = 140_000  # bytes of a chunk of 50 patterns
PATIENCE = 60.0  # s: after so long no more reruns are timed


def install():
    """Whether the peers are there; says why not."""
    if not (BIN / "python").exists():
        subprocess.run([sys.executable, "-m", "venv", WORK / "venv"], check=True)
    if (BIN / "dvc").exists() and (BIN / "snakemake").exists():
        return True
    got = subprocess.run([BIN / "pip", "install", "-q", "dvc", "snakemake"], stderr=subprocess.PIPE, text=True)
    if got.returncode != 0:
        print("DVC and Snakemake could not be installed from PyPI; only deaflow is timed:\n" + got.stderr, file=sys.stderr)
    return got.returncode == 0


def version(name):
    listed = subprocess.run([BIN / "pip", "list", "--format", "json"], capture_output=True, text=True, check=True).stdout
    return next(package["version"] for package in json.loads(listed) if package["name"] == name)


def environment():
    return {**os.environ, "DVC_NO_ANALYTICS": "1", "PATH": f"{BIN}:{os.environ['PATH']}", "HOME": str(WORK)}


def seconds(command, folder):
    start = time.perf_counter()
    done = subprocess.run(command, cwd=folder, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    taken = time.perf_counter() - start
    if done.returncode != 0:
        sys.exit(f"{command} failed:\n{done.stdout}")
    return taken


def command(target):
    return f"head -c {SIZE} /dev/zero > {target}"


def dvc(folder, stages, chunks):
    """`stages` in a row, or `chunks` that a last stage gathers."""
    lines = ["stages:"]
    for i in range(stages or chunks):
        lines += [f"  c{i}:", f"    cmd: {command(f'out{i}')}", f"    outs: [out{i}]"]
        if stages and i:
            lines.append(f"    deps: [out{i - 1}]")
    if chunks:
        deps = "".join(f"\n      - out{i}" for i in range(chunks))
        lines += ["  all:", f"    cmd: {command('all')}", "    outs: [all]", f"    deps:{deps}"]
    (folder / "dvc.yaml").write_text("\n".join(lines) + "\n")
    subprocess.run(["dvc", "init", "-q", "--no-scm"], cwd=folder, env=environment(), check=True)
    return ["dvc", "repro", "-q"]


def snakemake(folder, stages, chunks):
    last = f"out{stages - 1}" if stages else "all"
    text = f'rule all:\n    input: "{last}"\n'
    if stages:
        for i in range(stages):
            needs = f'    input: "out{i - 1}"\n' if i else ""
            text += f'rule c{i}:\n{needs}    output: "out{i}"\n    shell: "{command("{output}")}"\n'
    else:
        text += f'rule gather:\n    input: expand("out{{i}}", i=range({chunks}))\n    output: "all"\n'
        text += f'    shell: "{command("{output}")}"\n'
        text += f'rule chunk:\n    output: "out{{i}}"\n    shell: "{command("{output}")}"\n'
    (folder / "Snakefile").write_text(text)
    return ["snakemake", "-q", "all", "-j", "2"]


def deaflow(program, folder, stages, chunks):
    lines = ["version: 1", "name: toy", "stages:"]
    for i in range(stages or 1):
        count = 50 if stages else 50 * chunks
        lines.append(f"  s{i}: {{ kind: sample, family: small-grid, count: {count}, seed: {i} }}")
    (folder / "toy.yaml").write_text("\n".join(lines) + "\n")
    return [str(program), "run", "toy.yaml", "--jobs", "2"]


def measure(make, stages, chunks):
    """First build and best rerun, s, with how many reruns were timed."""
    folder = Path(tempfile.mkdtemp(dir=WORK))
    try:
        words = make(folder, stages, chunks)
        built = seconds(words, folder)
        reruns = []
        while len(reruns) < 5 and sum(reruns) < PATIENCE:
            reruns.append(seconds(words, folder))
        return built, min(reruns), len(reruns)
    finally:
        shutil.rmtree(folder)


def commands_alone(n):
    """What n commands of the peers take, s."""
    folder = Path(tempfile.mkdtemp(dir=WORK))
    try:
        start = time.perf_counter()
        for i in range(n):
            subprocess.run(["sh", "-c", command(f"out{i}")], cwd=folder, check=True)
        return time.perf_counter() - start
    finally:
        shutil.rmtree(folder)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--chunks", type=int, default=1000, help="in the chunked pipeline (DVC takes long for many)")
    parser.add_argument("--large", action="store_true", help="10,000 chunks too, deaflow alone (1.5 GB, some minutes)")
    parser.add_argument("--deaflow", type=Path, help="a program, instead of building one")
    given = parser.parse_args()
    large, program = given.large, given.deaflow
    WORK.mkdir(parents=True, exist_ok=True)
    if program is None:
        subprocess.run(["cargo", "build", "-q", "--release"], cwd=ROOT, check=True)
        program = ROOT / "target" / "release" / "deaflow"
    ours_first = partial(deaflow, program.resolve())
    tools = [("deaflow", ours_first)]
    if install():
        tools += [(f"Snakemake {version('snakemake')}", snakemake), (f"DVC {version('dvc')}", dvc)]
    print("| pipeline | tool | no-op s | times ours | overhead ms a chunk | times ours |")
    print("|---|---|---:|---:|---:|---:|", flush=True)
    cases = [("7 stages", 7, 0), (f"{given.chunks} chunks", 0, given.chunks)] + ([("10,000 chunks", 0, 10_000)] if large else [])
    for title, stages, chunks in cases:
        n = stages or chunks
        ours = None
        for name, make in tools if n < 10_000 else tools[:1]:
            built, again, reruns = measure(make, stages, chunks)
            alone = 0.0 if make is ours_first else commands_alone(n)
            overhead = 1e3 * (built - alone) / n
            ours = ours or (again, overhead)
            few = "" if reruns == 5 else f" (best of {reruns})"
            print(
                f"| {title} | {name} | {again:.3f}{few} | {again / ours[0]:.0f} |"
                f" {overhead:.1f} | {overhead / ours[1]:.0f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
