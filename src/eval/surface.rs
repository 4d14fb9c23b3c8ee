//! Errors of an extracted mesh against the true surface.

use glam::Vec3;
use rayon::ThreadPool;
use rayon::prelude::*;

use super::closest::ClosestTriangle;
use super::report::MeshErrors;
use super::truth::SurfaceTruth;
use crate::geometry::random::pcg4d;
use crate::map::TriangleMesh;

/// Points drawn from the judged mesh.
pub const SAMPLES: u32 = 200_000;
/// Seed of the draw.
const SEED: u32 = 0;

/// Accuracy, completion, Chamfer distance and F-scores of `mesh`.
pub(super) fn mesh_errors(
    mesh: &TriangleMesh,
    truth: &SurfaceTruth,
    pool: &ThreadPool,
) -> MeshErrors {
    let samples = sample_uniformly(mesh, SAMPLES);
    if samples.is_empty() {
        let none = f64::NAN;
        return MeshErrors {
            accuracy_m: none,
            completion_m: none,
            chamfer_m: none,
            f_score_5cm: 0.0,
            f_score_2cm: 0.0,
        };
    }
    let (ours, theirs) = (ClosestTriangle::new(mesh), ClosestTriangle::new(&truth.mesh));
    let to_truth = distances(&theirs, &samples, pool);
    let to_ours = distances(&ours, &truth.observed_points, pool);
    let (accuracy_m, completion_m) = (mean(&to_truth), mean(&to_ours));
    MeshErrors {
        accuracy_m,
        completion_m,
        chamfer_m: (accuracy_m + completion_m) / 2.0,
        f_score_5cm: f_score(&to_truth, &to_ours, 0.05),
        f_score_2cm: f_score(&to_truth, &to_ours, 0.02),
    }
}

/// `count` points, uniform over the area; none for a mesh without area.
fn sample_uniformly(mesh: &TriangleMesh, count: u32) -> Vec<Vec3> {
    let mut total = 0.0;
    let cumulative: Vec<f64> = (0..mesh.triangles.len())
        .map(|i| {
            let [a, b, c] = mesh.corners(i);
            total += f64::from((b - a).cross(c - a).length()) * 0.5;
            total
        })
        .collect();
    if total.is_nan() || total <= 0.0 {
        return Vec::new();
    }
    (0..count)
        .map(|i| {
            let [pick, low, u, v] = pcg4d([SEED, 0, 0, i]);
            // 53 bits, so that no triangle of a large mesh is out of reach.
            let word = (u64::from(pick) << 32 | u64::from(low)) >> 11;
            let target = word as f64 / (1u64 << 53) as f64 * total;
            let triangle = cumulative.partition_point(|&sum| sum <= target);
            let [a, b, c] = mesh.corners(triangle.min(cumulative.len() - 1));
            let (u, v) = (crate::geometry::random::unit(u), crate::geometry::random::unit(v));
            // Fold the square onto the triangle: uniform, and without a root.
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            a + (b - a) * u + (c - a) * v
        })
        .collect()
}

fn distances(surface: &ClosestTriangle, points: &[Vec3], pool: &ThreadPool) -> Vec<f32> {
    pool.install(|| points.par_iter().with_min_len(1024).map(|&p| surface.distance(p)).collect())
}

fn mean(values: &[f32]) -> f64 {
    values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64
}

