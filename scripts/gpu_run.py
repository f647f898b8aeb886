"""Runs the CUDA tests, the Python package's tests of GPU arrays, the reference images, the sanitizer and the benchmarks of
.gpu/tree, and keeps what they say.

Writes tests.json, stability.csv (rows of the failure catalogue), python.json, references.json, sanitizer.json, bench.jsonl (one
line a case) and log.txt into $OUT. The Python package is compiled where there is what that needs (scripts/gpu_python.py). Reference
images need the folder of the scenes: --scenes, or $GPURT_TEST_SCENES, or .gpu/scenes, shared/scenes or
../shared/scenes where one of these is there. The sanitizer needs compute-sanitizer, on the PATH, in /usr/local/cuda/bin
or where $SANITIZER says. Fails if a test or a benchmark failed, if a CUDA test was skipped, if none ran, if the time that
was given ended before all had run, or if --stages names the sanitizer or python and there is not what it needs.
"""

import argparse
import collections
import concurrent.futures
import datetime
import importlib.metadata
import itertools
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import threading
import time
import xml.etree.ElementTree

TREE = pathlib.Path(".gpu/tree")
# What gpurt_add_test (tests/CMakeLists.txt) calls a CUDA test.
CUDA_FILTER = "*cuda*:*Cuda*:*CUDA*"
# Those that need two devices.
PAIR_FILTER = "CudaPair.*"
REFERENCES = TREE / "tests" / "image" / "test_references"
SCENE_FOLDERS = (".gpu/scenes", "shared/scenes", "../shared/scenes")
# What ended because there was no time left for anything, rather than by itself or after too long a time of its own.
OUT_OF_TIME = 125
# What scripts/gpu_python.py ends with where the machine cannot build the extension.
PYTHON_MISSING = 77
# What the sanitizer looks at: every kernel, in the short form of the tests (GPURT_TEST_SHORT).
SANITIZED = {
    # Of a bvh it is an error that is asked for.
    "conformance/test_hits": "Meshes/*Hits.*/cuda_*-Meshes/Hits.Imported*/cuda_bvh_*",
    "conformance/test_photons": "Cuda*Nearest*:Cuda*NoneInAn*:Cuda*Chooses*:Cuda*File*",
    "cuda/cuda_device": "CudaDevice.SaysWhy*:CudaDevice.TakesThe*:CudaDevice.ChoosesThe*:CudaMemory.RunsOutAtTheLimit*:"
                        "CudaMemory.OfLittle*:CudaMemory.IsGivenBack:CudaThreads.*",
    "cuda/cuda_device_memory": f"*Cuda*-{PAIR_FILTER}:CudaPointers.ToHost*",
    "cuda/cuda_films": "CudaFilms.*",
    "cuda/cuda_hits": "Scenes/CudaHits.*:CudaTrees.*:CudaStacks.*:CudaFast*:CudaCoherence.*:CudaGrazing.*",
    "cuda/cuda_images": "CudaImages.Of*:CudaImages.AreTheSameInLittleMemory",
    "cuda/cuda_photon_images": "CudaPhotonImages.Of*:CudaPhotonImages.AreTheSameInLittleMemory",
    "cuda/cuda_photon_memory": "CudaPhotonMemory.Gives*",
    "cuda/cuda_reyes": "CudaReyes.Of*:CudaReyes.At*:CudaReyes.IsTheSameInLittleMemory:CudaReyesBlending.Of*:"
                       "CudaReyesBlending.IsTheSameInLittleMemory:CudaReyesSchedules.Give*:CudaReyesSchedules.GoOn*:"
                       "CudaReyesSlots.HaveThe*:CudaReyesRayLight.Of*",
    "cuda/cuda_schedules": "CudaSchedules.OfQueries*:CudaSchedules.OfRenders*:CudaSchedules.CountLanes*:"
                           "CudaSchedules.PoolsRefill*",
    "unit/test_device_bvh": "CudaBvh.*-CudaBvh.EndWhere*:CudaBvh.AreTheSame*",
    "unit/test_device_kd": "CudaKd.*-CudaKd.AreTheSame*:CudaKd.Cost*",
    "unit/test_device_pool": "CudaPool.*",
}
# Races are looked for, at some fifty times the run time, where threads of a block share memory: warps that refill, packets
# and the uber-kernel, builders, queues of paths and photons, REYES with its fragments and splits, lanes that are counted. Not
# REYES' uber-kernel: its rooms go from warp to warp by atomic operations and fences, which racecheck does not follow.
RACE_CHECKED = {
    "conformance/test_photons": "Cuda*Nearest*",
    "cuda/cuda_hits": "Scenes/CudaHits.*:CudaTrees.*:CudaStacks.*:CudaCoherence.*:CudaGrazing.*",
    "cuda/cuda_images": "CudaImages.OfACornellBox*:CudaImages.AreTheSameInLittleMemory",
    "cuda/cuda_photon_images": "CudaPhotonImages.OfACornellBox*",
    "cuda/cuda_reyes": "CudaReyes.OfCoincident*:CudaReyesBlending.OfShells*",
    "cuda/cuda_schedules": "CudaSchedules.OfQueriesGive*:CudaSchedules.CountLanes*",
    "unit/test_device_bvh": "CudaBvh.HaveNoNodes*:CudaBvh.KeepThe*",
    "unit/test_device_kd": "CudaKd.HaveNoNodes*:CudaKd.KeepThe*",
}


