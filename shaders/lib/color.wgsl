// Colours of the band at points; the twin of src/modality/radiance.rs and src/octree/band.rs. The
// kernel declares `scene`, `blocks` (by block: itself and its upper neighbours, bit 0 = x, 1 = y,
// 2 = z; NONE where there is none), `texels` (by vertex: three logits, all 0 where no colour was
// observed, and a distance, 16 bits each) and what lib/harmonics needs.
#import lib/scene
#import lib/harmonics

// Steps of a stored logit in one unit.
const LOGIT_STEPS: f32 = 4096.0;

// A colour as it is seen along the direction that was looked along, and 1 where there is one.
fn color_in(block: u32, point: vec3f) -> vec4f {
  if block == NONE {
    return vec4f(0.0);
  }
  let at = point * scene.band_scale;
  let low = vec3i(floor(at));
  let t = at - vec3f(low);
  let side = 1u << scene.band_log2;
  let local = vec3u(low) & vec3u(side - 1u);
  let shifts = vec3u(0u, scene.band_log2, 2u * scene.band_log2);
  var sum = vec3f(0.0);
  var added = vec3f(0.0);
  var total = 0.0;
  for (var k = 0u; k < 8u; k += 1u) {
    let bits = vec3u(k, k >> 1u, k >> 2u) & vec3u(1u);
    let vertex = local + bits;
    let beyond = select(vec3u(0u), vec3u(1u, 2u, 4u), vertex == vec3u(side));
    let owner = blocks[8u * block + (beyond.x | beyond.y | beyond.z)];
    if owner == NONE {
      continue;
    }
    let within = (vertex & vec3u(side - 1u)) << shifts;
    let row = (owner << (3u * scene.band_log2)) + (within.x | within.y | within.z);
    let texel = texels[row];
    if texel.x != 0u || (texel.y & 0xffffu) != 0u {
      let factors = select(vec3f(1.0) - t, t, bits == vec3u(1u));
      let weight = factors.x * factors.y * factors.z;
      let words = vec3u(texel.x << 16u, texel.x, texel.y << 16u);
      sum += weight * vec3f(bitcast<vec3i>(words) >> vec3u(16u));
      total += weight;
      if scene.harmonics > 0u {
        added += weight * added_at(row, scene.harmonics);
      }
    }
  }
  if total <= 0.0 {
    return vec4f(0.0);
  }
  let logits = sum / (total * LOGIT_STEPS);
  let color = vec3f(1.0) / (vec3f(1.0) + exp(-logits));
  if scene.harmonics == 0u {
    return vec4f(color, 1.0);
  }
  return vec4f(clamp(color + added / (total * HARMONIC_STEPS), vec3f(0.0), vec3f(1.0)), 1.0);
}
