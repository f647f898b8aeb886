//! Ray queries and tree exchange.
use gpurt::{
    Accel, BuildDesc, Camera, Coherence, Error, Hit, HitCompact, KdTreeNodeKind, Mesh, Patches, Ray, Scene, TriangleTest,
    IDENTITY, INVALID_ID,
};

use crate::room;

/// Two unit triangles over each other, at z = 0 and z = 1, as instances of one mesh.
fn two_layers(accel: Accel) -> Scene {
    let scene = Scene::new(&room::cpu()).unwrap();
    let triangle = scene.add_mesh(&Mesh::new(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])).unwrap();
    scene.add_instance(triangle, IDENTITY).unwrap();
    let mut above = IDENTITY;
    above[2][3] = 1.0;
    scene.add_instance(triangle, above).unwrap();
    scene.commit_with(&BuildDesc { accel, ..Default::default() }).unwrap();
    scene
}

/// Down through both, up between them, and past them.
fn rays() -> [Ray; 3] {
    [
        Ray::new([0.25, 0.5, 3.0], [0.0, 0.0, -1.0]),
        Ray::new([0.25, 0.5, 0.5], [0.0, 0.0, 1.0]),
        Ray::new([0.75, 0.75, 3.0], [0.0, 0.0, -1.0]).clip(0.0, 7.0),
    ]
}

#[test]
fn hits_lead_to_patches() {
    let scene = Scene::new(&room::cpu()).unwrap();
    // A flat patch over the unit square: its parameters are x and y.
    let points: Vec<[f32; 3]> = (0..16).map(|k| [(k % 4) as f32 / 3.0, (k / 4) as f32 / 3.0, 0.0]).collect();
    let patches = scene.add_patches(&Patches::new(&points)).unwrap();
    scene.add_instance(patches, IDENTITY).unwrap();
    let mut over = Camera::default();
    over.transform[2][3] = 2.0;
    scene.add_camera(&over).unwrap();
    let build = BuildDesc { patch_pixels: 0.5, patch_width: 64, patch_height: 32, ..Default::default() };
    scene.commit_with(&build).unwrap();
    // Flat, but for rounding.
    assert!(scene.facts().unwrap().patch_error_pixels < 1e-5);

    let rays = [Ray::new([0.25, 0.5, 1.0], [0.0, 0.0, -1.0]), Ray::new([2.0, 2.0, 1.0], [0.0, 0.0, -1.0])];
    let hits = scene.closest(&rays).unwrap();
    let surface = scene.locate_surface(&hits).unwrap();
    assert_eq!(surface.points, scene.locate(&hits).unwrap());
    let found = surface.points[0];
    assert_eq!(found.patch, 0);
    assert!((found.u - 0.25).abs() < 1e-6 && (found.v - 0.5).abs() < 1e-6, "{:?}", found);
    assert!((surface.positions[0][0] - 0.25).abs() < 1e-6 && surface.normals[0][2] > 0.999, "{:?}", surface);
    assert!(surface.points[1].is_miss());
    let mut compact = [HitCompact::default(); 2];
    scene.closest_into(&rays, &mut compact).unwrap();
    assert_eq!(scene.locate_compact(&compact, patches).unwrap(), surface.points);
    assert!(scene.locate(&[]).unwrap().is_empty());

    let mut wrong = hits;
    wrong[0].primitive = 1000;
    assert!(matches!(scene.locate(&wrong), Err(Error::InvalidArgument(text)) if text.contains("hit 0 is of primitive 1000")));
}

#[test]
fn queries_agree() {
    // The kd-tree's t is exact here; Embree's is rounded.
    for (accel, tolerance) in [(Accel::Kdtree, 0.0), (Accel::Bvh, 0.0), (Accel::Embree, 1e-6)] {
        let close = |a: f32, b: f32| (a - b).abs() <= tolerance;
        let scene = two_layers(accel);
        let hits = scene.closest(&rays()).unwrap();
        let found: Vec<_> = hits.iter().map(|hit| (hit.primitive, hit.geometry, hit.instance)).collect();
        assert_eq!(found, [(0, 0, 1), (0, 0, 1), (INVALID_ID, INVALID_ID, INVALID_ID)]);
        assert!(close(hits[0].t, 2.0) && close(hits[1].t, 0.5) && hits[2].t == 7.0, "{:?}", hits);
        assert!(close(hits[0].u, 0.25) && close(hits[0].v, 0.5), "{:?}", hits);
        assert_eq!(hits.iter().map(Hit::is_miss).collect::<Vec<_>>(), [false, false, true]);

        let mut compact = [HitCompact::default(); 3];
        scene.closest_into(&rays(), &mut compact).unwrap();
        for (compact, hit) in compact.iter().zip(&hits) {
            assert_eq!((compact.t, compact.u, compact.v), (hit.t, hit.u, hit.v));
            assert_eq!((compact.primitive, compact.is_miss()), (hit.primitive, hit.is_miss()));
        }

        assert_eq!(scene.occluded(&rays()).unwrap(), [true, true, false]);

        let all = scene.all(&rays()).unwrap();
        assert_eq!(all.offsets, [0, 2, 3, 3]);
        let instances: Vec<Vec<_>> =
            all.iter().map(|hits| hits.iter().map(|hit| hit.instance).collect()).collect();
        assert_eq!(instances, [vec![1, 0], vec![1], vec![]]);
        assert!(close(all[0][0].t, 2.0) && close(all[0][1].t, 3.0));
        assert!(close(all[1][0].t, 0.5) && all[1][0].primitive == 0);

        let nothing = scene.all(&[]).unwrap();
        assert_eq!((nothing.hits.len(), nothing.iter().count()), (0, 0));
        assert!(scene.closest(&[]).unwrap().is_empty());
    }
}

