//! Solids that are given rather than seen: boxes, balls and triangle meshes.

mod mesh;

use glam::{Quat, Vec3};

use super::{Aabb, Pose};
pub use mesh::{MAX_TRIANGLES, MAX_VERTICES, Mesh};

/// A solid in the world, metres.
#[derive(Debug, Clone)]
pub enum Solid {
    Box { world_from_box: Pose, size_m: Vec3 },
    Sphere { center: Vec3, radius_m: f32 },
    Mesh(Mesh),
}

impl Solid {
    /// The box around it.
    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Box { world_from_box, size_m } => {
                let rotation = world_from_box.rotation_f32();
                let [x, y, z] = [0, 1, 2].map(|axis| rotation.col(axis).abs() * size_m[axis]);
                let (center, half) = (world_from_box.position_f32(), 0.5 * (x + y + z));
                Aabb { min: center - half, max: center + half }
            }
            Self::Sphere { center, radius_m } => {
                Aabb { min: *center - *radius_m, max: *center + *radius_m }
            }
            Self::Mesh(mesh) => mesh.bounds(),
        }
    }

    /// The area of its surface, m².
    pub fn area_m2(&self) -> f64 {
        match self {
            Self::Box { size_m, .. } => {
                let [x, y, z] = size_m.to_array().map(f64::from);
                2.0 * (x * y + y * z + z * x)
            }
            Self::Sphere { radius_m, .. } => {
                4.0 * std::f64::consts::PI * f64::from(*radius_m) * f64::from(*radius_m)
            }
            Self::Mesh(mesh) => mesh.area_m2(),
        }
    }

    /// Whether it has an inside: a mesh that is not closed has none.
    pub fn has_inside(&self) -> bool {
        match self {
            Self::Box { .. } | Self::Sphere { .. } => true,
            Self::Mesh(mesh) => mesh.has_inside(),
        }
    }

    /// Whether a point lies inside. A mesh that is not closed has no inside.
    pub fn contains(&self, point: Vec3) -> bool {
        match self {
            Self::Box { world_from_box, size_m } => {
                let rotation = world_from_box.rotation_f32();
                let local = rotation.transpose() * (point - world_from_box.position_f32());
                (local.abs() * 2.0).cmplt(*size_m).all()
            }
            Self::Sphere { center, radius_m } => point.distance(*center) < *radius_m,
            Self::Mesh(mesh) => mesh.contains(point),
        }
    }

    /// Points all over the surface, with the normal outwards, at most `spacing_m` apart.
    pub fn sample(&self, spacing_m: f32, mut visit: impl FnMut(Vec3, Vec3)) {
        match self {
            Self::Box { world_from_box, size_m } => {
                let rotation = Quat::from_mat3(&world_from_box.rotation_f32());
                let center = world_from_box.position_f32();
                sample_box(*size_m, spacing_m, |point, normal| {
                    visit(center + rotation * point, rotation * normal);
                });
            }
            Self::Sphere { center, radius_m } => {
                sample_sphere(*radius_m, spacing_m, |normal| {
                    visit(*center + normal * *radius_m, normal);
                });
            }
            Self::Mesh(mesh) => mesh.sample(spacing_m, visit),
        }
    }
}

/// How many pieces of at most `spacing` a length is cut into.
fn pieces(length: f32, spacing: f32) -> u32 {
    (length / spacing).ceil().max(1.0) as u32
}

fn sample_box(size: Vec3, spacing: f32, mut visit: impl FnMut(Vec3, Vec3)) {
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let [m, n] = [u, v].map(|a| pieces(size[a], spacing));
        for (i, j) in (0..m).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let mut point = Vec3::ZERO;
            point[u] = ((i as f32 + 0.5) / m as f32 - 0.5) * size[u];
            point[v] = ((j as f32 + 0.5) / n as f32 - 0.5) * size[v];
            for side in [-0.5, 0.5] {
                let mut normal = Vec3::ZERO;
                (point[axis], normal[axis]) = (side * size[axis], 2.0 * side);
                visit(point, normal);
            }
        }
    }
}

/// By rings of latitude.
fn sample_sphere(radius: f32, spacing: f32, mut visit: impl FnMut(Vec3)) {
    use std::f32::consts::{PI, TAU};
    let rings = pieces(PI * radius, spacing).max(2);
    for ring in 0..rings {
        let (sin, cos) = ((ring as f32 + 0.5) * PI / rings as f32).sin_cos();
        let around = pieces(TAU * radius * sin, spacing).max(3);
        for step in 0..around {
            let (y, x) = ((step as f32 + 0.5) * TAU / around as f32).sin_cos();
            visit(Vec3::new(sin * x, sin * y, cos));
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;

    /// Samples lie on the surface, face outwards, and are as many as the area asks for.
    fn check(solid: &Solid, spacing: f32) {
        let mut count = 0u32;
        let bounds = solid.bounds();
        solid.sample(spacing, |point, normal| {
            count += 1;
            assert!((normal.length() - 1.0).abs() < 1e-4);
            assert!(solid.contains(point - normal * 1e-3), "{point} {normal}");
            assert!(!solid.contains(point + normal * 1e-3), "{point} {normal}");
            assert!(bounds.contains(point.clamp(bounds.min - 1e-4, bounds.max + 1e-4)));
        });
        let expected = solid.area_m2() / f64::from(spacing * spacing);
        assert!((expected..1.3 * expected).contains(&f64::from(count)), "{count} of {expected}");
    }

    #[test]
    fn surfaces_are_covered_and_face_outwards() {
        let rotation = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.8, 1.1);
        let pose = Pose { rotation, translation: DVec3::new(1.0, -2.0, 0.5) };
        check(&Solid::Box { world_from_box: pose, size_m: Vec3::new(0.5, 1.0, 0.3) }, 0.02);
        check(&Solid::Sphere { center: Vec3::new(1.0, 2.0, 3.0), radius_m: 0.4 }, 0.02);
        check(&Solid::Mesh(mesh::tests::tetrahedron()), 0.01);
    }
}
