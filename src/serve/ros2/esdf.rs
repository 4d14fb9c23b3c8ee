//! Distances in a box, as those ask who read nvblox (`nvblox_msgs/EsdfAndGradients`): cuMotion takes
//! its world from them.

use glam::{UVec3, Vec3};
use tokio::sync::mpsc;

use super::Source;
use crate::bus::{RobotNode, RobotService, ServiceRequest};
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use crate::map::{Fields, GridShape};
use crate::service::{Answered, Call, Grid, GridQuestion, NumberFormat, Terms};
use crate::wire::ros2::{
    ArrayDimension, ArrayLayout, EsdfRequest, EsdfResponse, FloatArray, Point, Type, decode, encode,
};

/// Requests that may wait; the next one is refused.
const WAITING: usize = 4;
/// What nvblox says where nothing is known.
const UNKNOWN_M: f32 = -1000.0;

/// Requests of the service, as they come.
pub(super) struct Requests(mpsc::Receiver<ServiceRequest>);

/// Takes requests from now on.
pub(super) async fn declare(
    node: &RobotNode,
    source: &Source,
    name: &str,
) -> Result<(RobotService, Requests)> {
    let (ask, asked) = mpsc::channel(WAITING);
    let refusal = encode(&refused(source))?;
    let service = node.serve(name, Type::ESDF_SERVICE, move |request| {
        if let Err(error) = ask.try_send(request) {
            tracing::warn!("ROS 2: more than {WAITING} requests for distances at a time");
            error.into_inner().answer(refusal.clone());
        }
    });
    Ok((service.await?, Requests(asked)))
}

impl Requests {
    /// Answers one after the other. A client of ROS 2 cannot be told an error: it gets no success, and
    /// the log says why.
    pub(super) async fn answer(mut self, source: Source, voxel_m: f32) {
        while let Some(request) = self.0.recv().await {
            let grid = answer(&source, &request.payload(), voxel_m).await;
            let source = source.clone();
            let sending = tokio::task::spawn_blocking(move || {
                let response = grid.and_then(|grid| response(&source, grid)).unwrap_or_else(|e| {
                    tracing::warn!("ROS 2: no distances: {e}");
                    refused(&source)
                });
                match encode(&response) {
                    Ok(payload) => request.answer(payload),
                    Err(error) => tracing::warn!("ROS 2: no distances: {error}"),
                }
            });
            if sending.await.is_err() {
                tracing::error!("answering a request of ROS 2 failed");
            }
        }
    }
}

async fn answer(source: &Source, payload: &[u8], voxel_m: f32) -> Result<Answered<Grid>> {
    let request: EsdfRequest = decode(payload)?;
    let frame = request.frame_id.trim_start_matches('/');
    if !frame.is_empty() && frame != source.map_frame {
        let problem = format!("'{frame}' is not the map's, '{}'", source.map_frame);
        return Err(Error::invalid("frame_id", problem));
    }
    if !request.aabbs_to_clear_min_m.is_empty() || !request.spheres_to_clear_center_m.is_empty() {
        let problem = "nothing is cleared over this service; leave aabbs_to_clear_* and \
                       spheres_to_clear_* empty";
        return Err(Error::invalid("aabbs_to_clear_min_m", problem));
    }
    let region = match request.use_aabb {
        true => box_of(&request),
        false => source.service.map_detail(&source.map_id)?.summary.bounds,
    };
    let question = GridQuestion {
        terms: Terms { map_id: source.map_id.clone(), ..Terms::default() },
        region: aligned(&region, voxel_m)?,
        voxel_m,
        fields: Fields::DISTANCE,
        format: NumberFormat::F32,
    };
    source.service.get_grid(question, Call::Ros2Esdf).await
}

fn box_of(request: &EsdfRequest) -> Aabb {
    let (low, size) = (request.aabb_min_m, request.aabb_size_m);
    let min = Vec3::new(low.x as f32, low.y as f32, low.z as f32);
    Aabb { min, max: min + Vec3::new(size.x as f32, size.y as f32, size.z as f32) }
}