class Run:
    """What all stages use: the log, the time that is left, the verdict."""

    def __init__(self, out, budget, jobs, full):
        self.out = out
        self.log = open(out / "log.txt", "w", encoding="utf-8")
        self.end = time.monotonic() + budget
        self.jobs = jobs
        self.full = full
        self.lock = threading.Lock()
        self.ok = True

    def left(self):
        return max(self.end - time.monotonic(), 0.0)

    def command(self, command, timeout, **environment):
        """Runs a command; returns (exit status, what it printed, seconds). 124 where it ran past the timeout, OUT_OF_TIME
        where that was all the time left."""
        start = time.monotonic()
        left = self.left()
        try:
            done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                                  errors="replace", timeout=max(min(timeout, left), 1.0),
                                  env={**os.environ, **environment})
            status, text = done.returncode, done.stdout
        except subprocess.TimeoutExpired as expired:
            status = OUT_OF_TIME if left < timeout else 124
            text = (expired.stdout or b"").decode(errors="replace") + "\ntimed out\n"
        with self.lock:
            self.log.write(f"$ {' '.join(f'{k}={v}' for k, v in environment.items())} {' '.join(map(str, command))}\n"
                           f"{text}\nexit status {status}\n")
            self.log.flush()
        return status, text, time.monotonic() - start

    def spread(self, function, work):
        """Calls function(item) for every item, as many at a time as there are jobs."""
        with concurrent.futures.ThreadPoolExecutor(self.jobs) as pool:
            for done in [pool.submit(function, item) for item in work]:
                done.result()

    def write(self, name, about, key, values):
        (self.out / name).write_text(json.dumps({**about, key: values}, indent=1) + "\n")


def device():
    query = ["nvidia-smi", "--query-gpu=name,driver_version,memory.total", "--format=csv,noheader"]
    try:
        return subprocess.run(query, capture_output=True, text=True, timeout=60).stdout.strip()
    except (OSError, subprocess.TimeoutExpired):
        return ""


def find_program(name):
    return shutil.which(name) or shutil.which(name, path="/usr/local/cuda/bin")


def list_tests(program, test_filter):
    text = subprocess.run([program, "--gtest_list_tests", f"--gtest_filter={test_filter}"], capture_output=True,
                          text=True, check=True, timeout=120).stdout
    tests, suite = [], ""
    for line in text.splitlines():
        name = line.split("#")[0].rstrip()
        if name.startswith("  "):
            tests.append(suite + name.strip())
        elif name.endswith("."):
            suite = name
    return tests


def results_in(text):
    """The tests that a GoogleTest program told of: (name, result, seconds, what it printed), then those that began
    and did not end, with seconds None."""
    found, name, lines = [], None, []
    for line in text.splitlines():
        begin = re.match(r"\[ RUN      \] (\S+)", line)
        end = re.match(r"\[ +(OK|FAILED|SKIPPED) +\] (\S+?),? .*\((\d+) ms\)$", line)
        if begin:
            name, lines = begin[1], []
        elif end and end[2] == name:
            result = {"OK": "passed", "FAILED": "failed", "SKIPPED": "skipped"}[end[1]]
            found.append((name, result, int(end[3]) / 1000, "\n".join(lines)))
            name = None
        elif name is not None:
            lines.append(line)
    if name is not None:
        found.append((name, "failed", None, "\n".join(lines)))
    return found


