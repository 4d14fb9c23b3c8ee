// Occupancy: ℓ(x) = ℓ0(d_ga) + D(c, o); the twin of src/modality/occupancy.rs.
#import lib/constants

// ℓ0, from d_ga.
fn prior_logit(d_ga: f32) -> f32 {
  return clamp(SURFACE_LOGIT - d_ga / OCCUPANCY_WIDTH_M, -PRIOR_LIMIT, PRIOR_LIMIT);
}
