"""Runs the CUDA tests and the benchmarks of .gpu/tree, and keeps what they say as JSON.

Writes tests.json, bench.jsonl (one line a case) and log.txt into $OUT. Fails if a CUDA test failed or was
skipped, if none ran, or if a benchmark failed.
"""

import argparse
import datetime
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

TREE = pathlib.Path(".gpu/tree")
# What gpurt_add_test (tests/CMakeLists.txt) calls a CUDA test.
CUDA_FILTER = "*cuda*:*Cuda*:*CUDA*"


def run(command, log, timeout):
    """Runs a command; returns (exit status, what it printed). 124 where it ran past the timeout."""
    log.write(f"$ {' '.join(map(str, command))}\n")
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                              errors="replace", timeout=timeout)
        status, text = done.returncode, done.stdout
    except subprocess.TimeoutExpired as expired:
        status, text = 124, (expired.stdout or b"").decode(errors="replace") + "\ntimed out\n"
    log.write(text + "\n")
    log.flush()
    return status, text


def device():
    query = ["nvidia-smi", "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader"]
    try:
        return subprocess.run(query, capture_output=True, text=True, timeout=60).stdout.strip()
    except (OSError, subprocess.TimeoutExpired):
        return ""


def run_tests(program, test_filter, log, timeout):
    """The tests of one program as dictionaries; a program that crashed is a failed test of its own."""
    name = program.relative_to(TREE / "tests").as_posix()
    with tempfile.TemporaryDirectory() as folder:
        report = pathlib.Path(folder) / "report.json"
        status, text = run([program, f"--gtest_filter={test_filter}", f"--gtest_output=json:{report}"], log, timeout)
        suites = json.loads(report.read_text())["testsuites"] if report.exists() else []
    tests = []
    for suite in suites:
        for test in suite["testsuite"]:
            if test["status"] != "RUN":
                continue
            result = "failed" if test.get("failures") else "passed"
            if test["result"] == "SKIPPED":
                result = "skipped"
            message = "\n".join(failure["failure"] for failure in test.get("failures", []))
            tests.append({"program": name, "test": f"{suite['name']}.{test['name']}", "result": result,
                          "seconds": float(test["time"].rstrip("s")), "message": message})
    if status != 0 and not any(test["result"] == "failed" for test in tests):
        tests.append({"program": name, "test": "(the program)", "result": "failed", "seconds": 0.0,
                      "message": f"exit status {status}\n{text[-2000:]}"})
    return tests


def main():
    parser = argparse.ArgumentParser(prog="scripts/gpu run", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--filter", default=CUDA_FILTER, help="GoogleTest filter (default: %(default)s)")
    parser.add_argument("--no-tests", action="store_true")
    parser.add_argument("--no-bench", action="store_true")
    parser.add_argument("--bench-args", default="", help="options for the benchmark programs, separated by spaces")
    parser.add_argument("--timeout", type=float, default=240, help="seconds for one program (default: %(default)s)")
    args = parser.parse_args()

    out = pathlib.Path(os.environ.get("OUT") or ".gpu/out")
    out.mkdir(parents=True, exist_ok=True)
    about = {"commit": (TREE / "commit").read_text().strip(), "device": device(),
             "date": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds")}
    print(f"{about['device'] or 'no GPU found'}; commit {about['commit']}", flush=True)
    tests, ok = [], True

    with open(out / "log.txt", "w", encoding="utf-8") as log:
        if not args.no_tests:
            for program in sorted(p for p in (TREE / "tests").glob("*/*") if p.is_file()):
                start = time.monotonic()
                found = run_tests(program, args.filter, log, args.timeout)
                tests += found
                for test in found:
                    if test["result"] != "passed":
                        print(f"{test['result']}: {test['program']}: {test['test']}\n{test['message']}", flush=True)
                print(f"{program.relative_to(TREE)}: {len(found)} tests, {time.monotonic() - start:.1f} s", flush=True)
            (out / "tests.json").write_text(json.dumps({**about, "tests": tests}, indent=1) + "\n")
        if not args.no_bench:
            with open(out / "bench.jsonl", "w", encoding="utf-8") as results:
                for program in sorted(p for p in (TREE / "bench").glob("*") if p.is_file()):
                    status, text = run([program, *args.bench_args.split()], log, args.timeout)
                    lines = [line for line in text.splitlines() if line.startswith("{")]
                    results.writelines(line + "\n" for line in lines)
                    print("\n".join(lines), flush=True)
                    if status != 0:
                        ok = False
                        print(f"failed: {program.relative_to(TREE)}: exit status {status}\n{text[-2000:]}", flush=True)

    count = {result: sum(test["result"] == result for test in tests) for result in ("passed", "failed", "skipped")}
    if not args.no_tests:
        print(f"{count['passed']} passed, {count['failed']} failed, {count['skipped']} skipped")
        ok = ok and count["passed"] > 0 and count["failed"] == 0 and count["skipped"] == 0
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
