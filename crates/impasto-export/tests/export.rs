//! Files of points and splats of the built-in synthetic scene, whose depth is exact, as another
//! program reads and draws them.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]
#![allow(clippy::print_stdout, reason = "figures, and why a test was skipped")]

mod independent;

use std::path::{Path, PathBuf};

use glam::DVec3;
use impasto_export::{
    ExportError, RgbdView, ViewSelection, Views, Watch, export_points, export_splats,
};
use impasto_model::{ModelPhoto, ModelScene, Stop};
use impasto_scene::builtin::{self, BuiltinOptions};
use impasto_scene::{Camera, Normalisation, Split};
use independent::{Ply, in_capture, psnr, rasterise, save};

/// A built-in capture of so many photos as a model remembers it.
fn scene(photos: usize) -> ModelScene {
    let options = BuiltinOptions {
        photos,
        width: 160,
        height: 120,
        ..BuiltinOptions::default()
    };
    let cameras = builtin::cameras(&options);
    let centres: Vec<DVec3> = cameras.iter().map(Camera::centre).collect();
    let normalisation = Normalisation::of_cameras(&centres).unwrap_or(Normalisation {
        centre: DVec3::new(1.0, 2.0, 3.0),
        scale: 0.1,
    });
    let photo = |(i, camera): (usize, &Camera)| ModelPhoto {
        name: format!("{i:04}.png"),
        split: Split::Train,
        camera: Camera {
            camera_to_world: normalisation.pose_to_scene(camera.camera_to_world),
            ..*camera
        },
    };
    ModelScene {
        name: "the built-in square".into(),
        synthetic: true,
        normalisation,
        photos: cameras.iter().enumerate().map(photo).collect(),
    }
}

/// What the built-in scene looks like from a camera in scene space.
fn render(normalisation: Normalisation) -> impl FnMut(&Camera) -> RgbdView {
    move |camera| {
        let seen = builtin::render(&in_capture(camera, &normalisation));
        let bytes = seen.pixels.into_raw();
        RgbdView {
            colours: bytes.iter().map(|byte| f32::from(*byte) / 255.0).collect(),
            depth: seen
                .depth
                .iter()
                .map(|d| d * normalisation.scale as f32)
                .collect(),
        }
    }
}

fn watched<T>(work: impl FnOnce(&mut Watch<'_>) -> T) -> T {
    let stop = Stop::default();
    work(&mut Watch {
        progress: &mut |_, _| {},
        stop: &stop,
    })
}

fn views(scene: &ModelScene) -> Views {
    let mut render = render(scene.normalisation);
    watched(|watch| Views::of(scene, &ViewSelection::default(), &mut render, watch)).unwrap()
}

/// Where pictures for people go, if somebody wants them.
fn kept(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("IMPASTO_TEST_PICTURES")?;
    Some(Path::new(&folder).join(name))
}

/// PSNR of a file's splats against the built-in scene from a camera in scene space.
fn fidelity(ply: &Ply, camera: &Camera, normalisation: Normalisation, name: &str) -> f64 {
    let wanted = render(normalisation)(camera).colours;
    let found = rasterise(ply, &in_capture(camera, &normalisation));
    let (width, height) = (camera.intrinsics.width, camera.intrinsics.height);
    if let Some(path) = kept(name) {
        save(
            &[wanted.clone(), found.clone()].concat(),
            width,
            2 * height,
            &path,
        );
    }
    psnr(&found, &wanted)
}

#[test]
fn splats_give_the_pictures_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("splats.ply");
    let scene = scene(12);
    let views = views(&scene);
    let exported = watched(|watch| export_splats(&views, &path, watch)).unwrap();
    let ply = Ply::read(&path);
    assert_eq!(ply.count, exported.count);
    assert_eq!(std::fs::metadata(&path).unwrap().len(), exported.bytes);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);

    let camera = scene.photos[3].camera;
    let own = fidelity(&ply, &camera, scene.normalisation, "own.png");
    // Between two that the splats were fitted to.
    let next = scene.photos[4].camera;
    let mut between = camera;
    let turn = glam::DQuat::from_mat4(&camera.camera_to_world)
        .slerp(glam::DQuat::from_mat4(&next.camera_to_world), 0.5);
    let middle = (camera.centre() + next.centre()) * 0.5;
    between.camera_to_world = glam::DMat4::from_rotation_translation(turn, middle);
    let other = fidelity(&ply, &between, scene.normalisation, "between.png");
    println!("{} splats: {own:.1} dB, between {other:.1} dB", ply.count);
    assert!(own > 18.0 && other > 18.0, "{own:.2} {other:.2}");
}

