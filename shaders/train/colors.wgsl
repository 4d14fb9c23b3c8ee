// Colours along rays, compared with those of cameras, and differentiated back to vertices of colour
// and to the distances at the points of rays; one invocation a ray. Twin: Compare in
// src/backend/cpu/radiance/mod.rs. Constants: LEAST_TAKEN, COLOR_NEAR_M.
#import lib/band
#import lib/harmonics
#import modality/radiance

@group(0) @binding(0) var<uniform> radiance: Radiance;
@group(0) @binding(1) var<storage, read> blocks: array<vec4i>;
@group(0) @binding(2) var<storage, read> uppers: array<array<u32, 8>>;
// What frames say of a vertex: sRGB, and a weight; 0 where none saw it.
@group(0) @binding(3) var<storage, read> seen: array<vec4f>;
// What is learned on top: three logits a vertex.
@group(0) @binding(4) var<storage, read> learned_colors: array<f32>;
@group(0) @binding(5) var<storage, read> rays: array<Ray>;
@group(0) @binding(6) var<storage, read_write> points: array<RayPoint>;
@group(0) @binding(7) var<storage, read_write> compared: array<atomic<u32>, 4>;
// Sums of a vertex, and how many they are of.
@group(0) @binding(8) var<storage, read_write> color_gradients: array<atomic<i32>>;
@group(0) @binding(9) var<storage, read_write> block_flags: array<atomic<u32>>;
// Blocks that the step touched; [0] is their number.
@group(0) @binding(10) var<storage, read_write> touched_blocks: array<atomic<u32>>;
@group(0) @binding(11) var<storage, read> harmonics: array<vec2u>;

// The colour at a place: its vertices (NONE where nobody saw them) and their weights in all.
struct Shade {
  color: vec3f,
  total: f32,
  // ∂c/∂t, and ∂c/∂ logits: 0 in channels that harmonics take out of 0..1.
  along: vec3f,
  by_logits: vec3f,
  rows: array<u32, 8>,
  offset: vec3f,
}

// A piece of a ray that takes light.
struct Share {
  weight: f32,
  // The light that passes it.
  passed: f32,
  // Where its colour is taken, and how that depends on the distances at its ends.
  crossing: vec3f,
}

// The colour on a ray; its total is 0 where there is none.
fn shade_at(ray: Ray, t: f32) -> Shade {
  var shade: Shade;
  let place = band_place(ray.origin + ray.direction * t);
  shade.offset = place.offset;
  let block = find_block(place.cell);
  if block == NONE {
    return shade;
  }
  let movement = ray.direction * radiance.vertices_per_m;
  var sum = vec3f(0.0);
  var sum_along = vec3f(0.0);
  var total_along = 0.0;
  var added = vec3f(0.0);
  var added_along = vec3f(0.0);
  for (var k = 0u; k < 8u; k += 1u) {
    shade.rows[k] = NONE;
    let row = vertex_row(block, place, k);
    if row == NONE {
      continue;
    }
    let by_frames = seen[row];
    if !(by_frames.w > 0.0) {
      continue;
    }
    shade.rows[k] = row;
    let at = 3u * row;
    let taught = vec3f(learned_colors[at], learned_colors[at + 1u], learned_colors[at + 2u]);
    let value = logits_of(by_frames.xyz) + taught;
    let weight = vertex_weight(place.offset, k);
    let slope = vertex_slope(place.offset, k, movement);
    sum += value * weight;
    shade.total += weight;
    sum_along += value * slope;
    total_along += slope;
    if radiance.harmonics > 0u {
      let by_direction = added_at(row, radiance.harmonics) / HARMONIC_STEPS;
      added += by_direction * weight;
      added_along += by_direction * slope;
    }
  }
  if shade.total > 0.0 {
    let logits = sum / shade.total;
    shade.color = color_of(logits);
    shade.by_logits = shade.color * (vec3f(1.0) - shade.color);
    shade.along = (sum_along - logits * total_along) / shade.total * shade.by_logits;
    if radiance.harmonics > 0u {
      added /= shade.total;
      add_harmonics(&shade, added, (added_along - added * total_along) / shade.total);
    }
  }
  return shade;
}

// Adds to a colour what harmonics say, which changes along the ray.
fn add_harmonics(shade: ptr<function, Shade>, added: vec3f, added_along: vec3f) {
  let color = (*shade).color + added;
  let bounded = clamp(color, vec3f(0.0), vec3f(1.0));
  let open = select(vec3f(0.0), vec3f(1.0), color == bounded);
  (*shade).color = bounded;
  (*shade).by_logits *= open;
  (*shade).along = ((*shade).along + added_along) * open;
}

