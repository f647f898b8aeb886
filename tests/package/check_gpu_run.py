"""Checks what scripts/gpu_run.py says of tests that were not run, on programs that only look like tests.

usage: check_gpu_run.py REPOSITORY
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile

# Prints what a GoogleTest program does. The second test takes longer than any budget given below.
PROGRAM = """#!/usr/bin/env python3
import sys, time
tests = {"CudaFirst.IsQuick": 0, "CudaSecond.IsSlow": 60, "CudaThird.IsQuick": 0}
chosen = next(a.split("=", 1)[1] for a in sys.argv if a.startswith("--gtest_filter="))
if "--gtest_list_tests" in sys.argv:
    for name in tests:
        suite, test = name.split(".")
        print(f"{suite}.\\n  {test}")
    sys.exit()
for name, seconds in tests.items():
    if name not in chosen.split(":"):
        continue
    print(f"[ RUN      ] {name}", flush=True)
    time.sleep(seconds)
    print(f"[       OK ] {name} (0 ms)", flush=True)
"""


def run(repository, folder, *options):
    environment = {**os.environ, "OUT": str(folder / "out"), "PATH": f"{pathlib.Path(sys.executable).parent}:/usr/bin:/bin"}
    environment.pop("SANITIZER", None)
    done = subprocess.run([sys.executable, repository / "scripts" / "gpu_run.py", *options], cwd=folder, env=environment,
                          capture_output=True, text=True, timeout=120)
    return done.returncode, done.stdout + done.stderr


def main():
    repository = pathlib.Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        tests = folder / ".gpu" / "tree" / "tests" / "cuda"
        tests.mkdir(parents=True)
        (folder / ".gpu" / "tree" / "commit").write_text("0\n")
        program = tests / "fake"
        program.write_text(PROGRAM)
        program.chmod(0o755)

        # The time that all may take ends in the second test: no test failed.
        status, text = run(repository, folder, "--stages", "tests", "--budget", "8")
        assert status == 1, text
        results = {t["test"]: (t["result"], t["seconds"])
                   for t in json.loads((folder / "out" / "tests.json").read_text())["tests"]}
        assert results == {"CudaFirst.IsQuick": ("passed", 0.0), "CudaSecond.IsSlow": ("not run", 0.0),
                           "CudaThird.IsQuick": ("not run", 0.0)}, results

        # A test that takes too long for one program failed, and the others go on.
        status, text = run(repository, folder, "--stages", "tests", "--timeout", "2")
        assert status == 1, text
        results = {t["test"]: t["result"] for t in json.loads((folder / "out" / "tests.json").read_text())["tests"]}
        assert results == {"CudaFirst.IsQuick": "passed", "CudaSecond.IsSlow": "failed",
                           "CudaThird.IsQuick": "passed"}, results

        # A Python package that was asked for and cannot be linked.
        status, text = run(repository, folder, "--stages", "python")
        assert status == 1 and "no .gpu/tree/lib/libgpurt.so.0" in text and "0 passed" in text, text

        # A sanitizer that was asked for and is not there.
        if not pathlib.Path("/usr/local/cuda/bin/compute-sanitizer").exists():
            status, text = run(repository, folder, "--stages", "sanitizer")
            assert status == 1 and "no compute-sanitizer" in text, text


if __name__ == "__main__":
    main()
