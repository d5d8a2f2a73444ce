"""Reads lines of JSON and prints the table: milliseconds of one core per solve, and how many times ours each is."""

import json
import sys

rows = [json.loads(line) for line in sys.stdin if line.startswith("{")]
sizes = sorted({row["elements"] for row in rows})
ours = {row["elements"]: row for row in rows if row["code"] == "deaflow"}
codes = list(dict.fromkeys(row["code"] for row in rows))

print("| code |" + "".join(f" {n}² ms | times ours |" for n in sizes))
print("|---|" + "---:|---:|" * len(sizes))
worst = 0.0
for code in codes:
    cells = []
    for n in sizes:
        row = next(row for row in rows if row["code"] == code and row["elements"] == n)
        cells.append(f" {row['ms']:.2f} | {row['ms'] / ours[n]['ms']:.1f} |")
        for theirs, mine in zip(row["max_mm"], ours[n]["max_mm"]):
            worst = max(worst, abs(theirs / mine - 1))
    print(f"| {code} |" + "".join(cells))
print(f"\nThe largest displacements of all codes agree to {worst:.1e}.")
