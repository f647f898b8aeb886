//! Frames and jobs.
use std::sync::mpsc;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use gpurt::{
    Accel, Error, Frame, FrameDesc, Job, Output, PhotonEstimator, PhotonRemedy, PhotonSettings, Pipeline,
    RenderDesc, ReyesFilter, ReyesSettings, Schedule, StateInfo, Tile, Traversal,
};

use crate::room;

const MANY: u32 = 1_000_000; // samples: minutes of work

fn color(frame: &Frame) -> Vec<[f32; 3]> {
    frame.read(Output::Color).unwrap()
}

#[test]
fn an_image_is_colour_and_alpha() {
    let scene = room::create(&room::cpu());
    let image = scene.render(&FrameDesc::new(20, 10), &RenderDesc::new().samples(8)).unwrap();
    assert_eq!((image.width, image.height, image.pixels.len()), (20, 10, 200));
    let frame = Frame::new(&scene, &FrameDesc::new(20, 10)).unwrap();
    frame.render(&RenderDesc::new().samples(8)).unwrap();
    let alpha: Vec<f32> = frame.read(Output::Alpha).unwrap();
    for (pixel, (color, alpha)) in image.pixels.iter().zip(color(&frame).iter().zip(alpha)) {
        assert_eq!(*pixel, [color[0], color[1], color[2], alpha]);
    }
    // The room fills the middle of the image; beside it there is nothing.
    assert_eq!((image.pixels[5 * 20 + 10][3], image.pixels[5 * 20][3]), (1.0, 0.0));
    assert!(image.pixels[5 * 20 + 10][0] > 0.0);
}

#[test]
fn statistics_tell_what_was_done() {
    let frame = Frame::new(&room::create(&room::cpu()), &FrameDesc::new(16, 8).seed(5)).unwrap();
    frame.render(&RenderDesc::new().samples(4).max_depth(3)).unwrap();
    let statistics = frame.statistics().unwrap();
    assert_eq!((statistics.width, statistics.height, statistics.seed), (16, 8, 5));
    assert_eq!((statistics.pipeline, statistics.max_depth), (Pipeline::Path, 3));
    assert_eq!((statistics.samples_per_pixel, statistics.num_samples), (4, 16 * 8 * 4));
    assert_eq!((statistics.num_nonfinite, statistics.num_saturated), (0, 0));
    assert!(matches!(statistics.accel, Accel::Embree | Accel::Kdtree | Accel::Bvh));
    assert!(!statistics.reason.is_empty());
    assert_eq!(statistics.schedule_counters.wave_splits, 0);
}

#[test]
fn settings_of_photon_mapping_are_taken_and_resolved() {
    let scene = room::create(&room::cpu());
    let frame = Frame::new(&scene, &FrameDesc::new(8, 8)).unwrap();
    let photon = PhotonSettings {
        photons_per_pass: 5000,
        initial_radius: 0.125,
        remedies: Some(vec![PhotonRemedy::Normal, PhotonRemedy::Continue]),
        ..Default::default()
    };
    let render = RenderDesc::new().pipeline(Pipeline::Photon).photon(photon).samples(2);
    frame.render(&render).unwrap();
    let statistics = frame.statistics().unwrap();
    let resolved = statistics.photon.unwrap();
    assert_eq!((resolved.photons_per_pass, resolved.initial_radius), (5000, 0.125));
    assert_eq!(resolved.estimator, PhotonEstimator::Memoryless);
    assert_eq!(resolved.kernel, gpurt::PhotonKernel::Constant);
    assert_eq!(resolved.remedies, Some(vec![PhotonRemedy::Normal, PhotonRemedy::Continue]));
    assert_eq!(statistics.photon_counters.num_emitted, 10_000);
    assert!(statistics.photon_counters.num_gathered > 0);
    assert_eq!(statistics.reyes, None);

    let bare = Frame::new(&scene, &FrameDesc::new(8, 8)).unwrap();
    let none = PhotonSettings { photons_per_pass: 5000, remedies: Some(vec![]), ..Default::default() };
    bare.render(&RenderDesc::new().pipeline(Pipeline::Photon).photon(none.clone()).samples(1)).unwrap();
    assert_eq!(bare.statistics().unwrap().photon.unwrap().remedies, Some(vec![]));
    let error = bare.render(&RenderDesc::new().photon(none)).unwrap_err();
    assert!(matches!(&error, Error::InvalidArgument(text) if text.contains("photon")), "{}", error);
}

