// Colours, and the light that a surface takes; the twin of src/modality/radiance.rs, density.rs
// and composite.rs.
#import lib/radiance

// Colours are kept this far from 0 and 1.
const COLOR_MARGIN: f32 = 0.001953125;
// Beyond this many 1/s, Φ is 0 or 1.
const LIGHT_REACH: f32 = 40.0;

fn logits_of(color: vec3f) -> vec3f {
  let c = clamp(color, vec3f(COLOR_MARGIN), vec3f(1.0 - COLOR_MARGIN));
  return log(c / (vec3f(1.0) - c));
}

fn color_of(logits: vec3f) -> vec3f {
  return vec3f(1.0) / (vec3f(1.0) + exp(-logits));
}

// Φ.
fn lit(f: f32, sharpness: f32) -> f32 {
  return 1.0 / (1.0 + exp(-clamp(sharpness * f, -LIGHT_REACH, LIGHT_REACH)));
}

// The share of light that passes a segment.
fn light_passes(f_in: f32, f_out: f32, sharpness: f32) -> f32 {
  return min(lit(f_out, sharpness) / lit(f_in, sharpness), 1.0);
}

// d ln Φ(f) / df.
fn log_slope(f: f32, sharpness: f32) -> f32 {
  return sharpness * (1.0 - lit(f, sharpness));
}

// Where the colour of a piece is taken (x), and how that depends on the distances at its ends.
fn crossing(begin: f32, end: f32, a: f32, b: f32) -> vec3f {
  let length = end - begin;
  if !(a > 0.0 && b <= 0.0) {
    return vec3f(begin + 0.5 * length, 0.0, 0.0);
  }
  let fall = a - b;
  return vec3f(
    begin + length * (a / fall),
    -length * b / (fall * fall),
    length * a / (fall * fall),
  );
}
