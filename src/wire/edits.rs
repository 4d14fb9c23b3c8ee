//! `maps.proto`: changes of a map by hand.

use std::time::Duration;

use glam::{DQuat, DVec3, Vec3};

use super::geometry::{pose_to_wire, required};
use super::v1;
use super::v1::clear_region_request::Region as WireRegion;
use super::v1::stamp_geometry_request::Geometry;
use crate::error::{Error, Result};
use crate::geometry::{Aabb, Mesh, Pose, Region, Solid};
use crate::map::{Clear, Edited, STAMP_ROBOT, Stamp};
use crate::surface::Stamping;

fn place(field: &str, at: Option<v1::Vector3>) -> Result<Vec3> {
    let at = required(field, at)?;
    Ok(Vec3::new(at.x as f32, at.y as f32, at.z as f32))
}

fn place_to_wire(at: Vec3) -> Option<v1::Vector3> {
    Some(v1::Vector3 { x: f64::from(at.x), y: f64::from(at.y), z: f64::from(at.z) })
}

fn sphere(message: &v1::Sphere) -> Result<(Vec3, f32)> {
    Ok((place("sphere.center", message.center)?, message.radius_m as f32))
}

fn sphere_to_wire(center: Vec3, radius_m: f32) -> v1::Sphere {
    v1::Sphere { center: place_to_wire(center), radius_m: f64::from(radius_m) }
}

impl TryFrom<v1::ClearRegionRequest> for Clear {
    type Error = Error;

    fn try_from(message: v1::ClearRegionRequest) -> Result<Self> {
        let region = match message.region {
            Some(WireRegion::Box(aabb)) => Some(Region::Box(Aabb {
                min: place("box.min", aabb.min)?,
                max: place("box.max", aabb.max)?,
            })),
            Some(WireRegion::Sphere(message)) => {
                let (center, radius_m) = sphere(&message)?;
                Some(Region::Sphere { center, radius_m })
            }
            None => None,
        };
        let robot_id = (!message.robot_id.is_empty()).then_some(message.robot_id);
        Ok(Self { region, robot_id, older_than_ns: message.older_than_ns })
    }
}

/// The message of what is to be forgotten.
pub fn clear_to_wire(map_id: &str, clear: &Clear) -> v1::ClearRegionRequest {
    let region = clear.region.map(|region| match region {
        Region::Box(Aabb { min, max }) => {
            WireRegion::Box(v1::Aabb { min: place_to_wire(min), max: place_to_wire(max) })
        }
        Region::Sphere { center, radius_m } => WireRegion::Sphere(sphere_to_wire(center, radius_m)),
    });
    v1::ClearRegionRequest {
        map_id: map_id.into(),
        region,
        robot_id: clear.robot_id.clone().unwrap_or_default(),
        older_than_ns: clear.older_than_ns,
    }
}

impl TryFrom<v1::StampGeometryRequest> for Stamp {
    type Error = Error;

    fn try_from(message: v1::StampGeometryRequest) -> Result<Self> {
        let solid = match required("geometry", message.geometry)? {
            Geometry::Box(message) => box_from_wire(message)?,
            Geometry::Sphere(message) => {
                let (center, radius_m) = sphere(&message)?;
                Solid::Sphere { center, radius_m }
            }
            Geometry::Mesh(message) => Solid::Mesh(mesh_from_wire(&message)?),
        };
        let stamping = match v1::StampMode::try_from(message.mode) {
            Ok(v1::StampMode::Unspecified | v1::StampMode::Add) => Stamping::Add,
            Ok(v1::StampMode::Free) => Stamping::Free,
            Err(_) => {
                let problem = format!("{} is none of ADD, FREE", message.mode);
                return Err(Error::invalid("mode", problem));
            }
        };
        Ok(Self {
            solid,
            stamping,
            color: message.color.map(|c| Vec3::new(c.r, c.g, c.b)),
            robot_id: if message.robot_id.is_empty() {
                STAMP_ROBOT.into()
            } else {
                message.robot_id
            },
        })
    }
}

/// Its numbers are judged where the whole edit is.
fn box_from_wire(message: v1::OrientedSolidBox) -> Result<Solid> {
    let pose = required("box.world_from_box", message.world_from_box)?;
    let t = required("box.world_from_box.translation", pose.translation)?;
    let q = required("box.world_from_box.rotation", pose.rotation)?;
    let world_from_box = Pose {
        rotation: DQuat::from_xyzw(q.x, q.y, q.z, q.w),
        translation: DVec3::new(t.x, t.y, t.z),
    };
    Ok(Solid::Box { world_from_box, size_m: place("box.size_m", message.size_m)? })
}

