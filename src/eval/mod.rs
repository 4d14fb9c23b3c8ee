//! Metrics of the paper's tables: a map judged against a truth folder.
//!
//! # Protocol
//!
//! **Field.** Every point of `gt_sdf.npz` is asked. *near* and *far* are its `near` flag (|s| ≤ 0.1 m,
//! and free space beyond), *all* their union, `_observed` those whose nearest surface some frame
//! saw (`closest_observed`). SDF MAE is the mean |d − s|; the gradient error the mean angle between
//! the normalised gradients (algorithms.md §5), π/2 where a known gradient has no direction; sign
//! accuracy the share of near points with the sign of the truth. Unknown points (state 0 or a
//! distance that is not finite) are left out of every mean and counted in `known_share`.
//!
//! **Occupancy.** The share of known points whose probability lies on the side of 0.5 that the
//! truth's sign asks for (s < 0 is occupied).
//!
//! **Mesh.** [`surface::SAMPLES`] points, uniform over the area of our mesh, seed 0; *accuracy* is
//! their mean exact point-to-triangle distance to `mesh.ply`, *completion* the mean exact distance
//! of the observed points of `gt_surface.npz` to our mesh, Chamfer the mean of the two. Precision
//! is the share of samples, recall the share of observed truth points, closer than the threshold;
//! the F-score is their harmonic mean. An empty mesh has no distances and F-scores of 0.
//!
//! **Images.** Every view of `novel/` is rendered and compared as 8-bit sRGB, black where the map has
//! no colour. A pixel is *covered* if both the map and the truth have depth there. PSNR over covered
//! and over all pixels, −10 log10 of the mean squared error of the three channels (at most 120 dB);
//! SSIM (11 × 11 Gaussian window, σ 1.5) as the mean of the three channels; mean and median of the
//! error of z-depth over covered pixels; coverage, the covered share of the pixels with true depth;
//! LPIPS where the user gives the network. Each is the mean over the images that have it.

mod closest;
mod field;
mod images;
mod report;
mod surface;
mod truth;

use rayon::ThreadPool;

use crate::error::{Error, Result};
use crate::map::{Fields, PointQuery, TriangleMesh, query_parallel};

pub use images::{Lpips, image_errors};
pub use report::{
    FieldErrors, Geometry, ImageErrors, KnownShare, MeshErrors, Occupancy, Ranges, Report,
};
pub use surface::SAMPLES;
pub use truth::{SdfTruth, SurfaceTruth, Truth};

/// Judges whatever answers points, and the mesh made from it, against the truth. `mesh` is called
/// only where the folder has a true surface. For images there is [`image_errors`].
pub fn evaluate(
    truth: &Truth,
    query: &impl PointQuery,
    mesh: impl FnOnce() -> Result<TriangleMesh>,
    pool: &ThreadPool,
) -> Result<Report> {
    if truth.sdf.is_none() && truth.surface.is_none() && truth.novel.is_none() {
        return Err(Error::invalid(
            "truth",
            "holds neither gt_sdf.npz nor gt_surface.npz with mesh.ply nor novel/: nothing to judge \
             by",
        ));
    }
    let mut report = Report::default();
    if let Some(sdf) = &truth.sdf {
        let answers = query_parallel(query, &sdf.points, Fields::ALL, pool);
        let geometry = report.geometry.get_or_insert_default();
        geometry.field = Some(field::field_errors(sdf, &answers));
        report.occupancy = field::occupancy(sdf, &answers);
    }
    if let Some(truth) = &truth.surface {
        let errors = surface::mesh_errors(&mesh()?, truth, pool);
        report.geometry.get_or_insert_default().mesh = Some(errors);
    }
    Ok(report)
}