/// The harmonic mean of precision and recall at `threshold_m`.
fn f_score(to_truth: &[f32], to_ours: &[f32], threshold_m: f32) -> f64 {
    let share = |distances: &[f32]| {
        distances.iter().filter(|&&d| d < threshold_m).count() as f64 / distances.len() as f64
    };
    let (precision, recall) = (share(to_truth), share(to_ours));
    if precision + recall > 0.0 { 2.0 * precision * recall / (precision + recall) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::query_pool;

    /// A rectangle in the plane z, from the origin to (x, y).
    fn rectangle(x: f32, y: f32, z: f32) -> TriangleMesh {
        TriangleMesh {
            vertices: vec![
                Vec3::new(0.0, 0.0, z),
                Vec3::new(x, 0.0, z),
                Vec3::new(x, y, z),
                Vec3::new(0.0, y, z),
            ],
            normals: vec![],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        }
    }

    fn truth() -> SurfaceTruth {
        let observed_points = (0..1000)
            .map(|i| Vec3::new((i % 40) as f32 / 40.0 + 0.0125, (i / 40) as f32 / 25.0, 0.0))
            .collect();
        SurfaceTruth { observed_points, mesh: rectangle(1.0, 1.0, 0.0) }
    }

    fn judge(mesh: &TriangleMesh) -> MeshErrors {
        mesh_errors(mesh, &truth(), &query_pool(2).expect("pool"))
    }

    fn close(a: f64, b: f64, tolerance: f64) -> bool {
        (a - b).abs() < tolerance
    }

    #[test]
    fn the_true_surface_is_perfect() {
        let errors = judge(&rectangle(1.0, 1.0, 0.0));
        assert!(errors.accuracy_m < 1e-7 && errors.completion_m < 1e-7, "{errors:?}");
        assert_eq!((errors.f_score_5cm, errors.f_score_2cm), (1.0, 1.0));
    }

    #[test]
    fn an_offset_shows_in_every_distance_and_in_the_tighter_f_score() {
        let errors = judge(&rectangle(1.0, 1.0, 0.03));
        assert!(close(errors.accuracy_m, 0.03, 1e-6), "{errors:?}");
        assert!(close(errors.completion_m, 0.03, 1e-6), "{errors:?}");
        assert!(close(errors.chamfer_m, 0.03, 1e-6), "{errors:?}");
        assert_eq!((errors.f_score_5cm, errors.f_score_2cm), (1.0, 0.0));
    }

    #[test]
    fn a_missing_half_costs_completion_only() {
        // Half the truth is x > 0.5, at a mean distance of 0.25 m; its first 2 cm still count.
        let errors = judge(&rectangle(0.5, 1.0, 0.0));
        assert!(errors.accuracy_m < 1e-7, "{errors:?}");
        assert!(close(errors.completion_m, 0.125, 1e-3), "{errors:?}");
        let recall = 21.0 / 40.0;
        assert!(close(errors.f_score_2cm, 2.0 * recall / (1.0 + recall), 1e-6), "{errors:?}");
    }

    #[test]
    fn an_invented_half_costs_accuracy_only() {
        // The samples of 1 < x < 2 lie 0.5 m away on average.
        let errors = judge(&rectangle(2.0, 1.0, 0.0));
        assert!(close(errors.accuracy_m, 0.25, 2e-3), "{errors:?}");
        assert!(errors.completion_m < 1e-7, "{errors:?}");
        let precision = 0.525;
        assert!(close(errors.f_score_5cm, 2.0 * precision / (1.0 + precision), 3e-3), "{errors:?}");
    }

    #[test]
    fn an_empty_mesh_has_no_distances_and_no_score() {
        let errors = judge(&TriangleMesh::default());
        assert!(errors.accuracy_m.is_nan() && errors.chamfer_m.is_nan());
        assert_eq!((errors.f_score_5cm, errors.f_score_2cm), (0.0, 0.0));
    }

    #[test]
    fn samples_follow_the_area_not_the_triangle_count() {
        let mut mesh = rectangle(1.0, 1.0, 0.0);
        // A second, far rectangle of three times the area, finely divided.
        for i in 0..100u32 {
            let x = 10.0 + i as f32 * 0.03;
            let base = mesh.vertices.len() as u32;
            mesh.vertices.extend([
                Vec3::new(x, 0.0, 0.0),
                Vec3::new(x + 0.03, 0.0, 0.0),
                Vec3::new(x + 0.03, 1.0, 0.0),
                Vec3::new(x, 1.0, 0.0),
            ]);
            mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
        }
        let samples = sample_uniformly(&mesh, 40_000);
        let far = samples.iter().filter(|p| p.x > 5.0).count() as f64 / 40_000.0;
        assert!(close(far, 0.75, 0.01), "{far}");
        let low: f64 = samples.iter().map(|p| f64::from(p.y)).sum::<f64>() / samples.len() as f64;
        assert!(close(low, 0.5, 0.01), "{low}");
    }
}
