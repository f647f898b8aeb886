"""Compiles and runs the C and C++ blocks of README.md and docs/: whole programs as they are, fragments in the room of
examples/room.h, with a device and a committed scene."""

import argparse
import pathlib
import re
import subprocess
import sys
import textwrap

FRAGMENT = """#include "room.h"
int main(void)
{{
  gpurt_device device;
  CHECK(gpurt_device_create(NULL, &device));
  gpurt_scene scene = create_room(device);
  {{
{block}
  }}
  gpurt_scene_release(scene);
  gpurt_device_release(device);
  return 0;
}}
"""


def run(where, command, folder):
    result = subprocess.run([str(c) for c in command], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                            text=True)
    if result.returncode:
        sys.exit(f"{where}: {' '.join(map(str, command))}\n{result.stdout}")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cc", required=True)
    parser.add_argument("--cxx", required=True)
    parser.add_argument("--source", required=True, type=pathlib.Path)
    parser.add_argument("--lib-dir", required=True)
    parser.add_argument("--tool", required=True)
    parser.add_argument("--work", required=True, type=pathlib.Path)
    args = parser.parse_args()

    args.work.mkdir(parents=True, exist_ok=True)
    # The scene that the programs load, small.
    run("cornell.glb", [args.tool, "scene", "cornell", "-o", "cornell.glb", "--width", "64"], args.work)
    languages = {"c": (args.cc, "-std=c99"), "cpp": (args.cxx, "-std=c++17")}
    count = 0
    for document in [args.source / "README.md", *sorted((args.source / "docs").glob("*.md"))]:
        text = document.read_text(encoding="utf-8") if document.exists() else ""
        for match in re.finditer(r"^```(c|cpp)\n(.*?)^```$", text, flags=re.M | re.S):
            language, block = match.groups()
            where = f"{document.relative_to(args.source)}:{text.count(chr(10), 0, match.start()) + 1}"
            compiler, standard = languages[language]
            if "main(" not in block:
                if language != "c":
                    sys.exit(f"{where}: a C++ block must be a whole program")
                block = FRAGMENT.format(block=textwrap.indent(block, "    "))
            program = args.work / f"{document.stem}_{count}"
            source = program.with_suffix("." + language)
            source.write_text(block, encoding="utf-8")
            run(where, [compiler, standard, "-Wall", "-Wextra", "-Werror", "-Wno-unused", f"-I{args.source}/include",
                        f"-I{args.source}/examples", "-o", program, source, f"-L{args.lib_dir}",
                        f"-Wl,-rpath,{args.lib_dir}", "-lgpurt"], args.work)
            run(where, [program], args.work)
            count += 1

    # The first program of the documentation is an example too; they must not drift apart.
    readme = (args.source / "examples" / "readme.c").read_text(encoding="utf-8")
    if f"```c\n{readme}```" not in (args.source / "docs" / "c.md").read_text(encoding="utf-8"):
        sys.exit("docs/c.md does not show examples/readme.c as it is")
    print(f"{count} blocks of the documentation compile and run")


if __name__ == "__main__":
    main()
