//! Arrays in device memory: of a GPU where there is one, and of the CPU.
use gpurt::{Buffer, Device, DeviceBuffer, Error, Hit, HitCompact, Mesh, Ray, Scene, IDENTITY};

use crate::room;

fn devices() -> Vec<Device> {
    std::iter::once(room::cpu()).chain(Device::cuda(0).ok()).collect()
}

const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

fn scene(device: &Device) -> Scene {
    let scene = Scene::new(device).unwrap();
    let vertices = DeviceBuffer::from_slice(device, &TRIANGLE).unwrap();
    let indices = DeviceBuffer::from_slice(device, &[[0_u32, 1, 2]]).unwrap();
    let mesh = scene.add_mesh(&Mesh::new(&vertices).indices(&indices)).unwrap();
    drop((vertices, indices));
    scene.add_instance(mesh, IDENTITY).unwrap();
    scene.commit().unwrap();
    scene
}

fn rays() -> Vec<Ray> {
    (0..1000).map(|i| Ray::new([i as f32 / 500.0, 0.25, 1.0], [0.0, 0.0, -1.0])).collect()
}

#[test]
fn elements_go_there_and_back() {
    for device in devices() {
        let mut buffer = DeviceBuffer::<u32>::new(&device, 10).unwrap();
        assert_eq!((buffer.len(), buffer.is_empty()), (10, false));
        assert_eq!(buffer.download().unwrap(), [0; 10]);
        buffer.upload_at(3, &[1, 2, 3]).unwrap();
        let mut part = [9; 4];
        buffer.download_into(2, &mut part).unwrap();
        assert_eq!(part, [0, 1, 2, 3]);
        buffer.upload(&[7; 10]).unwrap();
        assert_eq!(buffer.download().unwrap(), [7; 10]);

        let text = |result: gpurt::Result<()>| match result {
            Err(Error::InvalidArgument(text)) => text,
            other => panic!("{:?}", other),
        };
        assert!(text(buffer.upload(&[1; 9])).contains("the buffer has 10"));
        assert!(text(buffer.upload_at(8, &[1; 3])).contains("3 elements from 8 on leave the buffer"));
        assert!(text(buffer.upload_at(usize::MAX, &[1])).contains("leave the buffer"));
        assert!(text(buffer.download_into(10, &mut [1])).contains("which has 10"));
        assert!(matches!(DeviceBuffer::<u64>::new(&device, usize::MAX), Err(Error::OutOfMemory(_))));

        let empty = DeviceBuffer::<Ray>::from_slice(&device, &[]).unwrap();
        assert!(empty.is_empty() && empty.download().unwrap().is_empty());
    }
}

#[test]
fn queries_read_and_write_device_memory() {
    for device in devices() {
        let scene = scene(&device);
        let rays = rays();
        let expected = scene.closest(&rays).unwrap();
        assert!(expected.iter().any(Hit::is_miss) && !expected.iter().all(Hit::is_miss));
        let device_rays = DeviceBuffer::from_slice(&device, &rays).unwrap();

        let mut hits = DeviceBuffer::<Hit>::new(&device, rays.len()).unwrap();
        scene.closest_on_device(&device_rays, &mut hits).unwrap();
        assert_eq!(hits.download().unwrap(), expected);
        let mut compact = DeviceBuffer::<HitCompact>::new(&device, rays.len()).unwrap();
        scene.closest_on_device(&device_rays, &mut compact).unwrap();
        assert!(compact.download().unwrap().iter().zip(&expected).all(|(a, b)| a.t == b.t));

        let mut occluded = DeviceBuffer::<u8>::new(&device, rays.len()).unwrap();
        scene.occluded_on_device(&device_rays, &mut occluded).unwrap();
        let flags: Vec<u8> = expected.iter().map(|hit| u8::from(!hit.is_miss())).collect();
        assert_eq!(occluded.download().unwrap(), flags);

        let all = scene.all(&rays).unwrap();
        let mut offsets = DeviceBuffer::<u64>::new(&device, rays.len() + 1).unwrap();
        let count = scene.all_on_device::<Hit>(&device_rays, None, &mut offsets).unwrap();
        assert_eq!(count, all.hits.len() as u64);
        let mut hits = DeviceBuffer::<Hit>::new(&device, count as usize).unwrap();
        scene.all_on_device(&device_rays, Some(&mut hits), &mut offsets).unwrap();
        assert_eq!(hits.download().unwrap(), all.hits);
        assert_eq!(offsets.download().unwrap(), all.offsets);

        let mut short = DeviceBuffer::<Hit>::new(&device, 3).unwrap();
        let result = scene.closest_on_device(&device_rays, &mut short);
        assert!(matches!(result, Err(Error::InvalidArgument(text)) if text.contains("hits has 3 elements")));
    }
}

#[test]
fn buffers_of_another_device_are_refused() {
    let (one, other) = (room::cpu(), room::cpu());
    let scene = scene(&one);
    let rays = DeviceBuffer::from_slice(&other, &rays()).unwrap();
    let mut hits = DeviceBuffer::<Hit>::new(&one, rays.len()).unwrap();
    let result = scene.closest_on_device(&rays, &mut hits);
    assert!(matches!(result, Err(Error::InvalidArgument(text)) if text.contains("rays belongs to another device")));
    let own = DeviceBuffer::from_slice(&one, &crate::device_memory::rays()).unwrap();
    scene.closest_on_device(&own, &mut hits).unwrap();
}

#[test]
fn addresses_are_the_callers_affair() {
    let device = room::cpu();
    let scene = scene(&device);
    let mut rays = rays();
    let expected = scene.closest(&rays).unwrap();
    // SAFETY: the memory of the CPU is host memory, and the vector outlives the buffer.
    let lent = unsafe { DeviceBuffer::from_device_ptr(&device, rays.as_mut_ptr(), rays.len()) }.unwrap();
    assert_eq!(lent.as_device_ptr(), rays.as_mut_ptr());
    let mut hits = vec![Hit::default(); rays.len()];
    let desc = gpurt::sys::gpurt_trace_desc {
        storage: gpurt::sys::GPURT_STORAGE_DEVICE,
        num_rays: rays.len() as u64,
        rays: lent.as_device_ptr() as *const gpurt::sys::gpurt_ray,
        hits: hits.as_mut_ptr() as *mut std::ffi::c_void,
        ..Default::default()
    };
    // SAFETY: both arrays have the lengths that the query needs.
    unsafe { scene.trace_raw(&desc) }.unwrap();
    assert_eq!(hits, expected);
    let null = std::ptr::null_mut();
    // SAFETY: as above; nothing is queued on a CPU.
    let result = unsafe { scene.trace_on_stream(&desc, null, null, null) };
    assert!(matches!(result, Err(Error::Unsupported(_))));
}

#[test]
fn several_devices_are_asked_for_by_number() {
    let text = |result: gpurt::Result<Device>| match result {
        Err(error) => error.to_string(),
        Ok(device) => panic!("{:?}", device),
    };
    assert!(text(Device::cuda_several(&[1000, 1001])).contains("CUDA"));
    let desc = gpurt::DeviceDesc::new(gpurt::DeviceType::Cpu).ordinals(&[0, 0]);
    assert!(text(desc.create()).contains("ordinals[1] is 0, which comes before"));
    let buffer = Buffer::new(&room::cpu(), TRIANGLE.to_vec()).unwrap();
    assert_eq!(buffer.as_slice(), TRIANGLE);
}