// What a piece takes of the light that reaches it.
fn share_of(before: RayPoint, point: RayPoint, light: f32, passed: f32) -> Share {
  return Share(light - passed, passed, crossing(before.t, point.t, before.f, point.f));
}

// Adds to the gradients of a colour's vertices.
fn scatter(shade: Shade, by_logits: vec3f) {
  for (var k = 0u; k < 8u; k += 1u) {
    let row = shade.rows[k];
    let share = vertex_weight(shade.offset, k) / shade.total;
    if row == NONE || !(share > 0.0) {
      continue;
    }
    let by = vec3i(round(by_logits * (share * radiance.units)));
    atomicAdd(&color_gradients[4u * row], by.x);
    atomicAdd(&color_gradients[4u * row + 1u], by.y);
    atomicAdd(&color_gradients[4u * row + 2u], by.z);
    atomicAdd(&color_gradients[4u * row + 3u], 1);
    let block = row >> (3u * radiance.log2_side);
    if (atomicOr(&block_flags[block], TOUCHED) & TOUCHED) == 0u {
      atomicStore(&touched_blocks[1u + atomicAdd(&touched_blocks[0], 1u)], block);
    }
  }
}

// The ray's colour, and the light that was taken (w); negative if the ray leaves the tree. Leaves
// the light that gets to each point in its `by_f`.
fn mix_colors(ray: Ray) -> vec4f {
  var sum = vec4f(0.0);
  var light = 1.0;
  var is_in_front = false;
  var before: RayPoint;
  for (var i = ray.first; i < ray.first + ray.points; i += 1u) {
    let point = points[i];
    if point.voxel == NONE {
      return vec4f(-1.0);
    }
    if point.ends != 0u {
      // Surfaces are seen from their front.
      is_in_front = is_in_front || before.f > 0.0;
      if is_in_front {
        let passed = light * light_passes(before.f, point.f, radiance.sharpness);
        if passed < light {
          let share = share_of(before, point, light, passed);
          let shade = shade_at(ray, share.crossing.x);
          if shade.total > 0.0 {
            sum += share.weight * vec4f(shade.color, 1.0);
          }
        }
        light = passed;
      }
    }
    points[i].by_f = light;
    before = point;
  }
  return sum;
}

// From ∂L/∂Ĉ of a mixed colour to vertices and points, from the last piece to the first.
fn differentiate(ray: Ray, mixed: vec3f, taken: f32, by_mixed: vec3f) {
  // Σ w ∂L/∂w over the pieces behind.
  var behind = 0.0;
  // What the piece that begins at a point asks of it.
  var by_begin = 0.0;
  for (var i = ray.first + ray.points; i > ray.first; i -= 1u) {
    let point = points[i - 1u];
    var by_f = by_begin;
    by_begin = 0.0;
    if point.ends != 0u {
      let before = points[i - 2u];
      if point.by_f < before.by_f {
        let share = share_of(before, point, before.by_f, point.by_f);
        let shade = shade_at(ray, share.crossing.x);
        if shade.total > 0.0 {
          let part = share.weight / taken;
          let by_color = by_mixed * part;
          scatter(shade, by_color * shade.by_logits);
          let by_weight = dot(by_mixed, shade.color - mixed) / taken;
          // ∂L/∂ ln q: q lowers the own weight and scales those behind.
          let by_log = behind - share.passed * by_weight;
          behind += share.weight * by_weight;
          let by_t = dot(by_mixed, shade.along) * part;
          let slopes = vec2f(
            log_slope(before.f, radiance.sharpness),
            log_slope(point.f, radiance.sharpness),
          );
          let by = share.crossing.yz * by_t + vec2f(-by_log, by_log) * slopes;
          by_begin = select(0.0, by.x, abs(before.f) < COLOR_NEAR_M);
          by_f += select(0.0, by.y, abs(point.f) < COLOR_NEAR_M);
        }
      }
    }
    points[i - 1u].by_f = by_f;
  }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
  if id.x >= radiance.rays {
    return;
  }
  let ray = rays[id.x];
  if radiance.harmonics > 0u {
    look_along(ray.direction);
  }
  let found = mix_colors(ray);
  if found.w < LEAST_TAKEN {
    for (var i = ray.first; i < ray.first + ray.points; i += 1u) {
      points[i].by_f = 0.0;
    }
    return;
  }
  let mixed = found.xyz / found.w;
  let error = mixed - ray.color;
  let loss = dot(abs(error), vec3f(1.0)) / 3.0;
  atomicAdd(&compared[RAYS_AT], 1u);
  atomicAdd(&compared[LOSS_AT], u32(round(min(loss, 8.0) * LOSS_UNITS)));
  differentiate(ray, mixed, found.w, sign(error));
}
