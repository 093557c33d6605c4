//! True depth along a path, where it is known: on the built-in scene.

use impasto_model::ModelScene;
use impasto_scene::{Camera, builtin};

/// Depth of every camera's view, traced in the built-in scene and in the model's scene units;
/// `None` if the model is of another scene, or there is no camera.
///
/// Houses and trees around the place have their depth like everything near. Sky and hills have an
/// infinite one, which is exact: their colour depends on the direction alone, so their flow does
/// too, and they are compared like any surface.
pub(crate) fn depths(scene: &ModelScene, path: &[Camera]) -> Option<Vec<Vec<f32>>> {
    let way = &scene.normalisation;
    let in_capture = |camera: &Camera| way.pose_to_capture(camera.camera_to_world);
    let poses: Vec<_> = scene.photos.iter().map(|p| in_capture(&p.camera)).collect();
    if path.is_empty() || !scene.synthetic || !builtin::is_capture(&poses) {
        return None;
    }
    let views = path.iter().map(|camera| {
        let mut depth = builtin::depth(&Camera {
            camera_to_world: in_capture(camera),
            ..*camera
        });
        depth.iter_mut().for_each(|d| *d *= way.scale as f32);
        depth
    });
    Some(views.collect())
}

/// Median over all pixels that show something near of the difference of rendered to true depth,
/// relative to the latter; NaN if none does.
pub(crate) fn depth_error(rendered: &[Vec<f32>], truth: &[Vec<f32>]) -> f64 {
    let pairs = rendered.iter().flatten().zip(truth.iter().flatten());
    let mut errors: Vec<f32> = pairs
        .filter(|(_, truth)| truth.is_finite())
        .map(|(found, truth)| (found - truth).abs() / truth)
        .collect();
    if errors.is_empty() {
        return f64::NAN;
    }
    let middle = errors.len() / 2;
    f64::from(*errors.select_nth_unstable_by(middle, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use crate::flow::{Correspondence, FrameGeometry};
    use glam::DVec3;
    use impasto_model::ModelPhoto;
    use impasto_scene::builtin::{BuiltinOptions, cameras};
    use impasto_scene::{Normalisation, Split};

    /// What a model of a built-in capture remembers of it.
    fn scene() -> ModelScene {
        let options = BuiltinOptions {
            photos: 24,
            width: 120,
            height: 90,
            ..BuiltinOptions::default()
        };
        let cameras = cameras(&options);
        let centres: Vec<DVec3> = cameras.iter().map(Camera::centre).collect();
        let normalisation = Normalisation::of_cameras(&centres).unwrap();
        let photos = cameras.into_iter().map(|camera| ModelPhoto {
            name: String::new(),
            split: Split::Train,
            camera: Camera {
                camera_to_world: normalisation.pose_to_scene(camera.camera_to_world),
                ..camera
            },
        });
        ModelScene {
            name: "test".into(),
            synthetic: true,
            normalisation,
            photos: photos.collect(),
        }
    }

    /// Depth, scene units, of what a camera sees at an image position: its picture cut down to the
    /// one pixel whose centre that is.
    fn met(scene: &ModelScene, camera: &Camera, x: f64, y: f64) -> f64 {
        let mut one = *camera;
        (one.intrinsics.width, one.intrinsics.height) = (1, 1);
        one.intrinsics.cx += 0.5 - x;
        one.intrinsics.cy += 0.5 - y;
        f64::from(depths(scene, &[one]).unwrap()[0][0])
    }

    #[test]
    fn hidden_places_do_not_count() {
        let scene = scene();
        let [first, second] = [3, 4].map(|i| scene.photos[i].camera);
        let depth = depths(&scene, &[first, second]).unwrap();
        let geometry = |camera, i: usize| FrameGeometry {
            camera,
            depth: &depth[i],
        };
        let found = Correspondence::exact(&geometry(&first, 0), &geometry(&second, 1));
        // Hidden and visible places, and how many of them count.
        let (mut hidden, mut visible) = ([0, 0], [0, 0]);
        for (i, depth) in depth[0].iter().enumerate().filter(|(_, d)| d.is_finite()) {
            let ray = first.ray((i % 120) as f64 + 0.5, (i / 120) as f64 + 0.5);
            let point = ray.origin + ray.direction * f64::from(*depth);
            let Some((place, expected)) = second.project(point) else {
                continue;
            };
            if found.flow.vectors[i].is_none() {
                continue;
            }
            let share = |dx, dy| met(&scene, &second, place.x + dx, place.y + dy) / expected;
            // At an outline, what a pixel's centre shows may be seen although the place is not.
            let around = [
                (0.0, 0.0),
                (-0.5, -0.5),
                (0.5, -0.5),
                (-0.5, 0.5),
                (0.5, 0.5),
            ];
            let count = if around.iter().all(|(dx, dy)| share(*dx, *dy) < 0.9) {
                &mut hidden
            } else if (share(0.0, 0.0) - 1.0).abs() < 1e-3 {
                &mut visible
            } else {
                continue;
            };
            count[0] += 1;
            count[1] += usize::from(found.mask[i]);
        }
        // Slats and posts thinner than a pixel stay undecided.
        assert!(hidden[0] > 500 && hidden[1] * 200 < hidden[0], "{hidden:?}");
        assert!(
            visible[0] > 3000 && visible[1] * 2 > visible[0],
            "{visible:?}"
        );
    }

    #[test]
    fn sky_counts_and_moves_with_the_direction_alone() {
        let scene = scene();
        let camera = scene.photos[3].camera;
        // A step to the right: what is near moves, the sky does not.
        let mut beside = camera;
        beside.camera_to_world.w_axis += camera.camera_to_world.x_axis * 0.02;
        let depth = depths(&scene, &[camera, beside]).unwrap();
        let geometry = |camera, i: usize| FrameGeometry {
            camera,
            depth: &depth[i],
        };
        let found = Correspondence::exact(&geometry(&camera, 0), &geometry(&beside, 1));
        let sky = (0..depth[0].len()).filter(|i| depth[0][*i].is_infinite());
        let moved = sky.clone().map(|i| found.flow.vectors[i].unwrap());
        assert!(moved.into_iter().flatten().all(|v| v.abs() < 1e-2));
        let counted = sky.clone().filter(|i| found.mask[*i]).count();
        assert!(sky.count() < counted * 2, "most of the sky is compared");
    }

    #[test]
    fn other_scenes_have_no_known_depth() {
        let path = [scene().photos[0].camera];
        assert!(depths(&scene(), &path).is_some() && depths(&scene(), &[]).is_none());
        let mut photographed = scene();
        photographed.synthetic = false;
        assert!(depths(&photographed, &path).is_none());
        // Synthetic too, but of other places.
        let mut other = scene();
        other.normalisation.scale *= 1.01;
        assert!(depths(&other, &path).is_none());
    }

    #[test]
    fn the_depth_error_is_a_share_of_what_is_near() {
        let truth = [vec![1.0, 2.0, f32::INFINITY], vec![4.0]];
        let rendered = [vec![1.1, 2.2, 3.0], vec![4.4]];
        assert!((depth_error(&rendered, &truth) - 0.1).abs() < 1e-6);
        let sky = [vec![f32::INFINITY]];
        assert!(depth_error(&sky, &sky).is_nan());
    }
}
