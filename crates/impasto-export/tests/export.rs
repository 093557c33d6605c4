//! Files of points and splats of the built-in synthetic scene, whose depth is exact, as another
//! program reads and draws them.

#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod independent;

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use impasto_export::{ExportError, View, ViewOptions, Views, Watch, export_points, export_splats};
use impasto_scene::builtin::{self, BuiltinOptions};
use impasto_scene::{Camera, Normalisation, Split};
use impasto_train::{ModelPhoto, ModelScene, Stop};
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
fn look(normalisation: Normalisation) -> impl FnMut(&Camera) -> View {
    move |camera| {
        let seen = builtin::render(&in_capture(camera, &normalisation));
        let bytes = seen.pixels.into_raw();
        View {
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
    let mut look = look(scene.normalisation);
    watched(|watch| Views::of(scene, &ViewOptions::default(), &mut look, watch)).unwrap()
}

/// Where pictures for people go, if somebody wants them.
fn kept(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("IMPASTO_TEST_PICTURES")?;
    Some(Path::new(&folder).join(name))
}

/// PSNR of a file's splats against the built-in scene from a camera in scene space.
fn fidelity(ply: &Ply, camera: &Camera, normalisation: Normalisation, name: &str) -> f64 {
    let wanted = look(normalisation)(camera).colours;
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
    between.camera_to_world = (camera.camera_to_world + next.camera_to_world) * 0.5;
    let turn = glam::DQuat::from_mat4(&camera.camera_to_world)
        .slerp(glam::DQuat::from_mat4(&next.camera_to_world), 0.5);
    let middle = (camera.centre() + next.centre()) * 0.5;
    between.camera_to_world = glam::DMat4::from_rotation_translation(turn, middle);
    let other = fidelity(&ply, &between, scene.normalisation, "between.png");
    println!("{} splats: {own:.1} dB, between {other:.1} dB", ply.count);
    assert!(own > 18.0 && other > 18.0, "{own:.2} {other:.2}");
}