def backtrace(run, program, test):
    """Where a test crashes, if there is a debugger."""
    debugger = find_program("gdb") or find_program("cuda-gdb")
    if debugger is None:
        return "no debugger found"
    _, text, _ = run.command([debugger, "-batch", "-ex", "run", "-ex", "thread apply all bt 24", "--args", program,
                              f"--gtest_filter={test}"], 120)
    return text[-6000:]


def run_tests(run, program, test_filter, timeout):
    """The tests of one program as dictionaries. After a crash, or a test that takes too long, the next ones go on."""
    name = program.relative_to(TREE / "tests").as_posix()
    tests = []

    def add(test, result, seconds, message):
        tests.append({"program": name, "test": test, "result": result, "seconds": seconds, "message": message})
        if result != "passed":
            print(f"{result}: {name}: {test}\n{message[-4000:]}", flush=True)

    try:
        left = list_tests(program, test_filter)
    except (OSError, subprocess.SubprocessError) as error:
        add("(the program)", "failed", 0.0, f"cannot list its tests: {error}")
        return tests
    while left:
        if run.left() < 5:
            for test in left:
                add(test, "not run", 0.0, "no time left")
            break
        # Line by line, so that what a test printed is there when it crashes.
        by_line = ["stdbuf", "-oL"] if shutil.which("stdbuf") else []
        status, text, seconds = run.command([*by_line, program, f"--gtest_filter={':'.join(left)}"], timeout,
                                            GPURT_STABILITY_RESULTS=str((run.out / "stability.csv").resolve()),
                                            GPURT_STABILITY_FULL=str(int(run.full)))
        done = results_in(text)
        for test, result, test_seconds, printed in done:
            if test_seconds is None and status == OUT_OF_TIME:
                add(test, "not run", 0.0, f"no time left: cut off after {seconds:.0f} s of the program")
                continue
            if test_seconds is None:
                printed += f"\nthe program ended here: exit status {status}\n"
                if status < 0:
                    printed += backtrace(run, program, test)
            # What passing tests print tells how long things took; of the others all is kept.
            add(test, result, test_seconds if test_seconds is not None else seconds,
                printed[-2000:] if result == "passed" else printed)
        before = len(left)
        names = {test for test, *_ in done}
        left = [test for test in left if test not in names]
        if status == OUT_OF_TIME:
            continue
        if len(left) == before or (status != 0 and not left and all(r == "passed" for _, r, _, _ in done)):
            add("(the program)", "failed", seconds, f"exit status {status}\n{text[-2000:]}")
            break
    return tests


def stage_tests(run, about, args):
    tests = []
    test_filter = args.filter
    if len(about["device"].splitlines()) < 2 and "-" not in test_filter:
        test_filter += f"-{PAIR_FILTER}"
        print(f"one device: {PAIR_FILTER} is left out", flush=True)
    (run.out / "stability.csv").unlink(missing_ok=True)  # tests append to it

    def parts_of(program):
        """Its tests, or where full counts take their time those of one method of the failure catalogue each."""
        if not (args.full and program.name == "test_stability"):
            return [(program, test_filter)]
        methods = collections.defaultdict(list)
        for test in list_tests(program, test_filter):
            methods[test.rpartition("/")[2]].append(test)
        return [(program, ":".join(names)) for names in methods.values()]

    def run_part(part):
        program, part_filter = part
        start = time.monotonic()
        found = run_tests(run, program, part_filter, args.timeout)
        with run.lock:
            tests.extend(found)
            print(f"{program.relative_to(TREE)}: {len(found)} tests, {time.monotonic() - start:.1f} s", flush=True)
            run.write("tests.json", about, "tests", tests)

    # Those of lib/cuda first: they take longest.
    programs = sorted((p for p in (TREE / "tests").glob("*/*") if p.is_file() and p != REFERENCES),
                      key=lambda p: (p.parent.name != "cuda", p))
    run.spread(run_part, [part for program in programs for part in parts_of(program)])
    count = {result: sum(test["result"] == result for test in tests)
             for result in ("passed", "failed", "skipped", "not run")}
    print(", ".join(f"{n} {result}" for result, n in count.items()), flush=True)
    run.ok = run.ok and count["passed"] > 0 and count["passed"] == len(tests)


