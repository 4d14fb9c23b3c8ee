// f at the points of rays. A workgroup owns every groups-th tile of points. Twin: distances_at in
// src/backend/cpu/radiance/mod.rs. Constants: those of lib/decoder.
#import lib/step
#import lib/field
#import lib/octree
#import lib/radiance

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> links: array<u32>;
@group(0) @binding(2) var<storage, read> corners: array<array<u32, 8>>;
@group(0) @binding(3) var<storage, read> prior: array<vec4f>;
@group(0) @binding(4) var<storage, read> learned: array<vec4f>;
@group(0) @binding(5) var<storage, read> weights: array<vec4f>;
@group(0) @binding(6) var<storage, read> compared: array<u32, 4>;
@group(0) @binding(7) var<storage, read_write> points: array<RayPoint>;

var<workgroup> voxels: array<u32, TILE>;

@compute @workgroup_size(128)
fn main(
  @builtin(local_invocation_index) t: u32,
  @builtin(workgroup_id) group: vec3u,
  @builtin(num_workgroups) groups: vec3u,
) {
  let count = compared[POINTS_AT];
  for (var tile = group.x; tile < (count + TILE - 1u) / TILE; tile += groups.x) {
    if t < TILE {
      let index = tile * TILE + t;
      voxels[t] = NONE;
      if index < count {
        let voxel = find_voxel(points[index].place);
        if usable(voxel) {
          voxels[t] = voxel;
        }
      }
    }
    workgroupBarrier();
    let index = tile * TILE + t / 4u;
    var place = vec3f(0.0);
    if index < count {
      place = points[index].place;
    }
    gather_at(t, voxels[t / 4u], place);
    workgroupBarrier();
    if t < TILE {
      sum_up(t);
    }
    workgroupBarrier();
    decoder_forward(t);
    let own = tile * TILE + t;
    if t < TILE && own < count {
      points[own].voxel = voxels[t];
      points[own].f = found_at(t);
    }
    workgroupBarrier();
  }
}
