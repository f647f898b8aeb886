//! Each result code becomes its variant, with the library's text.
use std::path::Path;

use gpurt::{
    Camera, Device, DeviceDesc, DeviceType, Error, Frame, FrameDesc, Material, Mesh, Output, Pipeline,
    RenderDesc, Scene, Subdivision, SubdivisionScheme, Texels, Texture,
};

use crate::room;

const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

#[track_caller]
fn expect_error<T: std::fmt::Debug>(result: gpurt::Result<T>, kind: fn(String) -> Error, words: &[&str]) {
    let error = result.unwrap_err();
    assert_eq!(error, kind(error.message().to_string()));
    for word in words {
        let text = error.to_string().to_lowercase();
        assert!(text.contains(word), "'{}' does not say '{}'", error, word);
    }
}

#[test]
fn invalid_arguments() {
    let scene = Scene::new(&room::cpu()).unwrap();
    let mesh = Mesh::new(&TRIANGLE).indices(&[[0, 1, 2], [0, 1, 3]]);
    expect_error(scene.add_mesh(&mesh), Error::InvalidArgument, &["3"]);
    expect_error(scene.add_mesh(&Mesh::new(&TRIANGLE[..2])), Error::InvalidArgument, &[]);
    expect_error(scene.add_mesh(&Mesh::new(&TRIANGLE).normals(&TRIANGLE[..2])), Error::InvalidArgument, &[]);
    expect_error(scene.add_mesh(&Mesh::new(&[[f32::NAN; 3]; 3])), Error::InvalidArgument, &[]);
    expect_error(
        scene.add_material(&Material { base_color: [2.0; 3], ..Default::default() }),
        Error::InvalidArgument,
        &["2"],
    );
    let tinted = Material { attenuation_color: [0.5, 3.0, 0.5], ..Default::default() };
    expect_error(scene.add_material(&tinted), Error::InvalidArgument, &["attenuation_color", "3"]);
    let tinted = Material { attenuation_distance: -4.0, ..Default::default() };
    expect_error(scene.add_material(&tinted), Error::InvalidArgument, &["attenuation_distance", "-4"]);
    let texels = Texels::Srgb8(&[[255; 4]; 3]);
    expect_error(scene.add_texture(&Texture::new(2, 2, texels)), Error::InvalidArgument, &["2 x 2", "3"]);
    expect_error(scene.closest(&[]), Error::InvalidArgument, &["commit"]);
    expect_error(Frame::new(&scene, &FrameDesc::default()), Error::InvalidArgument, &["commit"]);
    // What failed has left nothing behind.
    let facts = scene.facts().unwrap();
    assert_eq!((facts.num_geometries, facts.num_materials, facts.num_textures), (0, 0, 0));
    assert!(!facts.is_committed);
}

#[test]
fn paths() {
    let device = room::cpu();
    expect_error(Scene::load(&device, "no such file.glb"), Error::Io, &["no such file.glb"]);
    expect_error(Scene::load(&device, "zero\0byte.glb"), Error::InvalidArgument, &["zero"]);
    let frame = Frame::new(&room::create(&device), &FrameDesc::new(4, 4)).unwrap();
    expect_error(frame.save("image.bmp"), Error::InvalidArgument, &["bmp"]);
    expect_error(frame.save("no such folder/image.exr"), Error::Io, &["no such folder"]);
    let not_a_state = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
    expect_error(frame.load_state(not_a_state), Error::Io, &["cargo.toml"]);
}

#[test]
fn unsupported() {
    let scene = room::create(&room::cpu());
    let cage = Subdivision::new(SubdivisionScheme::Loop, &TRIANGLE, &[3], &[0, 1, 2]);
    expect_error(scene.add_subdivision(&cage), Error::Unsupported, &[]);
    expect_error(
        scene.add_camera(&Camera { lens_radius: 0.1, ..Default::default() }),
        Error::Unsupported,
        &[],
    );
    let frame = Frame::new(&scene, &FrameDesc::new(4, 4)).unwrap();
    expect_error(frame.submit(&RenderDesc::new().pipeline(Pipeline::Hybrid)), Error::Unsupported, &["hybrid"]);
}

#[test]
fn memory_limit() {
    let device = DeviceDesc::new(DeviceType::Cpu).memory_limit(1 << 20).create().unwrap();
    assert_eq!(device.properties().unwrap().memory_limit_bytes, 1 << 20);
    let scene = room::create(&device);
    expect_error(Frame::new(&scene, &FrameDesc::new(4096, 4096)), Error::OutOfMemory, &[]);
    Frame::new(&scene, &FrameDesc::new(16, 16)).unwrap();
}

#[test]
fn devices() {
    match Device::cuda(1000) {
        Err(Error::Device(_) | Error::Unsupported(_)) => {}
        other => panic!("{:?}", other),
    }
    let devices = Device::enumerate().unwrap();
    assert_eq!(devices[0].kind, DeviceType::Cpu);
    assert!(!devices[0].name.is_empty() && !devices[0].instruction_set.is_empty());
    let device = room::cpu().properties().unwrap();
    assert_eq!((device.kind, device.num_threads), (DeviceType::Cpu, 2));
    assert_eq!(device.name, devices[0].name);
}

#[test]
fn outputs_have_types() {
    let frame = Frame::new(&room::create(&room::cpu()), &FrameDesc::new(4, 2)).unwrap();
    expect_error(frame.read::<u32>(Output::Alpha), Error::InvalidArgument, &["alpha", "u32"]);
    expect_error(frame.read::<f32>(Output::Depth), Error::InvalidArgument, &[]); // not kept
    expect_error(frame.read_into(Output::Alpha, &mut [0.0; 7]), Error::InvalidArgument, &["28", "32"]);
    expect_error(frame.submit_tiles(&RenderDesc::new(), &[]), Error::InvalidArgument, &["no tiles"]);
}