def version_of(package):
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def stage_python(run, about, args):
    """The Python package's tests of arrays on a GPU, with an extension that is compiled here."""
    junit = run.out / "python.xml"
    junit.unlink(missing_ok=True)
    tests = pathlib.Path("bindings/python/tests")
    status, text, _ = run.command([sys.executable, pathlib.Path(__file__).with_name("gpu_python.py"), "--tree", TREE, "-q",
                                   f"--junit-xml={junit}", tests / "test_interop.py", tests / "test_photons.py"],
                                  args.timeout, PYTHONDONTWRITEBYTECODE="1")
    cases = []
    for case in xml.etree.ElementTree.parse(junit).iter("testcase") if junit.exists() else ():
        kinds = {child.tag for child in case}
        result = "failed" if kinds & {"failure", "error"} else "skipped" if "skipped" in kinds else "passed"
        cases.append({"test": case.get("name"), "result": result, "seconds": float(case.get("time"))})
    packages = {name: version_of(name) for name in ("numpy", "torch", "cupy-cuda13x", "cupy-cuda12x", "jax", "pybind11")}
    run.write("python.json", {**about, "packages": {name: v for name, v in packages.items() if v}}, "tests", cases)
    missing = status == PYTHON_MISSING and not cases
    if missing or status != 0:
        print(text[-4000:], flush=True)
        run.ok = run.ok and missing and args.stages is None
    print(", ".join(f"{sum(c['result'] == r for c in cases)} {r}" for r in ("passed", "failed", "skipped")), flush=True)


def stage_references(run, about, args):
    """Every reference scene, rendered on the GPU at many samples: a process each, so that what is done is kept."""
    folders = [args.scenes] if args.scenes else [os.environ.get("GPURT_TEST_SCENES"), *SCENE_FOLDERS]
    scenes = next((pathlib.Path(f).resolve() for f in folders if f and pathlib.Path(f).is_dir()), None)
    if scenes is None or not REFERENCES.exists():
        if args.scenes:
            run.ok = False
        print(f"no reference images: {'no ' + str(REFERENCES) if scenes else 'no folder of scenes found'}", flush=True)
        return
    cases = []
    for test in list_tests(REFERENCES, "*"):
        if run.left() < 5:
            cases.append({"test": test, "result": "not run", "message": "no time left"})
            run.ok = False
            run.write("references.json", {**about, "samples_per_pixel": args.spp}, "cases", cases)
            continue
        status, text, seconds = run.command([REFERENCES, f"--gtest_filter={test}"], args.timeout,
                                            GPURT_TEST_DEVICE="cuda", GPURT_TEST_SPP=str(args.spp),
                                            GPURT_TEST_SCENES=str(scenes))
        lines = [line for line in text.splitlines() if " spp: relMSE " in line]
        skipped = "[  SKIPPED ]" in text
        result = ("not run" if status == OUT_OF_TIME else
                  "skipped" if skipped else "passed" if status == 0 else "failed")
        cases.append({"test": test, "result": result, "seconds": round(seconds, 2), "line": "\n".join(lines),
                      "message": "" if result == "passed" else text[-2000:]})
        print(f"{result}: {lines[0] if lines else test} ({seconds:.1f} s)", flush=True)
        if status != 0 and not lines:
            print(text[-2000:], flush=True)
        run.ok = run.ok and status == 0
        run.write("references.json", {**about, "samples_per_pixel": args.spp}, "cases", cases)


