//! The surface as points with colours; with words, the points that fit them.

use glam::Vec3;

use super::Source;
use crate::error::Result;
use crate::geometry::Aabb;
use crate::map::Fields;
use crate::service::{Call, PointsQuestion, Sought};
use crate::wire::ros2::{Header, PointCloud2, PointField, encode};

/// The finest distance between points, m.
const SPACING_M: f32 = 0.025;
/// Points that are asked for a cloud: beyond, they lie farther apart.
const MAX_ASKED: usize = 1 << 19;
/// Points of a cloud are told from what is close to the surface by one step of Newton's: from within
/// this many spacings.
const NEAR: f32 = 0.5;
/// What fits words at least: neither is more likely.
const LEAST_SCORE: f32 = 0.5;

/// Points ready to be written: x y z (f32), rgb (u32) and the score (f32).
pub(super) struct Cloud {
    header: Header,
    data: Vec<u8>,
    has_scores: bool,
}

/// The cloud of the whole map.
pub(super) async fn cloud(source: &Source, text: Option<&str>) -> Result<Cloud> {
    let points = lattice(&source.service.surface_leaves(&source.map_id)?);
    let (points, spacing_m) = points;
    let fields = Fields {
        distance: true,
        gradient: true,
        color: true,
        text_score: text.is_some(),
        ..Fields::NONE
    };
    let question = PointsQuestion {
        map_id: source.map_id.clone(),
        fields,
        text: text.map(|text| Sought::words(&[text])),
        ..PointsQuestion::new(points.clone())
    };
    let call = if text.is_some() { Call::Ros2Text } else { Call::Ros2Cloud };
    let reply = source.service.query_points(question, call).await?;
    let answers = &reply.answers;
    let mut data = Vec::new();
    for (i, point) in points.iter().enumerate() {
        let (distance, gradient) = (answers.distance[i], answers.gradient[i]);
        let Some(on_surface) = project(*point, distance, gradient, spacing_m) else { continue };
        let score = text.map(|_| answers.text_score.get(i).copied().unwrap_or(f32::NAN));
        if score.is_some_and(|score| score.is_nan() || score < LEAST_SCORE) {
            continue;
        }
        let color = answers.color.get(i).copied().unwrap_or(Vec3::NAN);
        on_surface.to_array().into_iter().for_each(|x| data.extend(x.to_le_bytes()));
        data.extend(packed(color).to_le_bytes());
        score.into_iter().for_each(|score| data.extend(score.to_le_bytes()));
    }
    Ok(Cloud { header: source.header(reply.newest_stamp_ns), data, has_scores: text.is_some() })
}

impl Cloud {
    pub(super) fn encode(self) -> Result<Vec<u8>> {
        let mut fields = vec![
            PointField::float("x", 0),
            PointField::float("y", 4),
            PointField::float("z", 8),
            PointField::word("rgb", 12),
        ];
        if self.has_scores {
            fields.push(PointField::float("score", 16));
        }
        let point_step = 4 * fields.len() as u32;
        // Within MAX_ASKED points of a few bytes.
        let row_step = self.data.len() as u32;
        encode(&PointCloud2 {
            header: self.header,
            height: 1,
            width: row_step / point_step,
            fields,
            is_bigendian: false,
            point_step,
            row_step,
            data: &self.data,
            is_dense: true,
        })
    }
}

/// A lattice of points within boxes, and its spacing: the finest for which they are not too many.
fn lattice(leaves: &[Aabb]) -> (Vec<Vec3>, f32) {
    let volume: f32 = leaves.iter().map(|leaf| leaf.size().element_product()).sum();
    let spacing_m = (volume / MAX_ASKED as f32).cbrt().max(SPACING_M);
    let mut points = Vec::new();
    for leaf in leaves {
        let first = (leaf.min / spacing_m - 0.5).ceil();
        let last = (leaf.max / spacing_m - 0.5).ceil();
        for z in first.z as i32..last.z as i32 {
            for y in first.y as i32..last.y as i32 {
                for x in first.x as i32..last.x as i32 {
                    points.push((Vec3::new(x as f32, y as f32, z as f32) + 0.5) * spacing_m);
                }
            }
        }
    }
    points.truncate(MAX_ASKED);
    (points, spacing_m)
}

/// The point of the surface next to a point of the lattice, if it is near.
fn project(point: Vec3, distance_m: f32, gradient: Vec3, spacing_m: f32) -> Option<Vec3> {
    let squared = gradient.length_squared();
    let is_near = distance_m.abs() <= NEAR * spacing_m && squared > 0.25;
    is_near.then(|| point - gradient * (distance_m / squared))
}

/// 0x00RRGGBB; what has no colour is grey.
fn packed(color: Vec3) -> u32 {
    if color.is_nan() {
        return 0x80_8080;
    }
    let byte = |c: f32| (c.clamp(0.0, 1.0) * 255.0).round() as u32;
    byte(color.x) << 16 | byte(color.y) << 8 | byte(color.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::ros2::decode;

    #[test]
    fn a_plane_becomes_one_layer_of_points_on_it() {
        let leaf = |x: f32| Aabb { min: Vec3::new(x, 0.0, 0.0), max: Vec3::new(x + 0.1, 0.1, 0.1) };
        let (points, spacing_m) = lattice(&[leaf(0.0), leaf(0.1)]);
        assert_eq!((points.len(), spacing_m), (128, SPACING_M));
        // The plane z = 0.03, whose field is a little too steep.
        let on_plane: Vec<Vec3> = points
            .iter()
            .filter_map(|p| project(*p, (p.z - 0.03) * 1.1, Vec3::Z * 1.1, spacing_m))
            .collect();
        assert_eq!(on_plane.len(), 32);
        assert!(on_plane.iter().all(|p| (p.z - 0.03).abs() < 1e-6), "{on_plane:?}");
        assert_eq!(project(Vec3::ZERO, f32::NAN, Vec3::Z, spacing_m), None);
    }

    #[test]
    fn a_large_map_has_its_points_farther_apart() {
        let room = Aabb { min: Vec3::ZERO, max: Vec3::splat(10.0) };
        let (points, spacing_m) = lattice(&[room]);
        assert!(spacing_m > 0.12 && points.len() <= MAX_ASKED, "{spacing_m} {}", points.len());
    }

    #[test]
    fn clouds_say_what_a_point_is_made_of() {
        let cloud = |has_scores, bytes| Cloud {
            header: Header::default(),
            data: vec![0; bytes],
            has_scores,
        };
        let payload = cloud(true, 60).encode().expect("a cloud");
        let scored: PointCloud2<'_> = decode(&payload).expect("a cloud");
        assert_eq!((scored.width, scored.point_step, scored.fields.len()), (3, 20, 5));
        let payload = cloud(false, 32).encode().expect("a cloud");
        let plain: PointCloud2<'_> = decode(&payload).expect("a cloud");
        assert_eq!((plain.width, plain.point_step, plain.row_step), (2, 16, 32));
        assert_eq!(packed(Vec3::new(1.0, 0.5, 0.0)), 0xff_8000);
        assert_eq!(packed(Vec3::NAN), 0x80_8080);
    }
}
