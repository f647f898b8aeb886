//! The safe API against the library.

mod bits;
mod device_memory;
mod errors;
mod objects;
mod photons;
mod render;
mod room;
mod trace;

/// A folder of one test's own, empty.
fn temporary_folder(name: &str) -> std::path::PathBuf {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}
