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
//!
//! **Language** (algorithms.md §10). Classes are those that at least 0.1 % of the places have; a place is
//! taken for the class whose bare name has the largest cosine. mIoU and mAcc are means over classes,
//! from one confusion matrix; AP is the area under precision over recall when places are ranked by the
//! relevancy of a class against the others, mAP its mean. *3D*: points of labelled depth images, of the
//! folder's own and of those in `novel/`, the first in each cell of 2.5 cm, not at edges of depth, at
//! most 200 000. *2D*: every fourth pixel, in u and v, of the labelled views in `novel/`, at the place
//! where the map's own surface is drawn. Unknown places (no code, nothing drawn) are left out of every
//! mean and counted in `known_share_3d` and `known_share_2d`. *cosine* is the mean cosine of the decoded
//! feature at a 3D point with the embedding of its true class; *atoms* and *bytes* are those of the
//! dictionary and of codes and atoms as they are published.

mod closest;
mod field;
mod images;
mod language;
mod report;
mod surface;
mod truth;

use rayon::ThreadPool;

use crate::error::{Error, Result};
use crate::map::{Fields, PointQuery, TriangleMesh, query_parallel};

pub use images::{Lpips, image_errors};
pub use language::{ClassScores, class_scores, language_scores};
pub use report::{
    FieldErrors, Geometry, ImageErrors, KnownShare, LanguageScores, MeshErrors, Occupancy, Ranges,
    Report,
};
pub use surface::SAMPLES;
pub use truth::{SdfTruth, SurfaceTruth, Truth};

/// Judges whatever answers points, and the mesh made from it, against the truth. `mesh` is called
/// only where the folder has a true surface. For images there is [`image_errors`], for
/// language [`language_scores`].
pub fn evaluate(
    truth: &Truth,
    query: &impl PointQuery,
    mesh: impl FnOnce() -> Result<TriangleMesh>,
    pool: &ThreadPool,
) -> Result<Report> {
    if truth.is_empty() {
        return Err(Error::invalid(
            "truth",
            "holds neither gt_sdf.npz nor gt_surface.npz with mesh.ply nor novel/ nor labels.json: \
             nothing to judge by",
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
