"""Compares searches that evaluate all or only the best patterns of a generation: `chord:2`, ten seeds, four goals.

`python3 docs/tools/judgements.py [PROGRAM]` needs h5py and numpy, and prints the numbers of docs/design.md; smaller F is better.
The default PROGRAM is target/release/deaflow.
"""
import pathlib, subprocess, sys, tempfile, time
import h5py
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
SEEDS = range(1, 11)
MIDDLE, CORNER = "point: [25 mm, 25 mm], direction: 0 deg", "point: [37.5 mm, 37.5 mm], direction: 45 deg"
AROUND = [("37.5", "37.5", 135), ("12.5", "37.5", 225), ("12.5", "12.5", 315), ("37.5", "12.5", 45)]
TURN = ", ".join(f"{{ point: [{x} mm, {y} mm], direction: {to} deg }}" for x, y, to in AROUND)
GOALS = {
    "centre along x": (f"{{ {MIDDLE} }}", 0.5),
    "(37.5, 37.5) mm along the diagonal": (f"{{ {CORNER} }}", 0.5),
    "centre by 1.00 mm": (f"{{ {MIDDLE}, value: 1.00 mm }}", 0.3),
    "rotation of four points": (f"{{ points: [ {TURN} ] }}", 0.5),
}

def searched(program, objective, area, judged):
    """Returns the best F and the number of evaluations of each seed, and the seconds of all searches."""
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "scene.yaml").write_text((ROOT / "pipelines/scenes/vhb4910.yaml").read_text())
        stages = [
            f"  s{seed}: {{ kind: design, objective: {objective}, area: {area}, evaluator: 'chord:2', judged: {judged}, seed: {seed} }}"
            for seed in SEEDS
        ]
        (folder / "seeds.yaml").write_text("\n".join(["version: 1", "name: seeds", "scene: scene.yaml", "stages:", *stages]))
        begun = time.monotonic()
        command = [program, "run", folder / "seeds.yaml", "--store", folder / "store", "-q"]
        subprocess.run(command, check=True)
        took = time.monotonic() - begun
        found = []
        for path in (folder / "store/objects").rglob("*.h5"):
            with h5py.File(path) as file:
                if file.attrs["kind"] == b"design chunk":
                    found.append((file["history/best"][-1], file["evaluations"][0]))
        assert len(found) == len(SEEDS), f"{len(found)} searches"
        return np.array(found), took

def main():
    program = sys.argv[1] if len(sys.argv) > 1 else ROOT / "target/release/deaflow"
    print("| goal | judged | evaluations | F, mean | F, worst | s per search |\n|---|---:|---:|---:|---:|---:|")
    for goal, (objective, area) in GOALS.items():
        for judged in (1, 0.25):
            found, took = searched(program, objective, area, judged)
            best, evaluations = found[:, 0], found[:, 1].mean()
            print(f"| {goal} | {judged} | {evaluations:,.0f} | {best.mean():.5f} | {best.max():.5f} | {took / len(SEEDS):.1f} |", flush=True)

if __name__ == "__main__":
    main()
