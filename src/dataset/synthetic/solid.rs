//! Convex solids with closed-form distance, gradient and ray hit.

use glam::{Mat3, Vec2, Vec3};

use crate::geometry::Aabb;

/// A shape around the origin of its own axes; lengths in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Shape {
    Box {
        half: Vec3,
    },
    Sphere {
        radius: f32,
    },
    /// Along z, with flat ends.
    Cylinder {
        radius: f32,
        half_height: f32,
    },
    /// Along z, with round ends; the ends' centres lie at ±half_length.
    Capsule {
        radius: f32,
        half_length: f32,
    },
}

/// A shape in the world.
#[derive(Debug, Clone, Copy)]
pub(super) struct Solid {
    pub shape: Shape,
    pub centre: Vec3,
    pub world_from_local: Mat3,
    /// Index of the object that it is a part of.
    pub object: u16,
}

/// A point's relation to a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Signed distance, m; negative inside.
    pub distance: f32,
    /// Unit vector towards increasing distance.
    pub gradient: Vec3,
}

/// A ray that met a surface at `origin + t * direction`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SolidHit {
    pub t: f32,
    /// Outward unit normal.
    pub normal: Vec3,
}

impl Solid {
    /// Signed distance and gradient at a world point; exact inside and outside.
    pub(super) fn nearest(&self, point: Vec3) -> Nearest {
        let local = self.point_in_axes(point);
        let (distance, gradient) = match self.shape {
            Shape::Box { half } => nearest_box(local, half),
            Shape::Sphere { radius } => nearest_ball(local, radius),
            Shape::Cylinder { radius, half_height } => nearest_cylinder(local, radius, half_height),
            Shape::Capsule { radius, half_length } => {
                let axis = Vec3::new(0.0, 0.0, local.z.clamp(-half_length, half_length));
                nearest_ball(local - axis, radius)
            }
        };
        Nearest { distance, gradient: self.world_from_local * gradient }
    }

    /// The first hit of a ray that starts outside. `direction` need not have unit length: `t`
    /// counts in its lengths.
    pub(super) fn cast(&self, origin: Vec3, direction: Vec3) -> Option<SolidHit> {
        let o = self.point_in_axes(origin);
        let d = self.world_from_local.transpose() * direction;
        let (t, normal) = match self.shape {
            Shape::Box { half } => cast_box(o, d, half),
            Shape::Sphere { radius } => cast_ball(o, d, radius),
            Shape::Cylinder { radius, half_height } => cast_cylinder(o, d, radius, half_height),
            Shape::Capsule { radius, half_length } => cast_capsule(o, d, radius, half_length),
        }?;
        Some(SolidHit { t, normal: self.world_from_local * normal })
    }

    /// A world point in the solid's own axes.
    pub(super) fn point_in_axes(&self, point: Vec3) -> Vec3 {
        self.world_from_local.transpose() * (point - self.centre)
    }

    /// The box around the solid in world axes.
    pub(super) fn bounds(&self) -> Aabb {
        let half = match self.shape {
            Shape::Box { half } => half,
            Shape::Sphere { radius } => Vec3::splat(radius),
            Shape::Cylinder { radius, half_height } => Vec3::new(radius, radius, half_height),
            Shape::Capsule { radius, half_length } => {
                Vec3::new(radius, radius, half_length + radius)
            }
        };
        let m = self.world_from_local;
        let reach = m.x_axis.abs() * half.x + m.y_axis.abs() * half.y + m.z_axis.abs() * half.z;
        Aabb { min: self.centre - reach, max: self.centre + reach }
    }
}

/// Distance to a box around the origin; also the (negated) distance in a room of that size.
pub(super) fn nearest_box(p: Vec3, half: Vec3) -> (f32, Vec3) {
    let excess = p.abs() - half;
    let side = Vec3::ONE.copysign(p);
    if excess.max_element() > 0.0 {
        let outward = excess.max(Vec3::ZERO);
        let distance = outward.length();
        return (distance, outward / distance * side);
    }
    let axis = excess.max_position();
    (excess[axis], Vec3::AXES[axis] * side[axis])
}

fn nearest_ball(p: Vec3, radius: f32) -> (f32, Vec3) {
    let length = p.length();
    (length - radius, if length > 0.0 { p / length } else { Vec3::Z })
}

fn nearest_cylinder(p: Vec3, radius: f32, half_height: f32) -> (f32, Vec3) {
    let rho = p.truncate().length();
    let radial = if rho > 0.0 { (p.truncate() / rho).extend(0.0) } else { Vec3::X };
    let axial = Vec3::new(0.0, 0.0, 1f32.copysign(p.z));
    let excess = Vec2::new(rho - radius, p.z.abs() - half_height);
    if excess.max_element() > 0.0 {
        let outward = excess.max(Vec2::ZERO);
        let distance = outward.length();
        return (distance, (radial * outward.x + axial * outward.y) / distance);
    }
    if excess.x > excess.y { (excess.x, radial) } else { (excess.y, axial) }
}

fn cast_box(o: Vec3, d: Vec3, half: Vec3) -> Option<(f32, Vec3)> {
    // A zero component divides to an infinity of the right sign; 0/0 on a face's plane gives NaN,
    // which `max` and `min` pass over.
    let enter = (-half.copysign(d) - o) / d;
    let leave = (half.copysign(d) - o) / d;
    let (near, far) = (enter.max_element(), leave.min_element());
    if !(near > 0.0 && near <= far) {
        return None;
    }
    let axis = enter.max_position();
    Some((near, -Vec3::AXES[axis] * 1f32.copysign(d[axis])))
}