#[test]
fn splats_have_the_standard_properties_in_range_and_say_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("splats.ply");
    let scene = scene(3);
    watched(|watch| export_splats(&views(&scene), &path, watch)).unwrap();
    let ply = Ply::read(&path);
    let wanted = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 \
                  rot_2 rot_3";
    assert_eq!(ply.names().join(" "), wanted);
    assert!(ply.properties.iter().all(|(kind, _)| kind == "float"));
    let said = ply.comments.join("\n");
    for word in ["Impasto", "the built-in square", "synthetic", "coordinates"] {
        assert!(said.contains(word), "{said}");
    }
    for row in 0..ply.count {
        for name in ply.names() {
            assert!(ply.get(name, row).is_finite(), "{name} of splat {row}");
        }
        let turn = ["rot_0", "rot_1", "rot_2", "rot_3"].map(|name| ply.get(name, row));
        let length: f64 = turn.iter().map(|x| x * x).sum();
        assert!((length - 1.0).abs() < 1e-5, "{turn:?}");
        let normal = ply.triple(["nx", "ny", "nz"], row);
        assert!((normal.length() - 1.0).abs() < 1e-3, "{normal}");
        let colour = ply.triple(["f_dc_0", "f_dc_1", "f_dc_2"], row) * 0.282_094_8 + 0.5;
        let within = colour.min_element() > -1e-5 && colour.max_element() < 1.0 + 1e-5;
        assert!(within, "{colour}");
        // The third axis is the thin one.
        let sides = ply.triple(["scale_0", "scale_1", "scale_2"], row);
        assert!(sides.z < sides.y && sides.y <= sides.x + 1e-5, "{sides}");
    }
}

/// A camera at (2, 0, 0) in capture coordinates that looks along x, whose picture is red, and what
/// is 3 units before it in the capture.
fn wall() -> (ModelScene, impl FnMut(&Camera) -> RgbdView) {
    let mut scene = scene(1);
    let (centre, scale) = (DVec3::new(1.0, 2.0, 3.0), 0.25);
    scene.normalisation = Normalisation { centre, scale };
    let pose = glam::DMat4::from_cols(
        (-DVec3::Y).extend(0.0),
        (-DVec3::Z).extend(0.0),
        DVec3::X.extend(0.0),
        DVec3::new(2.0, 0.0, 0.0).extend(1.0),
    );
    scene.photos[0].camera.camera_to_world = scene.normalisation.pose_to_scene(pose);
    let render = move |camera: &Camera| {
        let pixels = (camera.intrinsics.width * camera.intrinsics.height) as usize;
        RgbdView {
            colours: [1.0, 0.0, 0.2].repeat(pixels),
            depth: vec![3.0 * scale as f32; pixels],
        }
    };
    (scene, render)
}