fn mesh_from_wire(message: &v1::TriangleMesh) -> Result<Mesh> {
    let threes = |field: &str, count: usize| {
        let problem = format!("{count} numbers are no whole threes");
        Error::invalid(field, problem)
    };
    let (vertices, rest) = message.vertices_m.as_chunks::<3>();
    if !rest.is_empty() {
        return Err(threes("mesh.vertices_m", message.vertices_m.len()));
    }
    let (triangles, rest) = message.triangles.as_chunks::<3>();
    if !rest.is_empty() {
        return Err(threes("mesh.triangles", message.triangles.len()));
    }
    Mesh::new(vertices.iter().copied().map(Vec3::from).collect(), triangles.to_vec())
}

/// The message of known geometry.
pub fn stamp_to_wire(map_id: &str, stamp: &Stamp) -> v1::StampGeometryRequest {
    let geometry = match &stamp.solid {
        Solid::Box { world_from_box, size_m } => Geometry::Box(v1::OrientedSolidBox {
            world_from_box: Some(pose_to_wire(world_from_box)),
            size_m: place_to_wire(*size_m),
        }),
        Solid::Sphere { center, radius_m } => Geometry::Sphere(sphere_to_wire(*center, *radius_m)),
        Solid::Mesh(mesh) => Geometry::Mesh(v1::TriangleMesh {
            vertices_m: mesh.vertices().iter().flat_map(|v| v.to_array()).collect(),
            triangles: mesh.triangles().as_flattened().to_vec(),
        }),
    };
    let mode = match stamp.stamping {
        Stamping::Add => v1::StampMode::Add,
        Stamping::Free => v1::StampMode::Free,
    };
    v1::StampGeometryRequest {
        map_id: map_id.into(),
        geometry: Some(geometry),
        mode: mode.into(),
        robot_id: stamp.robot_id.clone(),
        color: stamp.color.map(|c| v1::StampColor { r: c.x, g: c.y, b: c.z }),
    }
}

/// The message of what an edit did.
pub fn edited_to_wire(edited: Edited, spent: Duration) -> v1::EditReply {
    v1::EditReply {
        epoch: edited.epoch,
        surfels_removed: edited.surfels_removed,
        surfels_added: edited.surfels_added,
        cells_forgotten: edited.cells_forgotten,
        cells_told: edited.cells_told,
        key_frames_dropped: edited.key_frames_dropped,
        server_us: spent.as_micros() as u64,
    }
}

impl From<v1::EditReply> for Edited {
    fn from(message: v1::EditReply) -> Self {
        Self {
            epoch: message.epoch,
            surfels_removed: message.surfels_removed,
            surfels_added: message.surfels_added,
            cells_forgotten: message.cells_forgotten,
            cells_told: message.cells_told,
            key_frames_dropped: message.key_frames_dropped,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_come_back_as_they_were() {
        let clears = [
            Clear {
                region: Some(Region::Sphere { center: Vec3::new(1.0, 2.0, 3.0), radius_m: 0.5 }),
                ..Clear::default()
            },
            Clear {
                region: Some(Region::Box(Aabb { min: Vec3::ZERO, max: Vec3::ONE })),
                robot_id: Some("r".into()),
                older_than_ns: Some(-5),
            },
        ];
        for clear in clears {
            let back = Clear::try_from(clear_to_wire("m", &clear)).expect("whole");
            assert_eq!(back, clear);
        }
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Vec3::from);
        let mesh = Mesh::new(corners.to_vec(), vec![[0, 1, 2]]).expect("a good mesh");
        let pose = Pose { translation: DVec3::new(1.0, 0.5, 2.0), ..Pose::IDENTITY };
        for solid in [
            Solid::Box { world_from_box: pose, size_m: Vec3::new(1.0, 2.0, 0.5) },
            Solid::Sphere { center: Vec3::ONE, radius_m: 0.25 },
            Solid::Mesh(mesh),
        ] {
            let stamp = Stamp {
                solid,
                stamping: Stamping::Free,
                color: Some(Vec3::new(0.5, 0.25, 1.0)),
                robot_id: "planner".into(),
            };
            let back = Stamp::try_from(stamp_to_wire("m", &stamp)).expect("whole");
            assert_eq!(format!("{back:?}"), format!("{stamp:?}"));
        }
    }

    #[test]
    fn what_is_missing_or_cut_off_is_named() {
        let sphere = v1::Sphere { center: None, radius_m: 1.0 };
        let mesh = v1::TriangleMesh { vertices_m: vec![0.0; 4], triangles: vec![0, 0, 0] };
        let solid = v1::OrientedSolidBox::default();
        let requests = [
            (None, 0, "geometry"),
            (Some(Geometry::Sphere(sphere)), 0, "sphere.center"),
            (Some(Geometry::Mesh(mesh)), 0, "mesh.vertices_m"),
            (Some(Geometry::Box(solid)), 0, "box.world_from_box"),
            (Some(Geometry::Sphere(sphere_to_wire(Vec3::ZERO, 1.0))), 7, "mode"),
        ];
        for (geometry, mode, field) in requests {
            let request = v1::StampGeometryRequest { geometry, mode, ..Default::default() };
            let error = Stamp::try_from(request).expect_err(field).to_string();
            assert!(error.starts_with(&format!("{field}: ")), "{error}");
        }
    }
}