#[test]
fn settings_of_reyes_are_taken_and_resolved() {
    let frame = Frame::new(&room::create(&room::cpu()), &FrameDesc::new(8, 8)).unwrap();
    let reyes = ReyesSettings { filter: ReyesFilter::Gaussian, no_shadows: true, ..Default::default() };
    frame.render(&RenderDesc::new().pipeline(Pipeline::Reyes).reyes(reyes).samples(4)).unwrap();
    let statistics = frame.statistics().unwrap();
    let resolved = statistics.reyes.unwrap();
    assert_eq!((resolved.shading_rate, resolved.filter), (0.375, ReyesFilter::Gaussian));
    assert!(resolved.no_shadows && resolved.shading == gpurt::ReyesShading::Samples);
    assert!(statistics.reyes_counters.num_triangles > 0);
    assert_eq!((statistics.reyes_counters.num_patches, statistics.photon), (0, None));
}

#[test]
fn schedules_are_resolved_and_refused() {
    let frame = Frame::new(&room::create(&room::cpu()), &FrameDesc::new(8, 8)).unwrap();
    let stack = Schedule { traversal: Traversal::Stack, ..Default::default() };
    frame.render(&RenderDesc::new().samples(1).schedule(stack)).unwrap();
    let resolved = frame.statistics().unwrap().schedule;
    assert_eq!((resolved.traversal, resolved.launch), (Traversal::Stack, gpurt::Launch::Regular));
    let uber = Schedule { traversal: Traversal::Uber, ..Default::default() };
    let error = frame.render(&RenderDesc::new().samples(2).schedule(uber)).unwrap_err();
    assert!(matches!(&error, Error::Unsupported(text) if text.contains("schedule.traversal")), "{}", error);
}

#[test]
fn cancelled_jobs_go_on_to_the_same_bits() {
    let scene = room::create(&room::cpu());
    let desc = FrameDesc::new(32, 32);
    let interrupted = Frame::new(&scene, &desc).unwrap();
    let job = interrupted.submit(&RenderDesc::new().samples(MANY)).unwrap();
    assert_eq!(job.wait_timeout(Duration::ZERO), Ok(false));
    while interrupted.statistics().unwrap().samples_per_pixel < 2 {
        assert_eq!(job.wait_timeout(Duration::from_millis(5)), Ok(false));
    }
    // Samples are in the frame a moment before progress tells of them.
    while job.progress().unwrap() == 0.0 {
        assert_eq!(job.wait_timeout(Duration::from_millis(1)), Ok(false));
    }
    let start = Instant::now();
    job.cancel().unwrap();
    assert!(matches!(job.wait(), Err(Error::Cancelled(_))));
    // The library promises half a second; the rest is for a machine that does other things too.
    assert!(start.elapsed() < Duration::from_secs(5));
    assert!(matches!(job.wait_timeout(Duration::MAX), Err(Error::Cancelled(_))));

    // Up to the next multiple of 64, in two steps.
    let samples = interrupted.read::<u32>(Output::SampleCount).unwrap().into_iter().max().unwrap();
    let total = samples / 64 * 64 + 64;
    interrupted.render(&RenderDesc::new().samples(total)).unwrap();
    let whole = Frame::new(&scene, &desc).unwrap();
    whole.render(&RenderDesc::new().samples(total)).unwrap();
    assert_eq!(color(&interrupted), color(&whole));
}

#[test]
fn a_dropped_job_is_cancelled() {
    let frame = Frame::new(&room::create(&room::cpu()), &FrameDesc::new(32, 32)).unwrap();
    let job = frame.submit(&RenderDesc::new().samples(MANY)).unwrap();
    let clone = job.clone();
    drop(job);
    assert_eq!(clone.wait_timeout(Duration::from_millis(20)), Ok(false), "its other owner keeps it running");
    drop(clone);
    // Jobs of one frame run one after another: this one would wait for minutes.
    let start = Instant::now();
    let _ = frame.submit(&RenderDesc::new().samples(1)).unwrap().wait();
    assert!(start.elapsed() < Duration::from_secs(10));
}