/// By the point of closest approach, which keeps single precision where the textbook discriminant
/// cancels.
fn cast_ball(o: Vec3, d: Vec3, radius: f32) -> Option<(f32, Vec3)> {
    let square = d.length_squared();
    let closest = -o.dot(d) / square;
    let room = radius * radius - (o + d * closest).length_squared();
    if room < 0.0 {
        return None;
    }
    let t = closest - (room / square).sqrt();
    (t > 0.0).then(|| (t, (o + d * t) / radius))
}

/// Where a ray enters the endless cylinder around z.
fn cast_tube(o: Vec3, d: Vec3, radius: f32) -> Option<(f32, Vec3)> {
    let (o2, d2) = (o.truncate(), d.truncate());
    let square = d2.length_squared();
    if square == 0.0 {
        return None;
    }
    let closest = -o2.dot(d2) / square;
    let room = radius * radius - (o2 + d2 * closest).length_squared();
    if room < 0.0 {
        return None;
    }
    let t = closest - (room / square).sqrt();
    (t > 0.0).then(|| (t, ((o2 + d2 * t) / radius).extend(0.0)))
}

fn cast_cylinder(o: Vec3, d: Vec3, radius: f32, half_height: f32) -> Option<(f32, Vec3)> {
    if let Some((t, normal)) = cast_tube(o, d, radius)
        && (o.z + d.z * t).abs() <= half_height
    {
        return Some((t, normal));
    }
    // The cap on the side that the ray comes from.
    let side = -1f32.copysign(d.z);
    let t = (side * half_height - o.z) / d.z;
    let inside = (o + d * t).truncate().length_squared() <= radius * radius;
    (t > 0.0 && t.is_finite() && inside).then_some((t, Vec3::Z * side))
}

fn cast_capsule(o: Vec3, d: Vec3, radius: f32, half_length: f32) -> Option<(f32, Vec3)> {
    if let Some((t, normal)) = cast_tube(o, d, radius)
        && (o.z + d.z * t).abs() <= half_length
    {
        return Some((t, normal));
    }
    let end = Vec3::new(0.0, 0.0, half_length);
    let hits = [cast_ball(o - end, d, radius), cast_ball(o + end, d, radius)];
    hits.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::{pcg4d, unit};

    const SHAPES: [Shape; 4] = [
        Shape::Box { half: Vec3::new(0.3, 0.2, 0.5) },
        Shape::Sphere { radius: 0.4 },
        Shape::Cylinder { radius: 0.25, half_height: 0.4 },
        Shape::Capsule { radius: 0.2, half_length: 0.3 },
    ];

    fn solid(shape: Shape) -> Solid {
        let world_from_local = Mat3::from_euler(glam::EulerRot::XYZ, 0.4, -0.7, 1.1);
        Solid { shape, centre: Vec3::new(1.0, -2.0, 0.5), world_from_local, object: 0 }
    }

    fn around(i: u32, reach: f32) -> Vec3 {
        let w = pcg4d([11, 0, 0, i]);
        (Vec3::new(unit(w[0]), unit(w[1]), unit(w[2])) - 0.5) * 2.0 * reach
    }

    #[test]
    fn hits_lie_on_the_surface_and_nothing_lies_before_them() {
        for shape in SHAPES {
            let solid = solid(shape);
            let mut hits = 0;
            for i in 0..4000 {
                let origin = solid.centre + around(2 * i, 1.0).normalize() * 2.0;
                let direction = (solid.centre + around(2 * i + 1, 0.6) - origin) * 0.7;
                let hit = solid.cast(origin, direction);
                let end = hit.map_or(3.0, |h| h.t);
                for step in 0..40 {
                    let at = origin + direction * (end * step as f32 / 40.0);
                    assert!(solid.nearest(at).distance > -1e-5, "{shape:?} missed");
                }
                if let Some(hit) = hit {
                    hits += 1;
                    let on = origin + direction * hit.t;
                    assert!(solid.nearest(on).distance.abs() < 2e-6, "{shape:?}");
                    assert!((hit.normal.length() - 1.0).abs() < 1e-4);
                    assert!(solid.nearest(on + hit.normal * 0.01).distance > 0.0099);
                }
            }
            assert!(hits > 1000, "{shape:?}: {hits}");
        }
    }

    #[test]
    fn gradients_are_central_differences() {
        for shape in SHAPES {
            let solid = solid(shape);
            let (mut checked, h) = (0, 1e-3);
            for i in 0..4000 {
                let p = solid.centre + around(i, 0.8);
                let at = |offset: Vec3| solid.nearest(p + offset).distance;
                let difference = Vec3::new(
                    at(Vec3::X * h) - at(Vec3::X * -h),
                    at(Vec3::Y * h) - at(Vec3::Y * -h),
                    at(Vec3::Z * h) - at(Vec3::Z * -h),
                ) / (2.0 * h);
                // On the inner axis, where two faces are equally near, there is no gradient.
                if difference.length() > 0.99 {
                    checked += 1;
                    let gradient = solid.nearest(p).gradient;
                    assert!((gradient - difference).length() < 0.02, "{shape:?} {p}");
                }
            }
            assert!(checked > 3800, "{shape:?}: {checked}");
        }
    }

    #[test]
    fn bounds_hold_every_inner_point() {
        for shape in SHAPES {
            let solid = solid(shape);
            let bounds = solid.bounds();
            for i in 0..4000 {
                let p = solid.centre + around(i, 0.8);
                assert!(solid.nearest(p).distance > 0.0 || bounds.contains(p), "{shape:?}");
            }
        }
    }
}