/// The voxels that nvblox would answer: of a lattice from the world's origin, all that a box touches.
fn aligned(region: &Aabb, voxel_m: f32) -> Result<Aabb> {
    if !(region.min.is_finite() && region.max.is_finite()) || region.is_empty() {
        return Err(Error::invalid("aabb_size_m", "the box is empty, or so is the map"));
    }
    let (low, high) = ((region.min / voxel_m).floor(), (region.max / voxel_m).floor());
    // To the middle of the last voxel, so that rounding adds none.
    Ok(Aabb { min: low * voxel_m, max: (high + 0.5) * voxel_m })
}

fn response(source: &Source, grid: Answered<Grid>) -> Result<EsdfResponse> {
    let Grid { shape, columns, .. } = grid.answer;
    let distances: Vec<f32> = bytemuck::pod_collect_to_vec(&columns.distance);
    if distances.len() as u64 != shape.voxels() {
        return Err(Error::Internal("a grid has another size than its shape".into()));
    }
    let origin = shape.origin.as_dvec3();
    Ok(EsdfResponse {
        header: source.header(grid.newest_stamp_ns),
        origin_m: Point { x: origin.x, y: origin.y, z: origin.z },
        voxel_size_m: shape.voxel_m,
        esdf_and_gradients: array(&shape, &distances),
        success: true,
    })
}

/// With z the fastest, as nvblox has it.
fn array(shape: &GridShape, distances: &[f32]) -> FloatArray {
    let UVec3 { x, y, z } = shape.size;
    let stride = shape.stride();
    let mut data = Vec::with_capacity(distances.len());
    for i in 0..x {
        for j in 0..y {
            data.extend((0..z).map(|k| {
                let distance = distances[UVec3::new(i, j, k).dot(stride) as usize];
                if distance.is_nan() { UNKNOWN_M } else { distance }
            }));
        }
    }
    let dimension =
        |label: &str, size, stride| ArrayDimension { label: label.into(), size, stride };
    // Within the voxels of a grid.
    let dim = vec![dimension("x", x, x * y * z), dimension("y", y, y * z), dimension("z", z, z)];
    FloatArray { layout: ArrayLayout { dim, data_offset: 0 }, data }
}

fn refused(source: &Source) -> EsdfResponse {
    EsdfResponse {
        header: source.header(0),
        origin_m: Point::default(),
        voxel_size_m: 0.0,
        esdf_and_gradients: FloatArray::default(),
        success: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_has_every_voxel_that_it_touches() {
        let region = |low: f32, high: f32| Aabb { min: Vec3::splat(low), max: Vec3::splat(high) };
        for (low, high, first, count) in [(0.0, 1.0, 0, 5), (-0.3, 0.3, -2, 4), (0.26, 0.27, 1, 1)]
        {
            let aligned = aligned(&region(low, high), 0.25).expect("a box");
            let shape = GridShape::covering(&aligned, 0.25);
            assert_eq!(shape.size, UVec3::splat(count), "{low} to {high}");
            assert_eq!(shape.origin, Vec3::splat(first as f32 * 0.25));
        }
        // A size that f32 does not hold.
        let aligned = aligned(&region(-1.0, 1.001), 0.01).expect("a box");
        assert_eq!(GridShape::covering(&aligned, 0.01).size, UVec3::splat(201));
        for (low, high) in [(1.0, 0.0), (f32::NAN, 1.0), (0.0, f32::INFINITY)] {
            let error = super::aligned(&region(low, high), 0.25).expect_err("no box");
            assert_eq!(error.field(), Some("aabb_size_m"));
        }
    }

    #[test]
    fn z_is_the_fastest_and_unknown_is_a_number() {
        let shape = GridShape { origin: Vec3::ZERO, voxel_m: 0.5, size: UVec3::new(2, 1, 3) };
        let array = array(&shape, &[0.0, 1.0, 2.0, 3.0, 4.0, f32::NAN]);
        assert_eq!(array.data, [0.0, 2.0, 4.0, 1.0, 3.0, UNKNOWN_M]);
        let strides: Vec<u32> = array.layout.dim.iter().map(|d| d.stride).collect();
        assert_eq!(strides, [6, 3, 3]);
    }
}