#[test]
fn hints_change_no_hit() {
    let scene = two_layers(Accel::Bvh);
    let hits = scene.closest(&rays()).unwrap();
    // The last row of an image may be short.
    for (coherence, width) in [(Coherence::Auto, 0), (Coherence::Coherent, 3), (Coherence::Incoherent, 2)] {
        let tracer = scene.tracer().coherence(coherence).image_width(width);
        assert_eq!(tracer.closest(&rays()).unwrap(), hits);
        assert_eq!(tracer.occluded(&rays()).unwrap(), [true, true, false]);
        assert_eq!(tracer.all(&rays()).unwrap().offsets, [0, 2, 3, 3]);
    }
}

#[test]
fn outputs_must_have_room() {
    let scene = two_layers(Accel::Kdtree);
    let is_invalid = |result| matches!(result, Err(Error::InvalidArgument(_)));
    assert!(is_invalid(scene.closest_into(&rays(), &mut [Hit::default(); 2])));
    assert!(is_invalid(scene.occluded_into(&rays(), &mut [0; 4])));
    assert!(is_invalid(scene.count_into(&rays(), &mut [0; 3]).map(drop)));

    // Too small for the hits: the error says so, and the offsets how many there are.
    let (mut hits, mut offsets) = ([HitCompact::default(); 2], [0; 4]);
    assert!(is_invalid(scene.all_into(&rays(), &mut hits, &mut offsets).map(drop)));
    assert_eq!(offsets[3], 3);
    let mut hits = [HitCompact::default(); 5];
    assert_eq!(scene.all_into(&rays(), &mut hits, &mut offsets), Ok(3));
    assert_eq!((hits[2].t, hits[3]), (0.5, HitCompact::default()));
    assert_eq!(scene.count_into(&rays(), &mut offsets), Ok(3));
}

#[test]
fn a_segment_ends_at_its_second_point() {
    let scene = two_layers(Accel::Kdtree);
    let through = Ray::between([0.25, 0.25, 0.5], [0.25, 0.25, 1.5]);
    let before = Ray::between([0.25, 0.25, 0.5], [0.25, 0.25, 0.875]);
    assert_eq!(scene.occluded(&[through, before]).unwrap(), [true, false]);
    assert_eq!(scene.closest(&[through]).unwrap()[0].t, 0.5);
}

#[test]
fn a_tree_goes_from_scene_to_scene() {
    let device = room::cpu();
    let build = BuildDesc { accel: Accel::Kdtree, triangle_test: TriangleTest::Double, ..Default::default() };
    let first = room::describe(&device);
    first.commit_with(&build).unwrap();
    let tree = first.export_tree(0).unwrap();
    let facts = first.facts().unwrap();
    assert_eq!(tree.num_triangles, facts.num_triangles);
    assert_eq!(
        (tree.nodes.len() as u64, tree.references.len() as u64),
        (facts.num_nodes, facts.num_references)
    );
    assert_eq!((facts.accel, facts.triangle_test), (Accel::Kdtree, TriangleTest::Double));
    let mut references = 0;
    for node in &tree.nodes {
        match node.kind() {
            KdTreeNodeKind::Leaf { count, .. } => references += count as usize,
            KdTreeNodeKind::Inner { axis, plane, .. } => {
                let axis = axis as usize;
                assert!(plane >= tree.bounds_min[axis] && plane <= tree.bounds_max[axis]);
            }
        }
        assert_eq!(gpurt::KdTreeNode::from(node.kind()), *node);
    }
    assert!(references >= tree.references.len());

    let second = room::describe(&device);
    second.import_tree(&tree).unwrap();
    second.commit_with(&build).unwrap();
    assert!(second.facts().unwrap().tree_from_cache && !facts.tree_from_cache);
    assert_eq!(second.export_tree(0).unwrap(), tree);
    let rays: Vec<Ray> =
        (0..100).map(|i| Ray::new([0.0, 0.0, 3.0], [i as f32 / 100.0 - 0.5, 0.1, -1.0])).collect();
    assert_eq!(first.closest(&rays), second.closest(&rays));

    let mut broken = tree;
    broken.nodes[0].tag = 0x7fff_fffc;
    assert!(matches!(second.import_tree(&broken), Err(Error::InvalidArgument(_))));
    assert!(matches!(second.export_tree(99), Err(Error::InvalidArgument(_))));
}
