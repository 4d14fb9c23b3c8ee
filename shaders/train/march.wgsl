// Rays through the leaves that may have a part of a surface, cut into pieces; one invocation a ray.
// Twin: src/backend/cpu/radiance/march.rs. Constants: FILL (0: points are counted; 1: they are laid
// down from where train/scan put each ray's first), BEFORE_M, BEHIND_M, PIECE, HALF_DIAGONAL.
#import lib/radiance
#import lib/traverse

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<uniform> radiance: Radiance;
@group(0) @binding(2) var<storage, read> links: array<u32>;
@group(0) @binding(3) var<storage, read> corners: array<array<u32, 8>>;
@group(0) @binding(4) var<storage, read> prior: array<vec4f>;
@group(0) @binding(5) var<storage, read> learned: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> rays: array<Ray>;
@group(0) @binding(7) var<storage, read_write> points: array<RayPoint>;

// The next point of this invocation's ray.
var<private> next: u32;

// Whether a voxel's corners lie so near to a surface that it takes light.
fn takes_light(voxel: u32) -> bool {
  let size_m = f32(1u << voxel_log2(voxel)) * step.unit_m;
  let reach = HALF_DIAGONAL * size_m + radiance.reach_m;
  for (var k = 0u; k < 8u; k += 1u) {
    let row = corners[voxel_node(voxel)][k];
    if row < step.rows {
      let distance = prior[row].x + learned[row * ROW_QUADS + EXPLICIT_QUAD].x;
      if abs(distance) <= reach {
        return true;
      }
    }
  }
  return false;
}

fn add_point(ray: Ray, t: f32, ends: u32) {
  if FILL == 1u {
    var point: RayPoint;
    point.place = ray.origin + ray.direction * t;
    point.t = t;
    point.ends = ends;
    points[next] = point;
  }
  next += 1u;
}

// Cuts a segment into pieces; `last` is where the piece before ended.
fn cut(ray: Ray, segment: Segment, last: f32) {
  let size_m = f32(1u << voxel_log2(segment.voxel)) * step.unit_m;
  let length_m = (segment.t_out - segment.t_in) * length(ray.direction);
  let count = max(ceil(length_m / (PIECE * size_m)), 1.0);
  if segment.t_in != last {
    add_point(ray, segment.t_in, 0u);
  }
  for (var i = 1u; i <= u32(count); i += 1u) {
    let share = f32(i) / count;
    add_point(ray, segment.t_in + (segment.t_out - segment.t_in) * share, 1u);
  }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
  if id.x >= radiance.rays {
    return;
  }
  let ray = rays[id.x];
  next = select(0u, ray.first, FILL == 1u);
  if ray.z >= 0.0 && (FILL == 0u || ray.points > 0u) {
    follow(ray.origin, ray.direction, max(ray.z - BEFORE_M, 0.0), ray.z + BEHIND_M);
    var last = -1.0;
    loop {
      let segment = next_segment();
      if segment.voxel == NONE {
        break;
      }
      if voxel_log2(segment.voxel) <= radiance.surface_log2 && takes_light(segment.voxel) {
        cut(ray, segment, last);
        last = segment.t_out;
      }
    }
  }
  if FILL == 0u {
    rays[id.x].points = next;
  }
}
