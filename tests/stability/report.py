"""Makes docs/stability.md, docs/stability.csv and docs/images/leak.png from a run of the failure catalogue.

docs/stability.csv keeps one line per row and method; lines of methods that this run did not have (a GPU's, say)
stay as they were.
"""

import argparse
import csv
import datetime
import json
import pathlib
import struct
import zlib

ROOT = pathlib.Path(__file__).resolve().parents[2]
FIELDS = ["row", "failure", "input", "criterion", "method", "failures", "trials", "verdict", "note", "reason",
          "date", "commit", "device", "full"]
TITLES = {
    "kdtree_watertight": "kd-tree, watertight",
    "kdtree_double": "kd-tree, double",
    "kdtree_moller_trumbore": "kd-tree, Möller-Trumbore",
    "bvh_watertight": "bvh, watertight",
    "bvh_double": "bvh, double",
    "bvh_moller_trumbore": "bvh, Möller-Trumbore",
    "embree_robust": "Embree, robust",
    "embree_fast": "Embree, fast",
    "cuda_kdtree_watertight": "CUDA kd-tree, watertight",
    "cuda_kdtree_double": "CUDA kd-tree, double",
    "cuda_kdtree_moller_trumbore": "CUDA kd-tree, Möller-Trumbore",
    "cuda_bvh_watertight": "CUDA bvh, watertight",
    "cuda_bvh_double": "CUDA bvh, double",
    "cuda_bvh_moller_trumbore": "CUDA bvh, Möller-Trumbore",
    "photon_bvh": "photon mapping, bvh",
    "cuda_photon_kdtree": "CUDA photon mapping, kd-tree",
    "cuda_photon_bvh": "CUDA photon mapping, bvh",
    "reyes": "REYES",
    "cuda_reyes": "CUDA REYES",
}
INTRO = """# Stability

What every method does on inputs where ray tracers fail. Written by `scripts/stability` from a run of the tests with
the label `stability`; do not edit. The numbers are in [stability.csv](stability.csv).

"""
HOW = """A cell says how many trials failed. **Fails** marks failures that are known and explained below; a failure that is not
makes the suite fail. An empty cell: not measured for that method. The suite takes fewer trials than the inputs below
name, unless it is run with `scripts/stability --full`; [Runs](#runs) says which.

Rows 4, 6, 9, 10, 11, 16, 17 and 18 are judged by exact geometry (`tests/support/exact_oracle.h`): wherever a ray clears
every edge by 7.002 x 2^-24 x M, with M the largest coordinate of a corner relative to the ray's origin, the triangle
must be that of rational arithmetic; nearer than that, one of the triangles there must be hit where their outline winds
about the ray. Methods that compute t in single precision are judged by their triangle alone in these rows (but for row
9, which is about t), and the excess of t over its bound is noted.

"""


def write_png(ppm, path):
    """Writes a binary PPM as PNG."""
    magic, size, depth, pixels = ppm.read_bytes().split(b"\n", 3)
    if magic != b"P6" or depth != b"255":
        raise SystemExit(f"{ppm}: not a PPM of 8 bits")
    width, height = map(int, size.split())
    rows = b"".join(b"\0" + pixels[3 * width * y:3 * width * (y + 1)] for y in range(height))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows, 9)) +
                     chunk(b"IEND", b""))


def read_csv(path, fields):
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return [dict(zip(fields, line)) for line in csv.reader(file) if line and line[0] != "row"]


def cell(entry):
    if entry is None:
        return ""
    if entry["verdict"] == "pass":
        return "pass"
    text = f"{int(entry['failures']):,} of {int(entry['trials']):,}"
    return f"**fails**: {text}" if entry["verdict"] == "fails as expected" else f"**UNEXPECTED**: {text}"


def percent(e):
    share = 100 * int(e["failures"]) / max(int(e["trials"]), 1)
    return f"{share:.2g} %" if share < 99.5 else f"{share:.0f} %"


def listing(names):
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


def summary(entries, methods):
    """The sentence that a reader who stops there takes along."""
    failing = {m: [e["row"] for e in entries if e["method"] == m and e["verdict"] != "pass"] for m in methods}
    clean = [TITLES[m] for m in methods if not failing[m]]
    rest = [f"{TITLES[m]} fails {len(failing[m])}" for m in methods if failing[m]]
    count = len({e["row"] for e in entries if e["method"] in methods})
    # The names have commas of their own.
    passed = [f"{name} passes all" for name in clean]
    return f"Of {count} rows with a test: {'; '.join(passed + rest)}.\n"


def explanations(entries, methods):
    for m in methods:
        reasons = {}
        for e in entries:
            if e["method"] == m and e["verdict"] != "pass":
                reasons.setdefault(e["reason"], []).append(e)
        if not reasons:
            yield f"- **{TITLES[m]}**: nothing."
        for reason, failing in reasons.items():
            rows = listing([f"{e['row']} ({e['failure'].lower()}, {percent(e)})" for e in failing])
            yield f"- **{TITLES[m]}**, row{'s' * (len(failing) > 1)} {rows}: {reason}."


def notes(entries, methods):
    """What the tests tell besides, each note once with the methods that it holds for."""
    for number in sorted({int(e["row"]) for e in entries}):
        told = {}
        for e in entries:
            if int(e["row"]) == number and e["note"] and e["method"] in methods:
                told.setdefault(e["note"], []).append(TITLES[e["method"]])
        for note, names in told.items():
            who = "all" if len(names) == len(methods) else "; ".join(names)
            yield f"- Row {number}, {who}: {note}."


