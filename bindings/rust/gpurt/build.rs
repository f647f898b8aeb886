//! Tells this crate's own tests and examples where libgpurt lies, and collects the examples of the
//! documentation as tests. (Programs that use the crate find an installed library through the system's search
//! path; docs/rust.md says what to do with others.)

use std::path::{Path, PathBuf};
use std::{env, fs};

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    if let Ok(dir) = env::var("DEP_GPURT_LIBDIR") {
        println!("cargo:rustc-link-arg=-Wl,-rpath,{}", dir);
        println!("cargo:rustc-env=GPURT_TEST_LIBDIR={}", dir);
    }

    // Outside a checkout there is no such documentation.
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..");
    let mut examples = String::new();
    for file in ["README.md", "docs/rust.md"] {
        if let Ok(text) = fs::read_to_string(root.join(file)) {
            println!("cargo:rerun-if-changed={}", root.join(file).display());
            examples += &rust_blocks(&text);
        }
    }
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::write(out.join("examples.md"), examples).expect("cannot write to OUT_DIR");
}

/// The blocks of a text that are marked as Rust.
fn rust_blocks(text: &str) -> String {
    let mut blocks = String::new();
    let mut inside = false;
    for line in text.lines() {
        let starts = !inside && line.starts_with("```rust");
        let ends = inside && line.starts_with("```");
        if inside || starts {
            blocks += line;
            blocks.push('\n');
        }
        inside = (inside || starts) && !ends;
    }
    blocks
}
