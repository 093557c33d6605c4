//! What a camera pose from a file must satisfy.

use glam::{DMat3, DMat4, DVec3};

/// How far `RᵀR` may be from the identity, in any entry: files round their numbers.
const TOLERANCE: f64 = 1e-3;

/// Farthest coordinate of a camera. Millimetres from the Earth's middle are below; far above, squares
/// of distances overflow.
const FARTHEST: f64 = 1e12;

/// Camera axes x right, y up, z backward (OpenGL, Blender) to x right, y down, z forward;
/// the same the other way round.
pub(crate) fn from_opengl(camera_to_world: DMat4) -> DMat4 {
    camera_to_world * DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0))
}

/// The pose as an exactly rigid transform, or what is wrong with it, as the end of a sentence
/// that begins with "pose of frame …".
pub(crate) fn rigid(pose: DMat4) -> Result<DMat4, String> {
    if !pose.is_finite() {
        return Err("holds NaN or infinite numbers; compute it again or remove the frame".into());
    }
    let bottom = pose.row(3);
    if bottom.truncate().abs().max_element() > 1e-6 || (bottom.w - 1.0).abs() > 1e-6 {
        return Err(format!(
            "has the last row {:?}, which must be [0, 0, 0, 1]",
            bottom.to_array()
        ));
    }
    let centre = pose.w_axis.truncate();
    if centre.abs().max_element() > FARTHEST {
        return Err(format!(
            "puts the camera at {:e}, {:e}, {:e}, too far out to compute with; move the capture to \
             the origin",
            centre.x, centre.y, centre.z
        ));
    }
    let rotation = DMat3::from_mat4(pose);
    let error = rotation.transpose() * rotation - DMat3::IDENTITY;
    let off = error
        .to_cols_array()
        .into_iter()
        .fold(0.0, |worst: f64, x| worst.max(x.abs()));
    let determinant = rotation.determinant();
    if off > TOLERANCE || determinant < 0.0 {
        return Err(format!(
            "is not a rotation (determinant {determinant:.3}, axes off by {off:.3}); scaled, \
             skewed or mirrored poses cannot be used, export rigid ones"
        ));
    }
    let mut rigid = DMat4::from_mat3(nearest_rotation(rotation));
    rigid.w_axis = pose.w_axis;
    Ok(rigid)
}

/// The closest rotation to a matrix that nearly is one (Newton's iteration for the polar
/// decomposition: it converges quadratically, so three rounds take 1e-3 below rounding).
fn nearest_rotation(mut rotation: DMat3) -> DMat3 {
    for _ in 0..3 {
        rotation = (rotation + rotation.inverse().transpose()) * 0.5;
    }
    rotation
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_repaired_and_the_centre_kept() {
        let exact =
            DMat4::from_rotation_y(0.7) * DMat4::from_translation(DVec3::new(1.0, 2.0, 3.0));
        let mut rounded = exact;
        rounded.x_axis.y += 3e-4;
        let repaired = rigid(rounded).unwrap();
        let r = DMat3::from_mat4(repaired);
        assert!((r.transpose() * r).abs_diff_eq(DMat3::IDENTITY, 1e-14));
        assert_eq!(repaired.w_axis, exact.w_axis);
    }

    #[test]
    fn what_is_no_rotation_is_refused_with_its_reason() {
        let scaled = DMat4::from_scale(DVec3::splat(1.2));
        assert!(rigid(scaled).unwrap_err().contains("determinant 1.728"));
        let mirrored = DMat4::from_scale(DVec3::new(1.0, -1.0, 1.0));
        assert!(rigid(mirrored).unwrap_err().contains("determinant -1.000"));
        let mut poisoned = DMat4::IDENTITY;
        poisoned.w_axis.x = f64::NAN;
        assert!(rigid(poisoned).unwrap_err().contains("NaN"));
        let mut far = DMat4::IDENTITY;
        far.w_axis.y = 2e12;
        assert!(rigid(far).unwrap_err().contains("too far out"));
        let mut projective = DMat4::IDENTITY;
        projective.x_axis.w = 0.5;
        assert!(rigid(projective).unwrap_err().contains("last row"));
    }

    #[test]
    fn opengl_cameras_look_along_minus_z_with_y_up() {
        let pose = from_opengl(DMat4::IDENTITY);
        assert_eq!(pose.z_axis.truncate(), -DVec3::Z);
        assert_eq!(pose.y_axis.truncate(), -DVec3::Y);
        assert_eq!(pose.x_axis.truncate(), DVec3::X);
    }
}
