//! Owners: threads, clones, any order of drops.
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;

use gpurt::{
    AllHits, Buffer, Device, DeviceDesc, DeviceType, Frame, FrameDesc, Job, Mesh, Output, Ray, RenderDesc,
    Scene, IDENTITY,
};

use crate::room;

#[test]
fn everything_is_send_and_sync() {
    fn check<T: Send + Sync>() {}
    check::<Device>();
    check::<DeviceDesc>();
    check::<Scene>();
    check::<Mesh>();
    check::<Buffer<[f32; 3]>>();
    check::<Frame>();
    check::<RenderDesc>();
    check::<Job>();
    check::<AllHits>();
    check::<gpurt::Error>();
}

#[test]
fn children_keep_their_parents() {
    let device = room::cpu();
    let scene = room::create(&device);
    let frame = Frame::new(&scene, &FrameDesc::new(8, 8)).unwrap();
    let job = frame.submit(&RenderDesc::new().samples(4)).unwrap();
    drop(device);
    drop(scene);
    let other = frame.clone();
    drop(frame);
    job.wait().unwrap();
    drop(job);
    assert_eq!(other.read::<u32>(Output::SampleCount).unwrap(), [4; 64]);
}

#[test]
fn every_order_of_drops_is_fine() {
    // All orders of dropping a device, scene, frame and running job.
    for order in 0..24 {
        let device = room::cpu();
        let scene = room::create(&device);
        let frame = Frame::new(&scene, &FrameDesc::new(32, 32)).unwrap();
        let job = frame.submit(&RenderDesc::new().samples(10_000).progress(|_, _| {})).unwrap();
        let mut owners: Vec<Box<dyn std::any::Any>> =
            vec![Box::new(device), Box::new(scene), Box::new(frame), Box::new(job)];
        let mut number = order;
        while !owners.is_empty() {
            let next = number % owners.len();
            number /= owners.len();
            drop(owners.remove(next));
        }
    }
}

#[test]
fn memory_comes_back() {
    let device = room::cpu();
    let empty = device.properties().unwrap().memory_used_bytes;
    let scene = room::create(&device);
    let frame = Frame::new(&scene, &FrameDesc::new(64, 64)).unwrap();
    frame.render(&RenderDesc::new().samples(1)).unwrap();
    let frames = frame.clone();
    drop((frame, scene));
    assert!(device.properties().unwrap().memory_used_bytes > empty);
    drop(frames);
    assert_eq!(device.properties().unwrap().memory_used_bytes, empty);
}

#[test]
fn threads_share_a_scene() {
    let scene = room::create(&room::cpu());
    let rays: Vec<Ray> =
        (0..64).map(|i| Ray::new([0.0, 0.0, 3.0], [i as f32 / 64.0 - 0.5, 0.2, -1.0])).collect();
    let expected = scene.closest(&rays).unwrap();
    thread::scope(|scope| {
        for thread in 0..4 {
            let (scene, rays, expected) = (&scene, &rays, &expected);
            scope.spawn(move || {
                for i in 0..50 {
                    assert_eq!(&scene.closest(rays).unwrap(), expected);
                    // Errors are each thread's own.
                    let name = format!("thread {} file {}.glb", thread, i);
                    let error = Scene::load(&room::cpu(), &name).unwrap_err();
                    assert!(error.message().contains(&name), "{}", error);
                }
            });
        }
        // Commits in between do not disturb.
        for _ in 0..10 {
            scene.commit().unwrap();
        }
    });
}

#[test]
fn buffers_are_shared_and_live_as_long_as_they_are_used() {
    let device = room::cpu();
    let vertices =
        Buffer::new(&device, vec![[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [9.0; 3]]).unwrap();
    let indices = Buffer::new(&device, vec![[0_u32, 1, 2]]).unwrap();
    assert_eq!(vertices.as_slice()[1], [1.0, 0.0, 0.0]);
    let scene = Scene::new(&device).unwrap();
    let triangle = scene.add_mesh(&Mesh::new(&vertices).indices(&indices)).unwrap();
    scene.add_instance(triangle, IDENTITY).unwrap();
    let again = vertices.clone();
    drop((vertices, indices, device));
    assert_eq!(again.as_slice()[3], [9.0; 3]);
    drop(again);
    scene.commit().unwrap();
    let hits = scene.closest(&[Ray::new([0.25, 0.25, 1.0], [0.0, 0.0, -1.0])]).unwrap();
    assert!((hits[0].t - 1.0).abs() < 1e-6); // Embree rounds

    // A buffer of another device cannot be reached.
    let foreign = Buffer::new(&room::cpu(), vec![[0.0_f32; 3]; 3]).unwrap();
    assert!(matches!(scene.add_mesh(&Mesh::new(&foreign)), Err(gpurt::Error::InvalidArgument(_))));
    assert!(matches!(Buffer::<u32>::new(&room::cpu(), Vec::new()), Err(gpurt::Error::InvalidArgument(_))));
}

#[test]
fn the_log_hears_of_a_file_and_outlives_its_device() {
    let folder = crate::temporary_folder("log");
    let path = folder.join("fog.gltf");
    // A scene of nothing that says something which gpurt does not know.
    let text = r#"{"asset": {"version": "2.0"}, "extensionsUsed": ["KHR_materials_sheen"], "scene": 0,
        "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"extensions": {"KHR_materials_sheen": {"sheenRoughnessFactor": 0.5}}}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
            "min": [0, 0, 0], "max": [0, 0, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36,
            "uri":
            "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA"}]}"#;
    std::fs::write(&path, text).unwrap();

    let messages = Arc::new(Mutex::new(Vec::new()));
    let sink = messages.clone();
    let desc = DeviceDesc::new(DeviceType::Cpu).log(move |level, text| {
        sink.lock().unwrap().push(format!("{:?}: {}", level, text));
    });
    let device = desc.create().unwrap();
    let scene = Scene::load(&device, &path).unwrap();
    drop((device, desc));
    assert_eq!(Arc::strong_count(&messages), 2, "the scene keeps the log");
    scene.commit().unwrap();
    drop(scene);
    assert_eq!(Arc::strong_count(&messages), 1, "nothing can log any more");
    let messages = messages.lock().unwrap();
    assert!(messages.iter().any(|message| message.starts_with("Warning: ")), "{:?}", messages);
}

#[test]
fn a_panicking_progress_function_harms_nothing() {
    let frame = Frame::new(&room::create(&room::cpu()), &FrameDesc::new(16, 16)).unwrap();
    let calls = Arc::new(AtomicUsize::new(0));
    let counter = calls.clone();
    let render = RenderDesc::new().samples(64).progress(move |_, _| {
        counter.fetch_add(1, Ordering::Relaxed);
        panic!("expected by the test");
    });
    frame.render(&render).unwrap();
    assert!(calls.load(Ordering::Relaxed) <= 1);
    assert_eq!(frame.statistics().unwrap().samples_per_pixel, 64);
}
