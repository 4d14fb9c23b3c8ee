//! A good message of each kind that is asked of a map, with the place of its kind among them.

use orenx::wire::v1;
use prost::Message;

use super::scene;

type Question = (usize, Vec<u8>);

pub(super) fn all() -> Vec<Question> {
    [places(), spaces(), words(), edits()].concat()
}

fn map_id() -> String {
    "default".into()
}

fn encoded(kind: usize, message: &impl Message) -> Question {
    (kind, message.encode_to_vec())
}

fn vector(x: f64, y: f64, z: f64) -> Option<v1::Vector3> {
    Some(v1::Vector3 { x, y, z })
}

fn region() -> Option<v1::Aabb> {
    Some(v1::Aabb { min: vector(-0.5, -0.5, 0.5), max: vector(0.5, 0.5, 1.0) })
}

fn embedding(values: &[f32]) -> v1::Embedding {
    v1::Embedding { values: values.to_vec() }
}

fn text() -> v1::Text {
    v1::Text {
        encoder_id: scene::ENCODER.into(),
        prompt_embeddings: vec![embedding(&[1.0, 0.0])],
        negative_embeddings: vec![embedding(&[0.0, 1.0])],
        ..v1::Text::default()
    }
}

fn check() -> v1::CheckTrajectoriesRequest {
    v1::CheckTrajectoriesRequest {
        map_id: map_id(),
        spheres_m: vec![0.0, 0.0, 0.0, 0.1],
        poses: vec![0.3, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        swept: true,
        unknown_distance_m: Some(0.5),
        unknown_policy: v1::UnknownPolicy::Occupied.into(),
        ..Default::default()
    }
}

fn places() -> Vec<Question> {
    vec![
        encoded(
            0,
            &v1::QueryPointsRequest {
                map_id: map_id(),
                points_m: vec![1.2, 0.0, 1.0, 0.0, 9.0, 9.0],
                fields: (1..=6).collect(),
                max_age_ms: 1 << 40,
                text: Some(text()),
                ..Default::default()
            },
        ),
        encoded(
            1,
            &v1::QuerySpheresRequest {
                map_id: map_id(),
                spheres_m: vec![0.5, -1.0, 0.8, 0.1, 9.0, 9.0, 9.0, 0.1],
                unknown_policy: v1::UnknownPolicy::Free.into(),
                ..Default::default()
            },
        ),
        encoded(2, &check()),
        encoded(
            3,
            &v1::CastRaysRequest {
                map_id: map_id(),
                origins_m: vec![0.0, 0.0, 1.0, 0.3, 0.0, 1.0],
                directions: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
                max_range_m: 5.0,
                ..Default::default()
            },
        ),
        encoded(
            4,
            &v1::FindNearestRequest {
                map_id: map_id(),
                points_m: vec![0.3, 0.2, 1.0],
                ..Default::default()
            },
        ),
    ]
}

fn spaces() -> Vec<Question> {
    let pose = Some(v1::Pose {
        translation: vector(0.0, 0.0, 1.0),
        rotation: Some(v1::Quaternion { x: -0.5, y: 0.5, z: -0.5, w: 0.5 }),
    });
    vec![
        encoded(
            5,
            &v1::GetGridRequest {
                map_id: map_id(),
                region: region(),
                voxel_m: 0.25,
                fields: vec![1, 2, 3, 4, 5],
                format: v1::NumberFormat::F16.into(),
                ..Default::default()
            },
        ),
        encoded(
            6,
            &v1::GetSliceRequest {
                map_id: map_id(),
                z_m: 0.8,
                z_max_m: Some(1.2),
                resolution_m: 0.5,
                region: region(),
                costs: Some(v1::SliceCosts { robot_radius_m: 0.2, inflation_m: 0.5 }),
                ..Default::default()
            },
        ),
        encoded(
            7,
            &v1::RenderRequest {
                map_id: map_id(),
                world_from_camera: pose,
                intrinsics: Some(v1::Intrinsics {
                    fx: 8.0,
                    fy: 8.0,
                    cx: 3.5,
                    cy: 2.5,
                    width: 8,
                    height: 6,
                }),
                images: vec![v1::ImageRequest { output: 1, encoding: 2, jpeg_quality: 50 }],
                text: Some(text()),
                ..Default::default()
            },
        ),
    ]
}

fn words() -> Vec<Question> {
    vec![
        encoded(
            9,
            &v1::QueryEmbeddingRequest {
                map_id: map_id(),
                encoder_id: scene::ENCODER.into(),
                prompts: vec![embedding(&[1.0, 0.0])],
                negatives: vec![embedding(&[0.0, 1.0])],
                region: region(),
                min_score: Some(0.1),
                top_k: 3,
                places: true,
                ..Default::default()
            },
        ),
        encoded(
            10,
            &v1::ClassifyRequest {
                map_id: map_id(),
                points_m: vec![1.0, 0.5, 1.0],
                encoder_id: scene::ENCODER.into(),
                class_embeddings: vec![embedding(&[1.0, 0.0]), embedding(&[0.0, 1.0])],
                ..Default::default()
            },
        ),
    ]
}

fn edits() -> Vec<Question> {
    vec![
        encoded(
            11,
            &v1::ClearRegionRequest {
                map_id: map_id(),
                region: Some(v1::clear_region_request::Region::Sphere(v1::Sphere {
                    center: vector(1.0, 0.0, 1.0),
                    radius_m: 0.5,
                })),
                older_than_ns: Some(i64::MAX),
                ..Default::default()
            },
        ),
        encoded(
            12,
            &v1::StampGeometryRequest {
                map_id: map_id(),
                geometry: Some(v1::stamp_geometry_request::Geometry::Mesh(v1::TriangleMesh {
                    vertices_m: vec![0.0, 0.0, 0.0, 0.5, 0.0, 0.1, 0.1, 0.4, 0.0, 0.2, 0.1, 0.4],
                    triangles: vec![0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3],
                })),
                color: Some(v1::StampColor { r: 1.0, g: 0.5, b: 0.0 }),
                ..Default::default()
            },
        ),
        encoded(
            13,
            &v1::WatchRegionRequest {
                map_id: map_id(),
                region: region(),
                voxel_m: 0.25,
                tolerance_m: 0.01,
                ..Default::default()
            },
        ),
        encoded(14, &v1::WatchTrajectoryRequest { check: Some(check()), drop_m: 0.1 }),
    ]
}
