//! The same bits as from C.
use std::path::Path;
use std::process::Command;

use gpurt::{Frame, FrameDesc, Hit, Output, Ray, RenderDesc, Tile};

use crate::room;

/// Compiles and runs bits.c.
fn run_c() -> Vec<u8> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..");
    let program = crate::temporary_folder("bits").join("bits");
    let compiled = Command::new(std::env::var_os("CC").unwrap_or_else(|| "cc".into()))
        .args(["-std=c99", "-o"])
        .arg(&program)
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/api/bits.c"))
        .arg("-I")
        .arg(root.join("include"))
        .arg("-I")
        .arg(root.join("examples"))
        .args([
            concat!("-L", env!("GPURT_TEST_LIBDIR")),
            concat!("-Wl,-rpath,", env!("GPURT_TEST_LIBDIR")),
            "-lgpurt",
        ])
        .output()
        .expect("a C compiler");
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let output = Command::new(program).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

/// Collects values as bytes, as C writes them.
#[derive(Default)]
struct Bytes(Vec<u8>);

impl Bytes {
    fn floats<'a>(&mut self, values: impl IntoIterator<Item = &'a f32>) {
        values.into_iter().for_each(|value| self.0.extend(value.to_ne_bytes()));
    }

    fn words<'a>(&mut self, values: impl IntoIterator<Item = &'a u32>) {
        values.into_iter().for_each(|value| self.0.extend(value.to_ne_bytes()));
    }

    fn hits(&mut self, hits: &[Hit]) {
        for hit in hits {
            self.floats([&hit.t, &hit.u, &hit.v]);
            self.words([&hit.primitive, &hit.geometry, &hit.instance, &0, &0]);
        }
    }
}

#[test]
fn bits_are_those_of_c() {
    let scene = room::create(&room::cpu());
    let mut bytes = Bytes::default();

    let coordinate = |i: u8| f32::from(i) / 8.0 - 0.5;
    let ray =
        |i: u8| Ray::new([0.0, 0.0, 3.6], [coordinate(i % 8), coordinate(i / 8), -1.0]).clip(0.5, 100.0);
    let rays: Vec<Ray> = (0..64).map(ray).collect();
    bytes.hits(&scene.closest(&rays).unwrap());
    let all = scene.all(&rays).unwrap();
    all.offsets.iter().for_each(|offset| bytes.0.extend(offset.to_ne_bytes()));
    bytes.hits(&all.hits);

    let outputs = [Output::Depth, Output::Normal, Output::Primitive];
    let frame = Frame::new(&scene, &FrameDesc::new(24, 18).outputs(&outputs).seed(3)).unwrap();
    let tiles = [Tile { x0: 0, y0: 0, x1: 24, y1: 7 }, Tile { x0: 0, y0: 7, x1: 24, y1: 18 }];
    frame.submit_tiles(&RenderDesc::new().samples(4).max_depth(5), &tiles).unwrap().wait().unwrap();
    bytes.floats(frame.read::<[f32; 3]>(Output::Color).unwrap().iter().flatten());
    bytes.floats(&frame.read::<f32>(Output::Alpha).unwrap());
    bytes.floats(&frame.read::<f32>(Output::Depth).unwrap());
    bytes.floats(frame.read::<[f32; 3]>(Output::Normal).unwrap().iter().flatten());
    bytes.words(&frame.read::<u32>(Output::Primitive).unwrap());
    bytes.words(&frame.read::<u32>(Output::SampleCount).unwrap());

    let c = run_c();
    assert_eq!(c.len(), bytes.0.len());
    let first = c.iter().zip(&bytes.0).position(|(c, rust)| c != rust);
    assert_eq!(first, None, "the first byte that differs");
}
