"""The shared library exports exactly the functions that the public C headers declare."""

import argparse
import pathlib
import re
import subprocess
import sys


def declared(include):
    """Names of the functions that the C headers declare with GPURT_API."""
    names = set()
    for header in sorted(include.glob("gpurt*.h")):
        text = re.sub(r"/\*.*?\*/", "", header.read_text(encoding="utf-8"), flags=re.S)
        text = re.sub(r"^\s*#.*(?:\\\n.*)*", "", text, flags=re.M)
        names.update(re.findall(r"\bGPURT_API\b[^;{}()]*?\b(gpurt_\w+)\s*\(", text))
    return names


def exported(nm, library):
    """Names of the dynamic symbols that the library defines."""
    lines = subprocess.run([nm, "-D", "--defined-only", library], check=True, capture_output=True, text=True)
    return {line.split()[-1].split("@")[0] for line in lines.stdout.splitlines()}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nm", required=True)
    parser.add_argument("--library", required=True)
    parser.add_argument("--include", required=True, type=pathlib.Path)
    args = parser.parse_args()

    declarations, exports = declared(args.include), exported(args.nm, args.library)
    if not declarations:
        sys.exit("no declaration was found in the headers: is GPURT_API still their mark?")
    problems = [f"exported, but not declared: {name}" for name in sorted(exports - declarations)]
    problems += [f"declared, but not exported: {name}" for name in sorted(declarations - exports)]
    if problems:
        sys.exit("\n".join(problems))
    print(f"{len(exports)} functions, all declared")


if __name__ == "__main__":
    main()
