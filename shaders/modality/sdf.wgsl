// The signed distance: f(x) = d_ga + D(c, f); the twin of src/modality/sdf.rs.
#import lib/constants

// c, from d_ga.
fn context_of(d_ga: f32) -> f32 {
  return clamp(d_ga, -CONTEXT_LIMIT_M, CONTEXT_LIMIT_M);
}

// ∂c/∂d_ga.
fn context_slope(d_ga: f32) -> f32 {
  return select(0.0, 1.0, abs(d_ga) < CONTEXT_LIMIT_M);
}
