"""Installs a build, moves the tree, and uses it there through find_package and through pkg-config."""

import argparse
import os
import pathlib
import re
import shutil
import subprocess
import sys

# What a bundled tree leaves to the system.
SYSTEM = re.compile(r"^(linux-vdso|ld-linux|lib(c|m|dl|rt|pthread|gcc_s|stdc\+\+)\.so)")


def run(*command, **env):
    """Runs a command and returns what it printed; shows it when the command fails."""
    result = subprocess.run([str(c) for c in command], env={**os.environ, **env},
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if result.returncode:
        sys.exit(f"{' '.join(map(str, command))}\n{result.stdout}")
    return result.stdout


def check_bundle(tree, libdir):
    """Every library that a file of the tree needs lies in the tree, or is one of the system's."""
    files = [libdir / "libgpurt.so", *(p for p in (tree / "bin").glob("*") if p.is_file())]
    for file in files:
        for name, path in re.findall(r"^\s*(\S+)(?: => (.+?))?(?: \(0x\w+\))?$", run("ldd", file), flags=re.M):
            if SYSTEM.match(pathlib.Path(name).name):
                continue
            if not path or libdir not in pathlib.Path(path).resolve().parents:
                sys.exit(f"{file} finds {name} outside the tree: {path}")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cmake", required=True)
    parser.add_argument("--cc", required=True)
    parser.add_argument("--build", required=True, type=pathlib.Path)
    parser.add_argument("--libdir", required=True)
    parser.add_argument("--version", required=True)
    parser.add_argument("--work", required=True, type=pathlib.Path)
    parser.add_argument("--bundle", action="store_true")
    args = parser.parse_args()

    consumer = pathlib.Path(__file__).parent / "consumer"
    tree = args.work / "moved here"
    shutil.rmtree(args.work, ignore_errors=True)
    run(args.cmake, "--install", args.build, "--prefix", args.work / "first")
    (args.work / "first").rename(tree)
    libdir = tree / args.libdir
    os.environ.pop("LD_LIBRARY_PATH", None)
    if args.bundle:
        check_bundle(tree, libdir)

    build = args.work / "find_package"
    run(args.cmake, "-S", consumer, "-B", build, f"-DCMAKE_PREFIX_PATH={tree}", f"-DCMAKE_C_COMPILER={args.cc}")
    run(args.cmake, "--build", build)
    printed = {"find_package": run(build / "consumer")}

    # pkg-config prints words for a shell, with the space in the path escaped.
    program = args.work / "pkg_config"
    pkg_config_path = str(libdir / "pkgconfig")
    run("sh", "-c", f'eval "{args.cc} -o {program} {consumer / "main.c"} $(pkg-config --cflags --libs gpurt)"',
        PKG_CONFIG_PATH=pkg_config_path)
    printed["pkg-config"] = run(program, LD_LIBRARY_PATH=str(libdir))
    printed["pkg-config's version"] = "gpurt " + run("pkg-config", "--modversion", "gpurt",
                                                     PKG_CONFIG_PATH=pkg_config_path)

    for how, text in printed.items():
        if text.strip() != f"gpurt {args.version}":
            sys.exit(f"{how}: {text}")
    print(f"gpurt {args.version} works from {tree}")


if __name__ == "__main__":
    main()