#[test]
fn points_lie_at_their_places_in_the_capture_and_face_the_camera() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.ply");
    let (scene, mut render) = wall();
    let options = ViewSelection::default();
    let exported = watched(|watch| {
        let views = Views::of(&scene, &options, &mut render, watch)?;
        export_points(&views, &path, watch)
    });
    assert_eq!(exported.unwrap().count, 160 * 120);
    let ply = Ply::read(&path);
    assert_eq!(ply.names().join(" "), "x y z nx ny nz red green blue");
    let kinds: Vec<&str> = ply.properties.iter().map(|(k, _)| k.as_str()).collect();
    assert_eq!(kinds, [["float"; 6].as_slice(), &["uchar"; 3]].concat());
    let camera = in_capture(&scene.photos[0].camera, &scene.normalisation);
    for row in 0..ply.count {
        let position = ply.position(row);
        assert!((position.x - 5.0).abs() < 1e-4, "{position}");
        // In the middle of a pixel.
        let (pixel, _) = camera.project(position).unwrap();
        assert!(
            (pixel.fract() - 0.5).abs().max_element() < 1e-2,
            "{position} at {pixel}"
        );
        let normal = ply.triple(["nx", "ny", "nz"], row);
        assert!((normal + DVec3::X).length() < 1e-3, "{normal}");
        assert_eq!(
            ply.triple(["red", "green", "blue"], row),
            DVec3::new(255.0, 0.0, 51.0)
        );
    }
}

#[test]
fn one_photo_is_enough() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("splats.ply");
    let (scene, mut render) = wall();
    watched(|watch| {
        let views = Views::of(&scene, &ViewSelection::default(), &mut render, watch)?;
        export_splats(&views, &path, watch)
    })
    .unwrap();
    let found = fidelity_of(&path, &scene, &render(&scene.photos[0].camera).colours);
    assert!(found > 30.0, "{found:.1} dB");
}

/// PSNR of a file's splats from the first camera against a picture.
fn fidelity_of(path: &Path, scene: &ModelScene, wanted: &[f32]) -> f64 {
    let camera = in_capture(&scene.photos[0].camera, &scene.normalisation);
    psnr(&rasterise(&Ply::read(path), &camera), wanted)
}

#[test]
fn what_other_views_see_through_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.ply");
    let (mut scene, mut render) = wall();
    // Four cameras beside each other; before the first one hangs what the others do not see.
    let first = scene.photos[0].clone();
    for i in 1..4 {
        let mut photo = first.clone();
        photo.name = format!("{i:04}.png");
        photo.camera.camera_to_world.w_axis.y += 0.01 * f64::from(i);
        scene.photos.push(photo);
    }
    let mut number = 0;
    let mut haunted = |camera: &Camera| {
        let mut view = render(camera);
        if number == 0 {
            for y in 40..60 {
                view.depth[y * 160 + 40..y * 160 + 60].fill(0.3);
            }
        }
        number += 1;
        view
    };
    watched(|watch| {
        let views = Views::of(&scene, &ViewSelection::default(), &mut haunted, watch)?;
        export_points(&views, &path, watch)
    })
    .unwrap();
    let ply = Ply::read(&path);
    assert!(ply.count >= 160 * 120, "{}", ply.count);
    for row in 0..ply.count {
        assert!(ply.position(row).x > 4.9, "{}", ply.position(row));
    }
}

#[test]
fn what_cannot_be_exported_is_told_in_a_sentence_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("out.ply");
    let (full, mut render) = wall();
    let options = ViewSelection::default();
    let mut empty = full.clone();
    empty.photos.clear();
    let none = watched(|watch| Views::of(&empty, &options, &mut render, watch));
    assert!(none.unwrap_err().to_string().contains("no training views"));

    let mut nothing = |camera: &Camera| {
        let mut view = render(camera);
        view.depth.fill(f32::INFINITY);
        view
    };
    let sky = watched(|watch| Views::of(&full, &options, &mut nothing, watch)).unwrap();
    for export in [export_points, export_splats] {
        let problem = watched(|watch| export(&sky, &path, watch)).unwrap_err();
        assert!(problem.to_string().contains("shows a surface"), "{problem}");
    }

    let views = watched(|watch| Views::of(&full, &options, &mut render, watch)).unwrap();
    let missing = folder.path().join("missing/out.ply");
    let problem = watched(|watch| export_points(&views, &missing, watch)).unwrap_err();
    assert!(problem.to_string().contains("out.ply"), "{problem}");

    let stop = Stop::default();
    stop.request();
    let mut watch = Watch {
        progress: &mut |_, _| {},
        stop: &stop,
    };
    let stopped = export_splats(&views, &path, &mut watch).unwrap_err();
    assert!(matches!(stopped, ExportError::Stopped));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
