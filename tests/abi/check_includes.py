"""The include lines keep to the cut of the library.

include/             includes no other part of the project
lib/core             includes only lib/core
lib/cpu, lib/cuda    include lib/*.h (backend.h), lib/core, lib/accel and what backend.h brings; never each other
lib/multi            includes lib/*.h and what backend.h brings: it joins backends, whatever they are
lib/api/registry.cpp alone includes a backend
tools, bindings, tests, examples, bench   include include/ and what lies in their own folder; tests/unit may
                     also include lib
"""

import pathlib
import re
import sys

BACKENDS = {"cpu", "cuda"}
SUFFIXES = {".c", ".h", ".cpp", ".hpp", ".cu", ".cuh", ".inl"}
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]', re.M)

# Which parts of lib, or single files, a part may include beside its own files and those directly in lib/.
BROUGHT_BY_BACKEND = {"core", "frame/film.h", "scene/compiled_scene.h", "scene/scene_data.h"}
ALLOWED = {
    "": BROUGHT_BY_BACKEND,
    "core": set(),
    "accel": BROUGHT_BY_BACKEND,
    "cpu": BROUGHT_BY_BACKEND | {"accel"},
    "cuda": BROUGHT_BY_BACKEND | {"accel"},
    "multi": BROUGHT_BY_BACKEND,
    "frame": {"core", "image", "scene/emission_table.h"},
    "image": {"core"},
    "scene": {"core", "image"},
    "planner": {"core", "frame", "scene"},
    "api": {"accel", "core", "frame", "image", "multi", "planner", "scene"},
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
        if part not in ALLOWED:
            return f"lib/{part} has no rule yet: say in {pathlib.Path(__file__).name} what it may include"
        if part == "core":
            return "lib/core includes only lib/core"
        if target_part in BACKENDS:
            is_registry = source.relative_to(root).as_posix() == "lib/api/registry.cpp"
            return None if is_registry else "only lib/api/registry.cpp names a backend"
        name = target.relative_to(root / "lib").as_posix()
        if target_part == "" or target_part in ALLOWED[part] or name in ALLOWED[part]:
            return None
        return f"lib/{part or source.name} may not include lib/{name}"
    if target_top == "lib":
        if (top, part) == ("tests", "unit"):
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
                    if quote == '"' and name.split("/")[0] in ALLOWED:
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
