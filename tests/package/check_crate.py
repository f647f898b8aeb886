"""Builds and runs a program that uses the Rust crates outside the checkout, with an installed tree that pkg-config finds."""

import argparse
import os
import pathlib
import shutil
import subprocess
import sys

MANIFEST = """[package]
name = "consumer"
version = "1.0.0"
edition = "2021"

[dependencies]
gpurt = {{ path = '{crates}/gpurt' }}

[workspace]
"""

PROGRAM = """fn main() -> gpurt::Result<()> {
    let (major, minor, patch) = gpurt::version();
    println!("gpurt {}.{}.{}", major, minor, patch);
    Ok(())
}
"""


def run(*command, cwd=None, **env):
    result = subprocess.run([str(c) for c in command], cwd=cwd, env={**os.environ, **env},
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if result.returncode:
        sys.exit(f"{' '.join(map(str, command))}\n{result.stdout}")
    return result.stdout


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cmake", required=True)
    parser.add_argument("--build", required=True, type=pathlib.Path)
    parser.add_argument("--crates", required=True, type=pathlib.Path)
    parser.add_argument("--libdir", required=True)
    parser.add_argument("--version", required=True)
    parser.add_argument("--work", required=True, type=pathlib.Path)
    args = parser.parse_args()

    os.environ["PATH"] += os.pathsep + str(pathlib.Path.home() / ".cargo" / "bin")
    if not shutil.which("cargo") or not shutil.which("pkg-config"):
        print("skipped: there is no cargo or no pkg-config")
        sys.exit(77)
    for name in ["GPURT_LIB_DIR", "LD_LIBRARY_PATH", "CARGO_TARGET_DIR"]:
        os.environ.pop(name, None)

    shutil.rmtree(args.work, ignore_errors=True)
    tree, crates, consumer = (args.work / name for name in ["tree", "crates", "consumer"])
    run(args.cmake, "--install", args.build, "--prefix", tree)
    shutil.copytree(args.crates, crates, ignore=shutil.ignore_patterns("target"))
    (consumer / "src").mkdir(parents=True)
    (consumer / "Cargo.toml").write_text(MANIFEST.format(crates=crates))
    (consumer / "src" / "main.rs").write_text(PROGRAM)
    libdir = tree / args.libdir
    run("cargo", "build", "--offline", "--quiet", cwd=consumer, PKG_CONFIG_PATH=str(libdir / "pkgconfig"))
    printed = run(consumer / "target" / "debug" / "consumer", LD_LIBRARY_PATH=str(libdir)).strip()
    if printed != f"gpurt {args.version}":
        sys.exit(f"the program prints '{printed}'")
    print(f"{printed} works from a crate outside the checkout")


if __name__ == "__main__":
    main()
