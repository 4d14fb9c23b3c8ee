//! Large point queries on a pool of their own.

use glam::Vec3;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::query::{Fields, PointAnswers};
use crate::error::{Error, Result};
use crate::octree::PointGrid;

/// Points answered by one thread at a time: long enough to fill SIMD lanes and hide scheduling,
/// short enough that a small query is never stuck behind a large one.
pub const CHUNK_POINTS: usize = 1024;

/// Whatever answers points like [`super::MapView::query`] does: a view, or a closed form in tests.
pub trait PointQuery: Fn(&[Vec3], Fields) -> PointAnswers + Sync {}

impl<Q: Fn(&[Vec3], Fields) -> PointAnswers + Sync> PointQuery for Q {}

/// Whatever answers regular points like [`super::MapView::query_grid`] does.
pub trait GridQuery: Fn(&PointGrid<'_>, Fields) -> PointAnswers + Sync {}

impl<Q: Fn(&PointGrid<'_>, Fields) -> PointAnswers + Sync> GridQuery for Q {}

/// A pool for queries, of one thread a core for 0; never rayon's global one, which belongs to
/// nobody.
pub fn query_pool(threads: usize) -> Result<ThreadPool> {
    ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|i| format!("query-{i}"))
        .build()
        .map_err(|e| Error::Internal(format!("query threads: {e}")))
}

/// Answers `points` in chunks on `pool`, in their order.
pub fn query_parallel(
    query: &impl PointQuery,
    points: &[Vec3],
    fields: Fields,
    pool: &ThreadPool,
) -> PointAnswers {
    let pieces: Vec<PointAnswers> = pool
        .install(|| points.par_chunks(CHUNK_POINTS).map(|chunk| query(chunk, fields)).collect());
    PointAnswers::concatenate(pieces)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_come_back_in_order() {
        let points: Vec<Vec3> = (0..3 * CHUNK_POINTS + 5).map(|i| Vec3::X * i as f32).collect();
        let query = |p: &[Vec3], _: Fields| PointAnswers {
            distance: p.iter().map(|p| p.x).collect(),
            ..PointAnswers::default()
        };
        let pool = query_pool(2).expect("pool");
        let answers = query_parallel(&query, &points, Fields::DISTANCE, &pool);
        assert!(answers.distance.iter().zip(&points).all(|(d, p)| *d == p.x));
        assert_eq!(answers.distance.len(), points.len());
        assert!(answers.gradient.is_empty() && answers.state.is_empty());
    }
}
