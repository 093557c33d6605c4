//! Viewpoints where nobody stood.

use glam::{DMat4, DQuat};

use crate::camera::Camera;

/// Two that look further apart than this (cosine of their axes, about 45°) see little in common.
const LEAST_ALIGNMENT: f64 = 0.7;

/// A view between two cameras.
#[derive(Debug, Clone, Copy)]
pub struct Between {
    /// Half-way between the two, through the lens of the first.
    pub view: Camera,
    /// Number of the first.
    pub first: usize,
}

/// At most `count` views, each half-way between a camera and the nearest one that looks the same
/// way, spread evenly over the cameras.
pub fn between(cameras: &[Camera], count: usize) -> Vec<Between> {
    let mut pairs: Vec<[usize; 2]> = Vec::new();
    for (i, camera) in cameras.iter().enumerate() {
        let others = cameras.iter().enumerate().filter(|(j, other)| {
            *j != i && camera.forward().dot(other.forward()) > LEAST_ALIGNMENT
        });
        let distance = |other: &Camera| camera.centre().distance_squared(other.centre());
        let nearest = others.min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
        if let Some((j, _)) = nearest
            && !pairs.contains(&[j, i])
        {
            pairs.push([i, j]);
        }
    }
    let step = pairs.len().div_ceil(count.max(1)).max(1);
    let chosen = pairs.iter().step_by(step).take(count);
    let between = chosen.map(|[i, j]| Between {
        view: halfway(&cameras[*i], &cameras[*j]),
        first: *i,
    });
    between.collect()
}

fn halfway(camera: &Camera, other: &Camera) -> Camera {
    let turn = |camera: &Camera| DQuat::from_mat4(&camera.camera_to_world);
    let rotation = turn(camera).slerp(turn(other), 0.5);
    let centre = camera.centre().midpoint(other.centre());
    Camera {
        camera_to_world: DMat4::from_rotation_translation(rotation, centre),
        ..*camera
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::camera::Intrinsics;

    fn at(x: f64, yaw: f64) -> Camera {
        Camera {
            intrinsics: Intrinsics {
                width: 4,
                height: 3,
                fl_x: 4.0,
                fl_y: 4.0,
                cx: 2.0,
                cy: 1.5,
                distortion: crate::Distortion::default(),
            },
            camera_to_world: DMat4::from_rotation_translation(
                DQuat::from_rotation_y(yaw),
                DVec3::new(x, 0.0, 0.0),
            ),
        }
    }

    #[test]
    fn views_lie_between_neighbours_that_look_the_same_way() {
        let cameras = [at(0.0, 0.0), at(1.0, 0.4), at(1.1, 3.0), at(5.0, 0.0)];
        let found = between(&cameras, 9);
        let places: Vec<f64> = found.iter().map(|c| c.view.centre().x).collect();
        // The one that looks back has no neighbour.
        assert_eq!(places, [0.5, 3.0]);
        let gaze = found[0].view.forward();
        let yaw = gaze.x.atan2(gaze.z);
        assert!((yaw - 0.2).abs() < 1e-9);
        assert_eq!(between(&cameras, 1).len(), 1);
        assert!(between(&cameras[..1], 3).is_empty() && between(&cameras, 0).is_empty());
    }
}
