// How much light a surface takes; the twin of src/modality/density.rs. Constants of the host: REACH
// and LEAST_POSITIVE.

// 1 / Φ: light falls from one distance to another as 1 / Φ grows.
fn dimness(f: f32, sharpness: f32) -> f32 {
  return exp(clamp(-sharpness * f, -REACH, REACH)) + 1.0;
}

// The share of light that passes a segment.
fn passes(f_in: f32, f_out: f32, sharpness: f32) -> f32 {
  return min(dimness(f_in, sharpness) / dimness(f_out, sharpness), 1.0);
}

// Where in a segment, 0..=1, the light has fallen to the share `passed`, if f is linear in it.
fn place_of(passed: f32, f_in: f32, f_out: f32, sharpness: f32) -> f32 {
  let lit = passed / dimness(f_in, sharpness);
  let f = log(lit / max(1.0 - lit, LEAST_POSITIVE)) / sharpness;
  return clamp((f_in - f) / (f_in - f_out), 0.0, 1.0);
}

// Where in a segment, 0..=1, half of what it takes is taken, if f is linear in it.
fn middle(f_in: f32, f_out: f32, sharpness: f32) -> f32 {
  let passed = 0.5 + 0.5 * passes(f_in, f_out, sharpness);
  return place_of(passed, f_in, f_out, sharpness);
}