def leak_table(leaks):
    methods = [method for method in TITLES if any(line["method"] == method for line in leaks)]
    by_mesh = {}
    for line in leaks:
        by_mesh.setdefault(line["mesh"], {})[line["method"]] = line
    yield "| Mesh | " + " | ".join(TITLES.get(m, m) for m in methods) + " |"
    yield "|---|" + "---|" * len(methods)
    for mesh, lines in by_mesh.items():
        cells = [f"{lines[m]['leaks']:,} of {lines[m]['rays']:,}" if m in lines else "" for m in methods]
        yield f"| {mesh} | " + " | ".join(cells) + " |"


def markdown(entries, leaks):
    present = {e["method"] for e in entries}
    methods = [m for m in TITLES if m in present]
    rows = {}
    for e in entries:
        rows.setdefault(int(e["row"]), []).append(e)
    out = [INTRO + summary(entries, methods)]
    out.append("## Methods against rows\n")
    out.append(HOW)
    out.append("| # | Failure | " + " | ".join(TITLES[m] for m in methods) + " |")
    out.append("|---|---|" + "---|" * len(methods))
    for number in sorted(rows):
        by_method = {e["method"]: e for e in rows[number]}
        if set(by_method) != {"none"}:
            out.append(f"| {number} | {rows[number][0]['failure']} | " +
                       " | ".join(cell(by_method.get(m)) for m in methods) + " |")
    out.append("\n## What the rows are\n")
    out.append("| # | Input | Passes if |")
    out.append("|---|---|---|")
    for number in sorted(rows):
        e = rows[number][0]
        if e["method"] != "none":
            out.append(f"| {number} | {e['input'] or e['failure']} | {e['criterion']} |")
    out.append("\n## What fails, and why\n")
    out.extend(explanations(entries, methods))
    out.append("\n## What the tests tell besides\n")
    out.extend(notes(entries, methods))
    if leaks:
        out.append("\n## Leaks\n")
        out.append("Rays from inside closed meshes at edge midpoints, other points of edges, and vertices, that left "
                   "the mesh without a hit (`build/tests/stability/count_leaks`).\n")
        out.extend(leak_table(leaks))
    out.append("\n## A failure, magnified\n")
    out.append("![Leaks at an edge and at a vertex](images/leak.png)\n")
    out.append("An edge (above) and a vertex (below) of a closed icosphere seen from inside, magnified until a pixel is "
               "half an ulp of the coordinates wide. Yellow rays leak. Left the kd-tree with Möller-Trumbore's test, in "
               "the middle Embree's fast mode, right the kd-tree with the watertight test. Drawn by "
               "`tests/stability/leak_picture.cpp`.\n")
    out.append("## Rows without a test\n")
    for number in sorted(rows):
        for e in rows[number]:
            if e["method"] == "none":
                out.append(f"- {number}, {e['failure'].lower()} ({e['input']}): {e['reason']}.")
    out.append("\n## Runs\n")
    runs = sorted({(e["date"], e["commit"], e["device"], e["full"]) for e in entries if e["method"] != "none"})
    for date, commit, device, full in runs:
        covered = [TITLES[m] for m in methods
                   if any((e["date"], e["commit"], e["device"]) == (date, commit, device) and e["method"] == m
                          for e in entries)]
        kind = "full counts" if full == "1" else "counts of the CI run"
        out.append(f"- {date}, commit {commit}, {device}, {kind}: {', '.join(covered)}.")
    return "\n".join(out) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--results", type=pathlib.Path, required=True, help="what GPURT_STABILITY_RESULTS named")
    parser.add_argument("--leaks", type=pathlib.Path, help="output of count_leaks")
    parser.add_argument("--picture", type=pathlib.Path, help="output of leak_picture")
    parser.add_argument("--device", required=True)
    parser.add_argument("--commit", required=True)
    parser.add_argument("--full", default="0")
    args = parser.parse_args()

    docs = ROOT / "docs"
    (docs / "images").mkdir(exist_ok=True)
    new = read_csv(args.results, FIELDS[:10])
    if not new:
        raise SystemExit(f"{args.results}: no results")
    date = datetime.date.today().isoformat()
    for e in new:
        e.update(date=date, commit=args.commit, device=args.device, full=args.full)
    entries = {(int(e["row"]), e["method"]): e for e in read_csv(docs / "stability.csv", FIELDS)}
    # A row that has a test now is no longer one without.
    tested = {int(e["row"]) for e in new if e["method"] != "none"}
    entries = {key: e for key, e in entries.items() if not (key[1] == "none" and key[0] in tested)}
    entries.update({(int(e["row"]), e["method"]): e for e in new})
    order = {m: i for i, m in enumerate(TITLES)}
    ordered = [entries[key] for key in sorted(entries, key=lambda k: (k[0], order.get(k[1], 99)))]
    with (docs / "stability.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, FIELDS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(ordered)

    leaks_path = docs / "stability_leaks.json"
    leaks = json.loads(leaks_path.read_text()) if leaks_path.exists() else []
    if args.leaks:
        fresh = [json.loads(line) for line in args.leaks.read_text().splitlines() if line.startswith("{")]
        names = {line["method"] for line in fresh}
        leaks = [line for line in leaks if line["method"] not in names] + fresh
        leaks_path.write_text(json.dumps(leaks, indent=1) + "\n")
    if args.picture:
        write_png(args.picture, docs / "images" / "leak.png")
    (docs / "stability.md").write_text(markdown(ordered, leaks), encoding="utf-8")


if __name__ == "__main__":
    main()
