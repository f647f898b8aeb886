"""The include lines keep to the cut of the library.

include/   includes no other part of the project
lib/core   includes only lib/core
lib/cpu, lib/cuda   never include each other, nor api, scene, planner or image: lib/backend.h and lib/core only
lib/api    is the only other part that includes a backend, and there only registry.cpp does
tools, bindings, tests, examples, bench   include only include/ and what lies in their own folder;
           tests/unit may also include lib/core
"""

import pathlib
import re
import sys

BACKENDS = {"cpu", "cuda"}
PARTS = ["api", "scene", "core", "cpu", "cuda", "image", "planner"]
SUFFIXES = {".c", ".h", ".cpp", ".hpp", ".cu", ".cuh", ".inl"}
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]', re.M)

# Which parts of lib a part may include, beside its own files and those directly in lib/.
ALLOWED = {
    "core": set(),
    "cpu": {"core"},
    "cuda": {"core"},
    "image": {"core"},
    "scene": {"core", "image"},
    "planner": {"core", "scene"},
    "api": {"core", "scene", "planner", "image"},
}


def part_of(path, root):
    """('lib', 'cuda') for lib/cuda/..., ('lib', '') for lib/backend.h, ('tests', 'unit'), ('include', '')."""
    parts = path.relative_to(root).parts
    return parts[0], parts[1] if len(parts) > 2 else ""


def resolve(name, source, root):
    """The project file that an include line names, or None for a file from outside."""
    for folder in (source.parent, root / "lib", root / "include"):
        candidate = (folder / name).resolve()
        if candidate.is_file() and root in candidate.parents:
            return candidate
    return None


def problem(source, target, root):
    """What is wrong with source including target, or None."""
    top, part = part_of(source, root)
    target_top, target_part = part_of(target, root)
    if target_top == "include":
        return "lib/core knows no public header" if (top, part) == ("lib", "core") else None
    if top == "include":
        return "a public header includes public headers only"
    if top == "lib":
        if target_top != "lib":
            return f"lib includes nothing of {target_top}"
        if target_part == part:
            return None
        if target_part == "":
            return "lib/core includes only lib/core" if part == "core" else None
        if part == "":
            return f"lib/{source.name} is shared by all parts" if target_part in BACKENDS | {"api"} else None
        if target_part in BACKENDS and part == "api":
            return None if source.name == "registry.cpp" else "only lib/api/registry.cpp names a backend"
        return None if target_part in ALLOWED[part] else f"lib/{part} may not include lib/{target_part}"
    if target_top == "lib":
        if (top, part, target_part) == ("tests", "unit", "core"):
            return None
        return f"{top} uses the public headers only"
    return None if target_top == top else f"{top} includes nothing of {target_top}"


def main():
    root = pathlib.Path(sys.argv[1]).resolve()
    problems, files = [], 0
    for top in ("include", "lib", "tools", "bindings", "tests", "examples", "bench"):
        for source in sorted((root / top).rglob("*")):
            if source.suffix not in SUFFIXES or not source.is_file():
                continue
            files += 1
            for quote, name in INCLUDE.findall(source.read_text(encoding="utf-8")):
                target = resolve(name, source, root)
                if target is None:
                    if quote == '"' and name.split("/")[0] in PARTS:
                        problems.append(f"{source.relative_to(root)}: {name} does not exist")
                    continue
                reason = problem(source, target, root)
                if reason:
                    problems.append(f"{source.relative_to(root)} includes {target.relative_to(root)}: {reason}")
    if not files:
        problems.append(f"no source below {root}")
    if problems:
        sys.exit("\n".join(problems))
    print(f"{files} files keep to the rules")


if __name__ == "__main__":
    main()
