//! Finds libgpurt, in this order: `GPURT_LIB_DIR`, the build folder of the checkout that this crate lies in,
//! pkg-config.

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    for name in ["GPURT_LIB_DIR", "PKG_CONFIG_PATH", "PKG_CONFIG_LIBDIR"] {
        println!("cargo:rerun-if-env-changed={}", name);
    }
    // docs.rs builds documentation alone and has no library.
    if env::var_os("DOCS_RS").is_some() {
        return;
    }
    let dir = lib_dir().unwrap_or_else(|| {
        eprintln!(
            "error: libgpurt.so was not found. Set GPURT_LIB_DIR to the folder that holds it, or put the \
             folder with gpurt.pc into PKG_CONFIG_PATH, or build the library first (scripts/build)."
        );
        std::process::exit(1)
    });
    let dir = dir.display();
    println!("cargo:rustc-link-search=native={}", dir);
    println!("cargo:rustc-link-lib=dylib=gpurt");
    // Build scripts of crates that depend on this one read it as DEP_GPURT_LIBDIR.
    println!("cargo:libdir={}", dir);
    println!("cargo:rustc-link-arg=-Wl,-rpath,{}", dir);
}

fn lib_dir() -> Option<PathBuf> {
    if let Some(dir) = env::var_os("GPURT_LIB_DIR") {
        // What was asked for, or nothing: another library would be a surprise.
        return has_library(PathBuf::from(dir));
    }
    let checkout = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../build/lib");
    has_library(checkout).or_else(pkg_config)
}

fn has_library(dir: PathBuf) -> Option<PathBuf> {
    let dir = dir.canonicalize().ok()?;
    if dir.join("libgpurt.so").exists() {
        Some(dir)
    } else {
        None
    }
}

fn pkg_config() -> Option<PathBuf> {
    let version = concat!(env!("CARGO_PKG_VERSION_MAJOR"), ".", env!("CARGO_PKG_VERSION_MINOR"));
    let tool = env::var_os("PKG_CONFIG").unwrap_or_else(|| "pkg-config".into());
    let output =
        Command::new(tool).args(["--variable=libdir", &format!("gpurt >= {}", version)]).output().ok()?;
    if !output.status.success() {
        return None;
    }
    has_library(PathBuf::from(String::from_utf8(output.stdout).ok()?.trim()))
}
