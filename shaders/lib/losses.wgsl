// The losses of one sample and their derivatives; the twin of src/modality/losses.rs. The kernel
// has the constant POINTS: 7 for central differences, 4 for forward ones.
#import lib/constants

// A loss and its derivative.
struct Loss {
  value: f32,
  slope: f32,
}

fn absolute_loss(found: f32, label: f32) -> Loss {
  return Loss(abs(found - label), sign(found - label));
}

// Binary cross-entropy of a logit against a label in 0..=1.
fn cross_entropy(logit: f32, label: f32) -> Loss {
  let value = max(logit, 0.0) + log(1.0 + exp(-abs(logit))) - label * logit;
  return Loss(value, 1.0 / (1.0 + exp(-logit)) - label);
}

// Distance against the sign of a confident logit.
fn consistency_loss(found: f32, logit: f32) -> Loss {
  let product = found * sign(logit);
  if abs(logit) > CONFIDENT_LOGIT && product > 0.0 {
    return Loss(product, sign(logit));
  }
  return Loss(0.0, 0.0);
}

// ∂/∂g of | ‖g‖ − 1 | and the loss itself (w).
fn eikonal_loss(g: vec3f) -> vec4f {
  let norm = sqrt(dot(g, g) + SAFE_NORM);
  return vec4f(g * (sign(norm - 1.0) / norm), abs(norm - 1.0));
}
