// Counter-based random numbers; the twin of src/geometry/random.rs.

const TAU = 6.2831855;

fn mix_words(words: vec4u) -> vec4u {
  var v = words;
  v.x += v.y * v.w;
  v.y += v.z * v.x;
  v.z += v.x * v.y;
  v.w += v.y * v.z;
  return v;
}

fn pcg4d(counter: vec4u) -> vec4u {
  var v = mix_words(counter * 1664525u + 1013904223u);
  v ^= v >> vec4u(16u);
  return mix_words(v);
}

// A uniform number in [0, 1) from the upper 24 bits of a word.
fn unit(word: u32) -> f32 {
  return f32(word >> 8u) * (1.0 / 16777216.0);
}

// A standard normal number from two words. A driver's logarithm may be above zero at 1, and its
// cosine is exact within ±π alone: cos 2πu = −cos 2π(u − ½).
fn normal(a: u32, b: u32) -> f32 {
  let radius = sqrt(max(-2.0 * log(1.0 - unit(a)), 0.0));
  return -radius * cos(TAU * (unit(b) - 0.5));
}

// The upper word of the product of two words.
fn multiply_high(a: u32, b: u32) -> u32 {
  let a_low = a & 0xffffu;
  let a_high = a >> 16u;
  let b_low = b & 0xffffu;
  let b_high = b >> 16u;
  let one = a_high * b_low + ((a_low * b_low) >> 16u);
  let other = a_low * b_high + (one & 0xffffu);
  return a_high * b_high + (one >> 16u) + (other >> 16u);
}
