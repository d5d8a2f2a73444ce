"""Draws docs/figures/published.png: published results, measured and simulated; prints the numbers of docs/published.md.

    python3 docs/tools/published.py target/release/deaflow

runs `deaflow fit`, `deaflow compare`, `deaflow solve` and `deaflow solve --path` with the files in
pipelines/published. The fit of the loading and unloading of VHB takes minutes; `--without-cyclic` leaves it out.
Needs numpy and matplotlib.
"""

import csv
import json
import math
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
FOLDER = ROOT / "pipelines" / "published"
TESTS = ("uniaxial", "equibiaxial", "pure-shear")

# Radius of the active disc in mm, undeformed thickness in mm: those of scenes/pelrine.yaml.
RADIUS, THICKNESS = 3.0, 0.1
YEOH = ["effects.strain_stiffening={ model: yeoh, c2: -888 Pa, c3: 16.7 Pa }"]
# Name, equibiaxial prestretch, shear modulus in kPa, permittivity, field in MV/m, area strain in %, other values.
FILMS = [
    ("HS3", 1.14, 43.3, 2.8, 72, 69, []),
    ("HS3", 1.68, 43.3, 2.8, 110, 93, []),
    ("CF19-2186", 1.15, 333, 2.8, 160, 33, []),
    ("CF19-2186", 1.45, 333, 2.8, 350, 64, []),
    ("VHB 4910", 1.15, 138.6, 4.8, 55, 40, YEOH),
    ("VHB 4910", 4.0, 138.6, 4.8, 412, 158, YEOH),
]
# Name, shear modulus in kPa, permittivity, field in MV/m, thickness strain in %, all without prestretch.
UNSTRETCHED = [
    ("Sylgard 186", 233, 2.8, 144, 32),
    ("CF19-2186", 333, 2.8, 235, 32),
    ("HS3", 43.3, 2.8, 72, 41),
    ("latex", 283, 2.7, 67, 11),
    ("fluorosilicone", 167, 6.9, 80, 28),
]
# Dead loads in N on 10 mm x 1 mm of scenes/dead-load.yaml: nominal stresses in 100 kPa.
LOADS = [0.25, 0.31, 0.37, 0.43, 0.49, 0.62]
# Stretch at which the width is held in one of the tests.
WIDTH = 5
# Area strain in % that Huang et al. reached under equal dead loads.
REACHED = 488
# Name, prestretch across and along the stripe, shear modulus in kPa, permittivity, field in MV/m, strain in %, others.
LINEAR = [
    ("HS3", 1.0, 3.8, 43.3, 2.8, 128, 117, []),
    ("CF19-2186", 1.0, 2.0, 333, 2.8, 181, 63, []),
    ("VHB 4910", 1.75, 6.4, 18, 4.5, 239, 215, ["effects.strain_stiffening={ model: gent, jm: 110 }"]),
]
# Lengths in mm of the strip of scenes/strip.yaml, which is 20 mm wide; its load in N and its section in m2.
LENGTHS = [5, 10, 20, 40, 80]
WEIGHT, SECTION = 0.0392, 20e-3 * 50e-6
# Blocked stress in kPa of Carpi et al. at 42 MV/m.
BLOCKED = 49


def run(program, *arguments):
    """Returns the JSON document that a command prints; other output is shown if it fails."""
    command = [program, *map(str, arguments), "--json"]
    ended = subprocess.run(command, cwd=FOLDER, capture_output=True, text=True)
    if ended.returncode:
        sys.exit(f"{' '.join(command)}: {ended.stdout}{ended.stderr}")
    return json.loads(ended.stdout)


def rows(name):
    with open(FOLDER / "measured" / name, encoding="utf-8") as file:
        return [[float(value) for value in row] for row in list(csv.reader(file))[1:]]


def fitted(program, name, law):
    """Returns stretch, measured and fitted stress in MPa of each test."""
    tests = [f"{test}=measured/{name}-{test}.csv" for test in TESTS]
    best = run(program, "fit", "scenes/pull-in.yaml", *tests, "--law", law)["laws"][0]
    misfit = math.sqrt(sum(r * r for file in best["residuals"] for r in file["values"]) / best["points"])
    print(f"{name}: {law}, root mean square of the relative residual {misfit:.4f}")
    curves = {}
    for test, file in zip(TESTS, best["residuals"]):
        data = rows(f"{name}-{test}.csv")
        curves[test] = [(l, p, p * (1 + r)) for (l, p), r in zip(data, file["values"])]
    return curves


