//! Photon maps.
use gpurt::{
    Device, Error, GatherKernel, GatherMethod, PhotonAttribute, PhotonMap, PhotonMapDesc, PhotonTraceDesc,
    Within, INVALID_ID,
};

use crate::room;

/// A lattice of 10 x 10 x 10 points, 0.1 apart.
fn lattice() -> Vec<[f32; 3]> {
    (0..1000).map(|i| [(i % 10) as f32 * 0.1, (i / 10 % 10) as f32 * 0.1, (i / 100) as f32 * 0.1]).collect()
}

fn map(device: &Device) -> PhotonMap {
    let desc = PhotonMapDesc {
        positions: &lattice(),
        fluxes: &[[1.0, 0.5, 0.0]; 1000],
        normals: &[[0.0, 0.0, 2.0]; 1000],
        radius: 0.15,
        num_levels: 2,
    };
    PhotonMap::new(device, &desc).unwrap()
}

const PLACES: [[f32; 3]; 3] = [[0.5, 0.5, 0.5], [0.0, 0.0, 0.0], [9.0, 9.0, 9.0]];

#[test]
fn neighbours_on_a_lattice() {
    let map = map(&room::cpu());
    // Of a point within: itself, 6 at 0.1 and 12 at 0.141; of a corner: 1 + 3 + 3.
    let within = Within::new(0.15);
    assert_eq!(map.count(&PLACES, &within).unwrap(), [19, 7, 0]);
    let sums = map.sum(&PLACES, &within).unwrap();
    assert_eq!(sums, [[19.0, 9.5, 0.0], [7.0, 3.5, 0.0], [0.0; 3]]);
    let cone = map.sum(&PLACES, &Within { kernel: GatherKernel::Cone, ..within }).unwrap();
    assert!((cone[0][0] - (1.0 + 6.0 * (1.0 - 0.1 / 0.15) + 12.0 * (1.0 - 0.141421 / 0.15))).abs() < 1e-3);
    let up = [[0.0, 0.0, 1.0]; 3];
    let down = [[0.0, 0.0, -1.0]; 3];
    assert_eq!(map.count(&PLACES, &Within { normals: &up, min_cosine: 0.9, ..within }).unwrap(), [19, 7, 0]);
    assert_eq!(map.count(&PLACES, &Within { normals: &down, ..within }).unwrap(), [0; 3]);

    let lists = map.list(&PLACES, &within).unwrap();
    assert_eq!(lists.offsets, [0, 19, 26, 26]);
    let mut corner = lists[1].to_vec();
    corner.sort_unstable();
    assert_eq!(corner, [0, 1, 10, 11, 100, 101, 110]);
    assert!(lists.distances.iter().all(|&d| d < 0.15));

    let nearest = map.nearest(&PLACES, 4).unwrap();
    assert_eq!(&nearest.ids[4..8], [0, 1, 10, 100]);
    assert_eq!(nearest.ids[8], 999);
    let few = map.nearest_within(&PLACES, 4, 0.05, 0.05).unwrap();
    assert_eq!(few.ids[..2], [555, INVALID_ID]);
    assert!(few.distances[1].is_infinite() && few.k == 4);
}

#[test]
fn maps_are_told_saved_and_loaded() {
    let device = room::cpu();
    let map = map(&device);
    let info = map.info().unwrap();
    assert_eq!((info.num_points, info.num_levels, info.radius), (1000, 2, 0.15));
    assert!(info.has_fluxes && info.has_normals && info.bounds[1][0] > 0.89);
    let path = crate::temporary_folder("photons").join("map.gpurt");
    map.save(&path).unwrap();
    let loaded = PhotonMap::load(&device, &path).unwrap();
    let within = Within::new(0.2);
    assert_eq!(loaded.sum(&PLACES, &within).unwrap(), map.sum(&PLACES, &within).unwrap());
    assert!(matches!(PhotonMap::load(&device, path.with_extension("none")), Err(Error::Io(_))));
    // A map lives longer than its device's owner, and chooses a radius.
    let plain = PhotonMapDesc { positions: &lattice(), ..Default::default() };
    let chosen = PhotonMap::new(&room::cpu(), &plain).unwrap();
    assert!(chosen.info().unwrap().radius > 0.05);
    assert!(matches!(chosen.sum(&PLACES, &within), Err(Error::InvalidArgument(text)) if text.contains("fluxes")));
}

#[test]
fn photons_of_a_scene() {
    let scene = room::describe(&room::cpu());
    let desc = PhotonTraceDesc { num_paths: 10000, seed: 1, ..Default::default() };
    assert!(matches!(PhotonMap::trace(&scene, &desc), Err(Error::InvalidArgument(text)) if text.contains("committed")));
    scene.commit().unwrap();
    let map = PhotonMap::trace(&scene, &desc).unwrap();
    let info = map.info().unwrap();
    assert!(info.num_paths == 10000 && info.has_directions && info.num_points > 5000);
    let normals = map.read(PhotonAttribute::Normal).unwrap();
    let directions = map.read(PhotonAttribute::Direction).unwrap();
    assert_eq!(normals.len() as u64, info.num_points);
    assert!(normals.iter().zip(&directions).all(|(n, d)| n[0] * d[0] + n[1] * d[1] + n[2] * d[2] < 0.0));
    let fluxes = map.read(PhotonAttribute::Flux).unwrap();
    let sum: f32 = fluxes.iter().map(|f| f[0]).sum();
    let found = map.sum(&[[0.0; 3]], &Within::new(9.0)).unwrap();
    assert!((found[0][0] / sum - 1.0).abs() < 1e-3);
    let other = PhotonMap::trace(&scene, &PhotonTraceDesc { pass: 1, ..desc }).unwrap();
    assert_ne!(
        other.read(PhotonAttribute::Position).unwrap()[0],
        map.read(PhotonAttribute::Position).unwrap()[0]
    );
}

#[test]
fn refusals() {
    let device = room::cpu();
    let expect = |result: gpurt::Result<()>, text: &str| match result {
        Err(Error::InvalidArgument(found)) => assert!(found.contains(text), "{}", found),
        other => panic!("{:?}", other),
    };
    let points = [[0.0, f32::NAN, 0.0]];
    let desc = PhotonMapDesc { positions: &points, ..Default::default() };
    expect(PhotonMap::new(&device, &desc).map(drop), "positions[0]");
    let desc = PhotonMapDesc { positions: &points, fluxes: &[[1.0; 3]; 2], ..Default::default() };
    expect(PhotonMap::new(&device, &desc).map(drop), "fluxes");
    let map = map(&device);
    expect(map.count(&PLACES, &Within::new(0.0)).map(drop), "radius");
    expect(map.count(&PLACES, &Within { normals: &PLACES[..1], ..Within::new(1.0) }).map(drop), "normals");
    expect(map.nearest(&PLACES, 0).map(drop), "k is 0");
    expect(map.nearest(&PLACES, 513).map(drop), "k is 513");
    assert_eq!(GatherMethod::Grid as u32, 0);
}