def stage_sanitizer(run, about, args):
    sanitizer = os.environ.get("SANITIZER") or find_program("compute-sanitizer")
    if sanitizer is None:
        print("no compute-sanitizer found", flush=True)
        run.write("sanitizer.json", about, "runs", [])
        run.ok = run.ok and args.stages is None
        return
    results = []

    def sanitize(item):
        tool, name, test = item
        program = TREE / "tests" / name
        status, text, seconds = OUT_OF_TIME, "", 0.0
        if run.left() >= 5:
            # Line by line, so that what it did is there when it is cut off. Memory that the pool of a limit refuses is how
            # the library learns to take less: no error, though the driver's call returns one.
            by_line = ["stdbuf", "-oL"] if shutil.which("stdbuf") else []
            status, text, seconds = run.command(
                [*by_line, sanitizer, "--tool", tool, "--error-exitcode", "97",
                 *(["--report-api-errors", "no"] if tool == "memcheck" else []), program,
                 f"--gtest_filter={test}"], args.timeout, GPURT_TEST_SHORT="1")
        summary = " ".join(line for line in text.splitlines() if "ERROR SUMMARY" in line or "RACECHECK SUMMARY" in line)
        ended = [result for _, result, test_seconds, _ in results_in(text) if test_seconds is not None]
        result = "not run" if status == OUT_OF_TIME else "passed" if status == 0 and ended == ["passed"] else "failed"
        with run.lock:
            results.append({"tool": tool, "program": name, "test": test, "result": result, "exit_status": status,
                            "summary": summary, "seconds": round(seconds, 1),
                            "message": "" if result == "passed" else text[:8000]})
            print(f"{result}: {tool} over {name}: {test}, {seconds:.1f} s; {summary}", flush=True)
            if result == "failed":
                print(text[:4000], flush=True)
            run.ok = run.ok and result == "passed"
            run.write("sanitizer.json", about, "runs", results)

    # A test each, so that many go at a time; by turns from the programs, since their first tests tend to take longest.
    work = []
    for tool in args.sanitizer_tools.split(","):
        chosen = RACE_CHECKED if tool in ("racecheck", "synccheck") else SANITIZED
        tests = [[(tool, name, test) for test in list_tests(TREE / "tests" / name, chosen[name])] for name in chosen]
        work += [item for turn in itertools.zip_longest(*tests) for item in turn if item is not None]
    run.spread(sanitize, work)
    print(", ".join(f"{sum(r['result'] == kind for r in results)} {kind}" for kind in ("passed", "failed", "not run")),
          flush=True)


def stage_bench(run, about, args):
    with open(run.out / "bench.jsonl", "w", encoding="utf-8") as results:
        for program in sorted(p for p in (TREE / "bench").glob("*") if p.is_file()):
            status, text, _ = run.command([program, *args.bench_args.split()], args.timeout)
            lines = [line for line in text.splitlines() if line.startswith("{")]
            results.writelines(line + "\n" for line in lines)
            print("\n".join(lines), flush=True)
            if status != 0:
                run.ok = False
                print(f"failed: {program.relative_to(TREE)}: exit status {status}\n{text[-2000:]}", flush=True)


def main():
    stages = {"tests": stage_tests, "python": stage_python, "references": stage_references, "sanitizer": stage_sanitizer,
              "bench": stage_bench}
    parser = argparse.ArgumentParser(prog="scripts/gpu run", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stages", help=f"what to run, in order (default: {','.join(stages)})")
    parser.add_argument("--filter", default=CUDA_FILTER, help="GoogleTest filter of the tests (default: %(default)s)")
    parser.add_argument("--full", action="store_true",
                        help="the counts that the failure catalogue names, in place of a CI run's; minutes instead of seconds")
    parser.add_argument("--scenes", help="folder of the reference scenes")
    parser.add_argument("--spp", type=int, default=4096, help="samples of a reference image (default: %(default)s)")
    parser.add_argument("--sanitizer-tools", default="memcheck,initcheck,racecheck",
                        help="of memcheck, racecheck, initcheck, synccheck (default: %(default)s)")
    parser.add_argument("--bench-args", default="", help="options for the benchmark programs, separated by spaces")
    parser.add_argument("--timeout", type=float, default=240, help="seconds for one program (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=1,
                        help="programs of tests or the sanitizer at a time; benchmarks run alone. They share the device's memory: "
                             "a test that wants a large batch in one launch may fail beside one that fills it "
                             "(default: %(default)s)")
    parser.add_argument("--budget", type=float, default=86400, help="seconds for everything")
    args = parser.parse_args()
    chosen = list(stages) if args.stages is None else args.stages.split(",")
    if not set(chosen) <= set(stages):
        parser.error(f"--stages: choose of {', '.join(stages)}")

    out = pathlib.Path(os.environ.get("OUT") or ".gpu/out")
    out.mkdir(parents=True, exist_ok=True)
    run = Run(out, args.budget, args.jobs, args.full)
    about = {"commit": (TREE / "commit").read_text().strip(), "device": device(),
             "date": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"), "full": args.full}
    print(f"{about['device'] or 'no GPU found'}; commit {about['commit']}", flush=True)
    for stage in chosen:
        start = time.monotonic()
        stages[stage](run, about, args)
        print(f"== {stage}: {time.monotonic() - start:.1f} s", flush=True)
    return 0 if run.ok else 1


if __name__ == "__main__":
    sys.exit(main())