def compared(program, scene, measured, scale=1e-3):
    """Returns abscissa, measured and simulated value by file of a comparison."""
    with tempfile.TemporaryDirectory() as folder:
        table = pathlib.Path(folder) / "compared.csv"
        named = f"scenes/{scene}.yaml", f"measured/{measured}.yaml"
        for file in run(program, "compare", *named, "-o", table)["compared"]:
            print(f"{scene}, {file['file']}: root mean square {file['rms']:.4g}, R² {file['r_squared']:.4f}")
        curves = {}
        with open(table, encoding="utf-8") as file:
            for row in csv.DictReader(file):
                values = float(row["measured"]) * scale, float(row["simulated"]) * scale
                at = float(row["stretch"]) if row["stretch"] else float(row["voltage_V"]) / 1e3
                curves.setdefault(row["file"], []).append((at, *values))
    return curves


def cyclic(program):
    """Returns stretch, measured and fitted stress in kPa of each loading and unloading."""
    files = sorted(path.name for path in (FOLDER / "measured").glob("hossain-cyclic-*.csv"))
    tests = [f"uniaxial=measured/{file}" for file in files]
    options = ["--law", "neo-hookean", "--absolute", "--branches", 2]
    found = run(program, "fit", "scenes/hossain-cyclic.yaml", *tests, *options)["relaxation"]
    best = min(found, key=lambda fit: fit["aicc"])
    print("cyclic:", {p["name"]: round(p["value"], 4) for p in best["parameters"]})
    curves = {}
    for file, fit in zip(files, best["residuals"]):
        curves[file] = [(row[1], row[2], row[2] + r * 1e-3) for row, r in zip(rows(file), fit["values"])]
    total = [m - s for curve in curves.values() for _, m, s in curve]
    print(f"cyclic: root mean square {math.sqrt(sum(d * d for d in total) / len(total)):.3f} kPa")
    for file, curve in curves.items():
        peak = max(curve, key=lambda point: point[1])
        print(f"  {file}: peak {peak[1]:.1f} kPa measured, {peak[2]:.1f} kPa fitted")
    return curves


def path(program, prestretch, modulus, permittivity, more):
    """Returns voltages in V and area stretches of a disc up to its limit."""
    values = [
        f"geometry.prestretch={prestretch}",
        f"material.shear_modulus={modulus} kPa",
        f"material.relative_permittivity={permittivity}",
        *more,
    ]
    sets = [part for value in values for part in ("--set", value)]
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "path.h5"
        arguments = ["solve", "scenes/pelrine.yaml", "measured/disc.csv", "--order", 2, "--path", "-o", out, *sets]
        one = run(program, *arguments)["paths"][0]
    points = [point for point in one["points"] if point["stable"]]
    return [(p["voltage"], (1 + p["max_displacement"] / RADIUS) ** 2) for p in points], one["limit"]


def field(volts, area, prestretch):
    """Returns the true field in MV/m at an area stretch beyond the prestretch."""
    return volts / (THICKNESS * 1e-3) * prestretch**2 * area * 1e-6


def at_area(points, area, prestretch):
    """Returns the field at which the simulation has an area stretch; None beyond its limit."""
    for (v0, a0), (v1, a1) in zip(points, points[1:]):
        if a0 <= area <= a1:
            return field(v0 + (v1 - v0) * (area - a0) / (a1 - a0), area, prestretch)
    return None


def actuators(program):
    """Returns, for each film, its path as area strain in % against the field, and the published point."""
    found = []
    print("film, prestretch, published field in MV/m and area strain in %;")
    print("simulated: field at this strain, limit, field and strain at the limit")
    for name, prestretch, modulus, permittivity, published, strain, more in FILMS:
        points, limit = path(program, prestretch, modulus, permittivity, more)
        curve = [(field(v, a, prestretch), 100 * (a - 1)) for v, a in points]
        same = at_area(points, 1 + strain / 100, prestretch)
        same = "-" if same is None else f"{same:.0f}"
        at_limit = f"{curve[-1][0]:.0f}, {curve[-1][1]:.0f}"
        print(f"{name}, {prestretch}, {published}, {strain}; {same}, {limit['kind']}, {at_limit}")
        found.append((name, prestretch, curve, (published, strain)))
    return found


def films(program):
    """Returns published and simulated fields of films without prestretch at the published thickness strain."""
    found = []
    print("film without prestretch, published field in MV/m and thickness strain in %;")
    print("simulated: field at this strain, thickness strain at the limit")
    for name, modulus, permittivity, published, strain in UNSTRETCHED:
        points, _ = path(program, 1, modulus, permittivity, [])
        area = 1 / (1 - strain / 100)
        same = at_area(points, area, 1)
        most = 100 * (1 - 1 / points[-1][1])
        print(f"{name}, {published}, {strain}; {same if same is None else round(same)}, {most:.0f}")
        found.append((name, published, same))
    return found


