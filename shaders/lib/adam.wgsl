// Adam, with the step count of whatever is stepped; the twin of src/backend/cpu/adam.rs.
#import lib/constants

struct Moments {
  first: vec4f,
  second: vec4f,
}

// 1 − βᵗ, given log2 β. Near t = 0 a difference of two numbers near 1 would lose the digits that
// matter, so there it is a series.
fn left_of(log2_beta: f32, t: u32) -> f32 {
  let x = f32(t) * log2_beta;
  let y = x * 0.6931471805599453;
  if y > -0.1 {
    return -y * (1.0 + y * (0.5 + y * (1.0 / 6.0 + y * (1.0 / 24.0 + y / 120.0))));
  }
  return 1.0 - exp2(x);
}

// What a step takes from four numbers that share a step count t ≥ 1.
fn adam(memory: ptr<function, Moments>, gradient: vec4f, t: u32, rate: f32) -> vec4f {
  let first = BETA1 * (*memory).first + (1.0 - BETA1) * gradient;
  let second = BETA2 * (*memory).second + (1.0 - BETA2) * gradient * gradient;
  *memory = Moments(first, second);
  let first_left = left_of(LOG2_BETA1, t);
  let second_left = left_of(LOG2_BETA2, t);
  return rate * (first / first_left) / (sqrt(second / second_left) + EPSILON);
}
