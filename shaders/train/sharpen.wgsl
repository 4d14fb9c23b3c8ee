// What distances learn from the colours of rays, fused: gather, decoder, backward, scatter. A
// workgroup owns every groups-th tile of points; it runs behind train/distance of the same step.
// Twin: src/backend/cpu/chunk.rs, for samples of the kind Ray. Constants: those of lib/decoder.
#import lib/step
#import lib/field
#import lib/scatter
#import lib/radiance

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<uniform> radiance: Radiance;
@group(0) @binding(2) var<storage, read> corners: array<array<u32, 8>>;
@group(0) @binding(3) var<storage, read> prior: array<vec4f>;
@group(0) @binding(4) var<storage, read> learned: array<vec4f>;
@group(0) @binding(5) var<storage, read> weights: array<vec4f>;
@group(0) @binding(6) var<storage, read> compared: array<u32, 4>;
@group(0) @binding(7) var<storage, read> points: array<RayPoint>;
// The lanes of these points, behind those of samples.
@group(0) @binding(8) var<storage, read_write> partials: array<vec4f>;
@group(0) @binding(9) var<storage, read_write> gradients: array<atomic<i32>>;
@group(0) @binding(10) var<storage, read_write> flags: array<atomic<u32>>;
// Rows that the step touched; [0] is their number.
@group(0) @binding(11) var<storage, read_write> touched: array<atomic<u32>>;

@compute @workgroup_size(128)
fn main(
  @builtin(local_invocation_index) t: u32,
  @builtin(workgroup_id) group: vec3u,
  @builtin(num_workgroups) groups: vec3u,
) {
  let count = compared[POINTS_AT];
  // The loss is a mean over the rays that have a colour, and over channels.
  let factor = radiance.weight / f32(3u * max(compared[RAYS_AT], 1u));
  for (var tile = group.x; tile < (count + TILE - 1u) / TILE; tile += groups.x) {
    let index = tile * TILE + t / 4u;
    var voxel = NONE;
    var place = vec3f(0.0);
    if index < count && points[index].by_f != 0.0 {
      voxel = points[index].voxel;
      place = points[index].place;
    }
    gather_at(t, voxel, place);
    workgroupBarrier();
    if t < TILE {
      sum_up(t);
      by_outputs[t] = 0.0;
      if nodes[t] != NONE {
        by_outputs[t] = points[tile * TILE + t].by_f * factor;
      }
    }
    workgroupBarrier();
    decoder_forward(t);
    decoder_backward(t);
    for (var item = t; item < TILE * 8u * QUADS; item += THREADS) {
      let point = item / (8u * QUADS);
      let corner = item / QUADS % 8u;
      if nodes[point] != NONE {
        let by = by_corner(point, corner, item % QUADS);
        scatter_to(corners[nodes[point]][corner], item % QUADS, by);
      }
    }
    workgroupBarrier();
  }
  decoder_store(t, group.x);
  losses_store(t, group.x, array<f32, LOSSES>());
}