def followed(program, scene, sets, pattern="cell"):
    """Returns the points of the path of a cell, and its limit."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "path.h5"
        options = [part for value in sets for part in ("--set", value)]
        arguments = [f"scenes/{scene}.yaml", f"measured/{pattern}.csv", "--path", "-o", out, *options]
        one = run(program, "solve", *arguments)["paths"][0]
    return one["points"], one["limit"]


def solved(program, scene, pattern, sets):
    """Returns the result of one pattern with biquadratic elements."""
    options = [part for value in sets for part in ("--set", value)]
    arguments = [f"scenes/{scene}.yaml", pattern, "--order", 2, "--no-checks", *options]
    return run(program, "solve", *arguments)["patterns"][0]


def rising(points):
    """Returns the states, as voltage and stretch, that a rising voltage reaches: at a fold the sheet jumps."""
    reached = [points[0]]
    for before, point in zip(points, points[1:]):
        top = reached[-1][0]
        if point[0] <= top:
            continue
        if before[0] < top:
            share = (top - before[0]) / (point[0] - before[0])
            reached.append((top, before[1] + share * (point[1] - before[1])))
        reached.append(point)
    return reached


def broken(reached, area):
    """Returns the state at which the field passes the strength of VHB, and whether the sheet is lost in a jump.

    The field is that of a sheet of 1 mm, `area` gives its area stretch; the strength is that of Huang et al.
    """
    margins = [volts * 1e-3 * area(stretch) - 51 * area(stretch) ** 0.315 for volts, stretch in reached]
    for (a, x), (b, y) in zip(zip(reached, margins), zip(reached[1:], margins[1:])):
        if y > 0:
            share = -x / (y - x)
            return tuple(p + share * (q - p) for p, q in zip(a, b)), a[0] == b[0]
    return None, False


def dead_loads(program):
    """Returns, for each load, its stretch and the states under equal loads up to breakdown."""
    found = []
    print("nominal stress in kPa; equal loads: stretch, voltage in kV and area strain in % at breakdown, jump;")
    print("width free: stretch, voltage and stretch by voltage at the limit; width held: the same at breakdown")
    for load in LOADS:
        side = f"load: [{load} N, 0 N]"
        right, top = f"geometry.sides.right={{ {side} }}", f"geometry.sides.top={{ load: [0 N, {load} N] }}"
        points, _ = followed(program, "dead-load", [right, top])
        reached = rising([(p["voltage"], 1 + p["max_displacement"] / 10 / math.sqrt(2)) for p in points])
        rest = reached[0][1]
        end, lost = broken(reached, lambda stretch: stretch**2)
        jumps = any(a[0] == b[0] for a, b in zip(reached, reached[1:]))
        strain = f"{100 * ((end[1] / rest) ** 2 - 1):.0f}{' after a jump' if jumps else ''}"
        strain = "breakdown in the jump" if lost else strain
        print(f"{100 * load:.0f}; {rest:.2f}, {end[0] / 1e3:.2f}, {strain}; ", end="")
        states = [state for state in reached if state[0] < end[0]] + ([] if lost else [end])
        found.append((100 * load, [(v / 1e3, 100 * ((s / rest) ** 2 - 1)) for v, s in states], lost))

        bar = f"geometry.sides.right={{ bar: {{ {side}, moves: [x] }} }}"
        _, limit = followed(program, "dead-load", [bar, "geometry.sides.top=free"])
        volts = 0.9999 * limit["voltage"]
        sets = [bar, "geometry.sides.top=free", f"drive.voltage={volts} V"]
        moved = solved(program, "dead-load", "measured/cell.csv", sets)["bars"]["right"]
        stretch = 1 + moved["translation_mm"][0] / 10
        rest = stretch - moved["from_rest_mm"][0] / 10
        print(f"{rest:.2f}, {limit['voltage'] / 1e3:.2f}, {stretch / rest:.2f}; ", end="")

        sets = [f"geometry.sides.right={{ load: [{load / WIDTH} N, 0 N] }}", f"geometry.prestretch=[1, {WIDTH}]"]
        points, _ = followed(program, "dead-load", [*sets, "geometry.sides.top=roller"])
        reached = rising([(p["voltage"], 1 + p["max_displacement"] / 10) for p in points])
        end, _ = broken(reached, lambda stretch: WIDTH * stretch)
        rest = reached[0][1]
        print(f"{rest:.2f}, {end[0] / 1e3:.2f}, {end[1] / rest:.2f}")
    return found


def linear(program):
    """Returns published fields of stripes, and those simulated under the load of the film and without it."""
    found = []
    print("stripe, prestretches, published field in MV/m and strain in %; simulated with the load of the film, without")
    for name, across, along, modulus, permittivity, published, strain, more in LINEAR:
        common = [
            f"geometry.prestretch=[{across}, {along}]",
            f"material.shear_modulus={modulus} kPa",
            f"material.relative_permittivity={permittivity}",
            *more,
        ]
        held = "geometry.sides.right={ bar: { displacement: [0 mm, 0 mm] } }"
        pull = solved(program, "linear-film", "measured/cell.csv", [*common, held, "drive.voltage=1 V"])
        pull = pull["reactions_n"]["right"][0]
        fields = []
        for side in (f"{{ load: [{pull} N, 0 N] }}", "free"):
            points, _ = followed(program, "linear-film", [*common, f"geometry.sides.right={side}"])
            # Without a load the stripe is shorter at first, and the largest displacement falls before it grows.
            aim = 10 * strain / 100
            grown = [p for a, p in zip(points, points[1:]) if p["max_displacement"] > a["max_displacement"]]
            pairs = [(a, b) for a, b in zip(grown, grown[1:]) if a["max_displacement"] <= aim < b["max_displacement"]]
            (a, b), *_ = pairs
            share = (aim - a["max_displacement"]) / (b["max_displacement"] - a["max_displacement"])
            volts = a["voltage"] + share * (b["voltage"] - a["voltage"])
            fields.append(volts / (THICKNESS * 1e-3) * across * along * (1 + strain / 100) * 1e-6)
        print(f"{name}, {across} x {along}, {published}, {strain}; {fields[0]:.0f}, {fields[1]:.0f}")
        found.append((name, published, fields))
    return found


def strip(program):
    """Returns length over width, blocked stress in kPa and strain in % of a strip with a weight."""
    found = []
    print("strip: length over width; blocked stress in kPa at 42 MV/m, strain in % at 49 MV/m")
    with tempfile.TemporaryDirectory() as folder:
        for length in LENGTHS:
            columns = max(10, min(40, length))
            pattern = pathlib.Path(folder) / "strip.csv"
            pattern.write_text("\n".join([",".join(["1"] * columns)] * 20) + "\n", encoding="utf-8")
            sets = [f"geometry.size=[{length} mm, 20 mm]", f"geometry.cells=[{columns}, 20]"]
            moved = solved(program, "strip", pattern, sets)["bars"]["right"]
            rest = moved["translation_mm"][0] - moved["from_rest_mm"][0]
            held = f"geometry.sides.right={{ bar: {{ displacement: [{rest} mm, 0 mm] }} }}"
            one = solved(program, "strip", pattern, [*sets, held, "drive.voltage=2.1 kV"])
            blocked = (WEIGHT - one["reactions_n"]["right"][0]) / SECTION * 1e-3
            strain = 100 * moved["from_rest_mm"][0] / (length + rest)
            print(f"{length / 20}; {blocked:.1f}, {strain:.2f}")
            found.append((length / 20, blocked, strain))
    return found


def main(program, *options):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from photographs import reduce

    program = str(pathlib.Path(program).resolve())
    figure, axes = plt.subplots(4, 3, figsize=(10.5, 12.0), layout="constrained")
    axes = axes.flat

    def curves(axis, found, title, xlabel="stretch", ylabel="nominal stress, MPa", names=None):
        for number, (name, points) in enumerate(found.items()):
            x, measured, simulated = zip(*points)
            color = f"C{number}"
            shown = slice(None, None, 1 + len(x) // 40)
            axis.plot(x[shown], measured[shown], "o", ms=3, fillstyle="none", color=color)
            axis.plot(x, simulated, color=color, lw=1, label=(names or {}).get(name, name))
        axis.set(xlabel=xlabel, ylabel=ylabel)
        axis.set_title(title, fontsize=9)
        axis.legend(frameon=False, fontsize=7)

    curves(axes[0], fitted(program, "treloar", "ogden:3"), "1 natural rubber, Treloar 1944")
    curves(axes[1], fitted(program, "kawabata", "ogden:2"), "2 isoprene rubber, Kawabata 1981")
    found = compared(program, "meunier", "meunier", 1e-6)
    curves(axes[2], found, "3 silicone RTV 141, Meunier 2008", names={f"meunier-{test}.csv": test for test in TESTS})
    found = compared(program, "hossain", "hossain-equilibrium")
    names = {"hossain-equilibrium.csv": "first reading", "hossain-equilibrium-again.csv": "second reading"}
    curves(axes[3], found, "4 VHB 4910 at equilibrium, Hossain 2012", ylabel="nominal stress, kPa", names=names)
    if "--without-cyclic" not in options:
        found = cyclic(program)
        short = {name: name.removeprefix("hossain-cyclic-").removesuffix(".csv") for name in found}
        shown = {short[name]: curve for name, curve in found.items() if "-1.5-" in name or "-3.0-" in name}
        curves(axes[4], shown, "5 VHB 4910 loaded and unloaded, Hossain 2012", ylabel="nominal stress, kPa")
    found = compared(program, "vhb4905", "vhb4905-equilibrium")
    names = {"vhb4905-equilibrium.csv": "Yeoh"}
    curves(axes[5], found, "6 VHB 4905 (?) at equilibrium", ylabel="nominal stress, kPa", names=names)
    found = compared(program, "pull-in", "pull-in", 1.0)
    names = {"pull-in.csv": "neo-Hookean"}
    curves(axes[6], found, "7 free sheet, Zhao and Suo 2007", xlabel="voltage, kV", ylabel="stretch", names=names)
    for number, (name, prestretch, curve, (published, strain)) in enumerate(actuators(program)):
        x, y = zip(*curve)
        axes[7].semilogx(x, y, color=f"C{number}", lw=1, label=f"{name}, {prestretch}")
        axes[7].plot(published, strain, "o", ms=5, fillstyle="none", color=f"C{number}")
    axes[7].set(xlabel="true field, MV/m", ylabel="area strain, %", xlim=(20, 700), ylim=(0, 180))
    axes[7].set_xticks([20, 50, 100, 200, 500], ["20", "50", "100", "200", "500"])
    axes[7].minorticks_off()
    axes[7].set_title("8 prestretched films, Pelrine 2000", fontsize=9)
    axes[7].legend(frameon=False, fontsize=7)
    for number, (name, published, same) in enumerate(films(program)):
        if same is not None:
            axes[8].plot(published, same, "o", fillstyle="none", color=f"C{number}", label=name)
    axes[8].plot([0, 300], [0, 300], color="0.7", lw=1)
    axes[8].set(xlabel="published field, MV/m", ylabel="simulated field at the same\nthickness strain, MV/m")
    axes[8].set_title("9 films without prestretch, Pelrine 1998", fontsize=9)
    axes[8].legend(frameon=False, fontsize=7)
    compared(program, "dead-load", "dead-load", 1.0)
    for number, (stress, curve, lost) in enumerate(dead_loads(program)):
        x, y = zip(*curve)
        axes[9].plot(x, y, color=f"C{number}", lw=1, label=f"{stress:.0f} kPa")
        axes[9].plot(x[-1], y[-1], "x", ms=5, color=f"C{number}")
    axes[9].axhline(REACHED, color="0.6", lw=1, ls="--")
    axes[9].set(xlabel="voltage, kV", ylabel="area strain by voltage, %", ylim=(0, 700))
    axes[9].set_title("10 VHB 4910, equal dead loads, Huang 2012", fontsize=9)
    axes[9].legend(frameon=False, fontsize=7)
    for number, (name, published, fields) in enumerate(linear(program)):
        axes[10].plot([published] * 2, fields, "o-", lw=1, fillstyle="none", color=f"C{number}", label=name)
    axes[10].plot([0, 260], [0, 260], color="0.7", lw=1)
    axes[10].set(xlabel="published field, MV/m", ylabel="simulated field at the same\nstrain, MV/m")
    axes[10].set_title("11 stripes in stretched films, Pelrine 2000", fontsize=9)
    axes[10].legend(frameon=False, fontsize=7)
    ratio, blocked, _ = zip(*strip(program))
    axes[11].semilogx(ratio, blocked, "o-", lw=1, ms=3, fillstyle="none")
    axes[11].axhline(BLOCKED, color="0.6", lw=1, ls="--")
    axes[11].set(xlabel="length over width of the strip", ylabel="blocked stress, kPa", ylim=(0, 80))
    axes[11].set_xticks(ratio, [f"{value:g}" for value in ratio])
    axes[11].minorticks_off()
    axes[11].set_title("12 acrylic strip with a weight, Carpi 2003", fontsize=9)
    target = ROOT / "docs" / "figures" / "published.png"
    figure.savefig(target, dpi=80)
    reduce(target)


if __name__ == "__main__":
    main(*sys.argv[1:])
