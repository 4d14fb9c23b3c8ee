//! Rigid poses, always written `world_from_camera`: `p_world = R p_camera + t`.

use glam::{DMat3, DMat4, DQuat, DVec3, Mat3, Vec3};
use serde::{Deserialize, Serialize};

use super::MAX_COORDINATE_M;
use crate::error::{Error, Fault, Result};

/// The largest entry of |RᵀR − I| that is taken for rounding and projected away. Real recordings
/// have 4e-4.
const MAX_ROTATION_ERROR: f64 = 1e-2;

/// A rigid transform in double precision: rotation and translation in metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    pub rotation: DQuat,
    pub translation: DVec3,
}

impl Pose {
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// A pose from a unit quaternion (x, y, z, w) and a translation. Fails on numbers that are not
    /// finite and on a quaternion whose length is off by more than [`MAX_ROTATION_ERROR`].
    pub fn from_quaternion(rotation: DQuat, translation: DVec3) -> Result<Self> {
        let pose = Self { rotation, translation };
        pose.check()?;
        Ok(Self { rotation: rotation.normalize(), translation })
    }

    /// Fails on numbers that are not finite and on a quaternion whose length is off by more than
    /// [`MAX_ROTATION_ERROR`].
    pub fn check(&self) -> Result<()> {
        check_finite("translation", self.translation.is_finite())?;
        check_finite("rotation", self.rotation.is_finite())?;
        let length = self.rotation.length();
        // Squares of large numbers overflow to infinity, which is refused like any other length.
        if (length - 1.0).abs() > MAX_ROTATION_ERROR {
            return Err(Error::frame(
                Fault::PoseNotRigid,
                "world_from_camera.rotation",
                format!("quaternion length {length} must be 1 within {MAX_ROTATION_ERROR}"),
            ));
        }
        Ok(())
    }

    /// [`Self::check`], and that it lies within [`MAX_COORDINATE_M`] of the origin.
    pub fn check_within_reach(&self) -> Result<()> {
        self.check()?;
        if self.translation.abs().max_element() > MAX_COORDINATE_M {
            return Err(Error::invalid(
                "world_from_camera.translation",
                format!(
                    "{} lies farther than {MAX_COORDINATE_M} m from the origin",
                    self.translation
                ),
            ));
        }
        Ok(())
    }

    /// A pose from a 4×4 matrix. Fails on numbers that are not finite, on a reflection, and on a
    /// rotation that is off by more than [`MAX_ROTATION_ERROR`]; smaller errors are projected away.
    pub fn from_matrix(matrix: DMat4) -> Result<Self> {
        let rotation = DMat3::from_mat4(matrix);
        let translation = matrix.w_axis.truncate();
        check_finite("translation", translation.is_finite())?;
        check_finite("rotation", rotation.is_finite())?;
        let error = rotation.transpose() * rotation - DMat3::IDENTITY;
        let largest = error.to_cols_array().iter().fold(0.0f64, |m, e| m.max(e.abs()));
        if largest > MAX_ROTATION_ERROR || rotation.determinant() < 0.0 {
            return Err(Error::frame(
                Fault::PoseNotRigid,
                "world_from_camera.rotation",
                format!(
                    "must be a right-handed rotation: |RᵀR − I| is {largest:.2e} (limit \
                     {MAX_ROTATION_ERROR}), determinant {:.3}",
                    rotation.determinant()
                ),
            ));
        }
        Ok(Self {
            rotation: DQuat::from_mat3(&nearest_rotation(rotation)).normalize(),
            translation,
        })
    }

    /// A camera at `eye` that looks at `target`, with `up` towards the top of the image.
    pub fn looking_at(eye: DVec3, target: DVec3, up: DVec3) -> Self {
        let forward = (target - eye).normalize();
        let right = forward.cross(up).normalize();
        let rotation = DMat3::from_cols(right, forward.cross(right), forward);
        Self { rotation: DQuat::from_mat3(&rotation).normalize(), translation: eye }
    }

    /// The rotation as a single-precision matrix.
    pub fn rotation_f32(&self) -> Mat3 {
        Mat3::from_quat(self.rotation.as_quat())
    }

    /// The camera's position in world metres, single precision.
    pub fn position_f32(&self) -> Vec3 {
        self.translation.as_vec3()
    }

    /// The inverse transform.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// Applies the transform to a point.
    pub fn transform(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }
}

fn check_finite(part: &str, is_finite: bool) -> Result<()> {
    if is_finite {
        return Ok(());
    }
    let field = format!("world_from_camera.{part}");
    Err(Error::frame(Fault::PoseNotFinite, field, "must be finite"))
}

/// The nearest rotation in the Frobenius norm, by Newton's iteration R ← (R + R⁻ᵀ)/2, which
/// converges quadratically for a matrix this close to a rotation.
fn nearest_rotation(mut rotation: DMat3) -> DMat3 {
    for _ in 0..4 {
        rotation = (rotation + rotation.inverse().transpose()) * 0.5;
    }
    rotation
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_rotation_errors_are_projected_away() {
        let mut matrix = DMat4::from_rotation_translation(
            DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.2, 1.0),
            DVec3::new(1.0, 2.0, 3.0),
        );
        matrix.x_axis.x += 4e-4;
        let pose = Pose::from_matrix(matrix).expect("within the limit");
        let rotation = DMat3::from_quat(pose.rotation);
        let error = rotation.transpose() * rotation - DMat3::IDENTITY;
        assert!(error.to_cols_array().iter().all(|e| e.abs() < 1e-12));
    }

    #[test]
    fn scaled_reflected_and_unfinished_matrices_are_refused() {
        for matrix in [
            DMat4::from_scale(DVec3::splat(1.1)),
            DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0)),
            DMat4::from_translation(DVec3::new(f64::NAN, 0.0, 0.0)),
            DMat4::from_cols_array(&[f64::INFINITY; 16]),
        ] {
            assert!(Pose::from_matrix(matrix).is_err(), "{matrix}");
        }
    }

    #[test]
    fn quaternions_are_normalised_or_refused() {
        let q = DQuat::from_rotation_z(0.4);
        let pose = Pose::from_quaternion(q * 1.009, DVec3::ZERO).expect("within the limit");
        assert!((pose.rotation - q).length() < 1e-12);
        for (rotation, fault) in [
            (q * 1.011, Fault::PoseNotRigid),
            (q * 0.0, Fault::PoseNotRigid),
            (q * 1e300, Fault::PoseNotRigid),
            (q * f64::NAN, Fault::PoseNotFinite),
        ] {
            let error = Pose::from_quaternion(rotation, DVec3::ZERO).expect_err("wrong");
            assert!(matches!(error, Error::Frame { fault: f, .. } if f == fault), "{error}");
        }
    }

    #[test]
    fn looking_at_points_z_at_the_target_and_y_down() {
        let pose = Pose::looking_at(DVec3::new(1.0, 0.0, 1.0), DVec3::new(3.0, 0.0, 1.0), DVec3::Z);
        assert!((pose.rotation * DVec3::Z - DVec3::X).length() < 1e-12);
        assert!((pose.rotation * DVec3::Y + DVec3::Z).length() < 1e-12);
    }
}
