"""Keeps what `scripts/gpu run` wrote as bench/results/DATE-DEVICE-COMMIT.json: verdicts of tests, of Python's too, reference
images and the sanitizer, and every line of the benchmarks. Rows of the failure catalogue go to docs/stability.md.

    scripts/gpu keep DIR    DIR: where the run wrote, its $OUT
"""

import collections
import json
import pathlib
import re
import subprocess
import sys


def read(folder, name):
    path = folder / name
    return json.loads(path.read_text()) if path.exists() else None


def main():
    if len(sys.argv) != 2 or not pathlib.Path(sys.argv[1]).is_dir():
        sys.exit("usage: scripts/gpu keep DIR, a folder that scripts/gpu run wrote")
    folder = pathlib.Path(sys.argv[1])
    parts = {name: read(folder, f"{name}.json") for name in ("tests", "python", "references", "sanitizer")}
    about = next((part for part in parts.values() if part), None)
    if about is None:
        sys.exit(f"{folder} has none of {', '.join(f'{name}.json' for name in parts)}")
    result = {key: about[key] for key in ("commit", "date", "device")}
    for name in ("tests", "python"):
        if not parts[name]:
            continue
        tests = parts[name]["tests"]
        result[name] = {"counts": dict(collections.Counter(t["result"] for t in tests)),
                        "not_passed": [t["test"] for t in tests if t["result"] != "passed"]}
        if name == "python":
            result[name]["packages"] = parts[name]["packages"]
    if parts["references"]:
        result["references"] = {"samples_per_pixel": parts["references"]["samples_per_pixel"],
                                "cases": [{"result": c["result"], "line": c.get("line", c["test"])}
                                          for c in parts["references"]["cases"]]}
    if parts["sanitizer"]:
        result["sanitizer"] = [{key: r[key] for key in ("tool", "program", "result", "summary")}
                               for r in parts["sanitizer"]["runs"]]
    lines = folder / "bench.jsonl"
    result["bench"] = [json.loads(line) for line in lines.read_text().splitlines()] if lines.exists() else []
    device = re.sub(r"[^a-z0-9]+", "-", about["device"].split(",")[0].lower()).strip("-")
    path = pathlib.Path("bench/results") / f"{about['date'][:10]}-{device}-{about['commit']}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    partial.write_text(json.dumps(result, indent=1) + "\n")
    partial.rename(path)
    print(path)
    if (folder / "stability.csv").exists():
        subprocess.run([sys.executable, "tests/stability/report.py", "--results", folder / "stability.csv", "--device",
                        about["device"].split(",")[0], "--commit", about["commit"],
                        "--full", str(int(about.get("full", False)))], check=True)
        print("docs/stability.md")


if __name__ == "__main__":
    main()