#[test]
fn progress_is_told() {
    let frame = Frame::new(&room::create(&room::cpu()), &FrameDesc::new(32, 32)).unwrap();
    let (sender, calls) = mpsc::channel();
    let sender = Mutex::new(sender);
    let frame_too = frame.clone();
    let render = RenderDesc::new().samples(MANY).progress(move |done, total| {
        let inside = frame_too.statistics(); // would wait for this very function
        let _ = sender.lock().unwrap().send((done, total, inside));
    });
    let job = frame.submit(&render).unwrap();
    for _ in 0..3 {
        let (done, total, inside) = calls.recv_timeout(Duration::from_secs(60)).unwrap();
        // The library derives the total from the share that is done, which it rounds.
        let expected = 32.0 * 32.0 * f64::from(MANY);
        assert!(done > 0.0 && done < total && (total / expected - 1.0).abs() < 0.01, "{} of {}", done, total);
        assert!(matches!(inside, Err(Error::InvalidArgument(_))));
    }
    drop(job);
    drop(render);
    // Nobody holds the closure any more.
    while calls.recv_timeout(Duration::from_secs(60)).is_ok() {}
    assert_eq!(calls.try_recv().unwrap_err(), mpsc::TryRecvError::Disconnected);
}

#[test]
fn a_progress_function_may_drop_its_own_job() {
    let frame = Frame::new(&room::create(&room::cpu()), &FrameDesc::new(32, 32)).unwrap();
    let own: Arc<Mutex<Option<Job>>> = Arc::default();
    let own_too = own.clone();
    let (sender, dropped) = mpsc::channel();
    let sender = Mutex::new(sender);
    let render = RenderDesc::new().samples(MANY).progress(move |_, _| {
        if let Some(job) = own_too.lock().unwrap().take() {
            drop(job);
            let _ = sender.lock().unwrap().send(());
        }
    });
    *own.lock().unwrap() = Some(frame.submit(&render).unwrap());
    dropped.recv_timeout(Duration::from_secs(60)).unwrap();
    let start = Instant::now();
    let _ = frame.submit(&RenderDesc::new().samples(1)).unwrap().wait();
    assert!(start.elapsed() < Duration::from_secs(10));
}

#[test]
fn parts_merge_to_the_same_bits() {
    let scene = room::create(&room::cpu());
    let part = |first: u64, count: u32| {
        let frame = Frame::new(&scene, &FrameDesc::new(16, 16).first_sample(first)).unwrap();
        frame.render(&RenderDesc::new().samples(count)).unwrap();
        frame
    };
    let (a, b, c, whole) = (part(0, 3), part(3, 4), part(7, 1), part(0, 8));
    let file = crate::temporary_folder("merge").join("c.gpurt");
    c.save(&file).unwrap();
    let info = StateInfo::read(&file).unwrap();
    assert_eq!((info.width, info.height, info.first_sample, info.num_samples), (16, 16, 7, 16 * 16));
    assert_eq!((info.pipeline, info.outputs.contains(&Output::Color)), (Pipeline::Path, true));
    assert_eq!((info.camera, info.accel), (gpurt::CameraId(0), c.statistics().unwrap().accel));
    let loaded = Frame::new(&scene, &info.frame_desc()).unwrap();
    loaded.load_state(&file).unwrap();
    assert_eq!(color(&loaded), color(&c));
    b.load_state(&file).unwrap();
    a.merge(&b).unwrap();
    assert_eq!(color(&a), color(&whole));
    assert!(matches!(a.merge(&b), Err(Error::InvalidArgument(_))), "samples would count twice");
    assert_eq!(color(&a), color(&whole));
}

#[test]
fn tiles_are_rendered_alone() {
    let frame = Frame::new(&room::create(&room::cpu()), &FrameDesc::new(8, 4)).unwrap();
    let tile = Tile { x0: 2, y0: 1, x1: 5, y1: 3 };
    frame.submit_tiles(&RenderDesc::new().samples(2), &[tile]).unwrap().wait().unwrap();
    let counts = frame.read::<u32>(Output::SampleCount).unwrap();
    for (i, count) in counts.into_iter().enumerate() {
        let (x, y) = (i % 8, i / 8);
        assert_eq!(count, if (2..5).contains(&x) && (1..3).contains(&y) { 2 } else { 0 });
    }
}

#[test]
fn frames_are_saved() {
    let folder = crate::temporary_folder("save");
    let frame = Frame::new(&room::create(&room::cpu()), &FrameDesc::new(8, 4)).unwrap();
    frame.render(&RenderDesc::new().samples(1)).unwrap();
    for (name, magic) in [("image.exr", &[0x76, 0x2f, 0x31, 0x01]), ("image.png", b"\x89PNG")] {
        frame.save(folder.join(name)).unwrap();
        assert_eq!(std::fs::read(folder.join(name)).unwrap()[..4], magic[..]);
    }
}
