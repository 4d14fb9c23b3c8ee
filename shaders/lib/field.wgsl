// f at the points of a tile, from the rows around them: gathered by four invocations a point, then
// decoded (lib/decoder). The kernel declares `step`, `corners`, `prior`, `learned` and `weights`.
// Twin: src/backend/cpu/interpolate.rs.
#import lib/decoder
#import lib/interpolation
#import lib/lattice
#import lib/sample
#import modality/sdf

// By point: place in its voxel, the voxel's node, d_ga.
var<workgroup> places: array<vec4f, TILE>;
var<workgroup> nodes: array<u32, TILE>;
var<workgroup> distances: array<f32, TILE>;

// Interpolates features and d_ga at point t / 4 of the tile, in a voxel or in none: each of its
// invocations has a quad of the feature, and d_ga's share of two corners.
fn gather_at(t: u32, voxel: u32, point: vec3f) {
  let part = t % 4u;
  var feature = vec4f(0.0);
  var share = 0.0;
  var place = vec4f(0.0, 0.0, 0.0, 1.0);
  if voxel != NONE {
    let box = voxel_box(point, voxel_log2(voxel));
    place = vec4f(point - box.xyz, box.w);
    for (var k = 0u; k < 8u; k += 1u) {
      let row = corners[voxel_node(voxel)][k];
      let weight = corner_weight(place, k);
      feature += weight * learned[row * ROW_QUADS + part];
      if k / 2u == part {
        let vertex = prior[row] + learned[row * ROW_QUADS + EXPLICIT_QUAD];
        share += weight * extrapolated(place, k, vertex);
      }
    }
  }
  features[t] = feature;
  sums[t] = share;
  if part == 0u {
    places[t / 4u] = place;
    nodes[t / 4u] = select(voxel_node(voxel), NONE, voxel == NONE);
  }
}

// d_ga and context of a point, from what was gathered.
fn sum_up(point: u32) {
  let at = 4u * point;
  let distance = (sums[at] + sums[at + 1u]) + (sums[at + 2u] + sums[at + 3u]);
  distances[point] = distance;
  contexts[point] = context_of(distance);
}

// f at a point that was decoded.
fn found_at(point: u32) -> f32 {
  return distances[point] + outputs[point];
}
