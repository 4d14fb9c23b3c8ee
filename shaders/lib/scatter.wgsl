// What the points of a tile ask of the rows around them, after lib/backward. The kernel declares,
// besides what lib/field and lib/gradients need, `flags` (array<atomic<u32>>) and `touched`
// (array<atomic<u32>>: rows that the step touched; [0] is their number).
#import lib/backward
#import lib/field
#import lib/gradients

// Quads of a row that distances learn: the residual feature, and the explicit part.
const QUADS = SDF_FEATURES / 4u + 1u;

// ∂L by one of these quads of a corner, from a point of the tile.
fn by_corner(point: u32, corner: u32, quad: u32) -> vec4f {
  let weight = corner_weight(places[point], corner);
  if quad < SDF_FEATURES / 4u {
    return weight * features[point * INPUT_QUADS + quad];
  }
  let by_distance = by_outputs[point] + by_contexts[point] * context_slope(distances[point]);
  return (weight * by_distance) * vec4f(1.0, lever(places[point], corner));
}

// Adds to one of these quads of a row.
fn scatter_to(row: u32, quad: u32, by: vec4f) {
  if quad < SDF_FEATURES / 4u {
    add_gradient(row, quad, by, vec4f(SDF_UNITS));
    return;
  }
  add_gradient(row, EXPLICIT_QUAD, by, vec4f(DISTANCE_UNITS, vec3f(GRADIENT_UNITS)));
  if (atomicOr(&flags[row], TOUCHED) & TOUCHED) == 0u {
    atomicStore(&touched[1u + atomicAdd(&touched[0], 1u)], row);
  }
}
