//! The scene of examples/room.h: the same calls, in the same order.
use gpurt::{Camera, Device, DeviceDesc, DeviceType, Material, MaterialId, Mesh, Scene, IDENTITY};

pub fn cpu() -> Device {
    DeviceDesc::new(DeviceType::Cpu).threads(2).create().unwrap()
}

fn add_parallelogram(scene: &Scene, material: MaterialId, p: [f32; 3], a: [f32; 3], b: [f32; 3]) {
    let mut vertices = [[0.0; 3]; 4];
    for i in 0..3 {
        vertices[0][i] = p[i];
        vertices[1][i] = p[i] + a[i];
        vertices[2][i] = p[i] + a[i] + b[i];
        vertices[3][i] = p[i] + b[i];
    }
    let mesh = Mesh::new(&vertices).indices(&[[0, 1, 2], [0, 2, 3]]).material(material);
    let geometry = scene.add_mesh(&mesh).unwrap();
    scene.add_instance(geometry, IDENTITY).unwrap();
}

/// The room, described and not yet committed.
pub fn describe(device: &Device) -> Scene {
    let scene = Scene::new(device).unwrap();
    let color = |base_color, radiance| {
        let material = Material { base_color, emission: [radiance; 3], ..Material::default() };
        scene.add_material(&material).unwrap()
    };
    let white = color([0.75, 0.75, 0.75], 0.0);
    let red = color([0.65, 0.05, 0.05], 0.0);
    let green = color([0.1, 0.45, 0.1], 0.0);
    let lamp = color([0.0; 3], 15.0);

    let (x, y, z) = ([2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]);
    let (low, right, top) = ([-1.0, -1.0, -1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0]);
    add_parallelogram(&scene, white, low, z, x);
    add_parallelogram(&scene, white, top, x, z);
    add_parallelogram(&scene, white, low, x, y);
    add_parallelogram(&scene, red, low, y, z);
    add_parallelogram(&scene, green, right, z, y);
    add_parallelogram(&scene, lamp, [-0.3, 0.99, -0.3], [0.6, 0.0, 0.0], [0.0, 0.0, 0.6]);

    let (width, up, depth) = ([0.7, 0.0, 0.2], [0.0, 0.9, 0.0], [0.2, 0.0, -0.7]);
    add_parallelogram(&scene, white, [-0.5, -1.0, 0.1], width, up);
    add_parallelogram(&scene, white, [0.2, -1.0, 0.3], depth, up);
    add_parallelogram(&scene, white, [-0.5, -0.1, 0.1], width, depth);

    let mut transform = IDENTITY;
    transform[2][3] = 3.6;
    scene.add_camera(&Camera { transform, ..Camera::default() }).unwrap();
    scene
}

/// The room, ready to render.
pub fn create(device: &Device) -> Scene {
    let scene = describe(device);
    scene.commit().unwrap();
    scene
}
