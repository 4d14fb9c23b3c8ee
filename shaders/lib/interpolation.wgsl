// Trilinear weights and the gradient-augmented interpolation in one voxel; the twin of
// src/modality/interpolation.rs. A place is (offset from the voxel's low corner, edge length), m.
#import lib/constants

// 0 or 1 by axis: whether corner k lies on the upper side.
fn upper(k: u32) -> vec3f {
  return vec3f(vec3u(k, k >> 1u, k >> 2u) & vec3u(1u));
}

// The trilinear weight of corner k.
fn corner_weight(place: vec4f, k: u32) -> f32 {
  let t = place.xyz * (1.0 / place.w);
  let factors = select(vec3f(1.0) - t, t, upper(k) > vec3f(0.0));
  return factors.x * factors.y * factors.z;
}

// GRADIENT_SHARE of x − x_k, m: what G_k is multiplied by.
fn lever(place: vec4f, k: u32) -> vec3f {
  return GRADIENT_SHARE * (place.xyz - place.w * upper(k));
}

// D_k + ½ G_kᵀ(x − x_k).
fn extrapolated(place: vec4f, k: u32, vertex: vec4f) -> f32 {
  return vertex.x + dot(vertex.yzw, lever(place, k));
}
