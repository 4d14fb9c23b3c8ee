// Where the samples lie: one invocation finds the voxels of one sample and of its stencil, and
// counts the sample for the losses that it pays. Twin: src/backend/cpu/plan.rs.
#import lib/step
#import lib/sample
#import lib/octree

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> links: array<u32>;
@group(0) @binding(2) var<storage, read> corners: array<array<u32, 8>>;
@group(0) @binding(3) var<storage, read> samples: array<Sample>;
@group(0) @binding(4) var<storage, read_write> sites: array<Site>;
// Samples by kind, then those with Eikonal by kind.
@group(0) @binding(5) var<storage, read_write> counts: array<atomic<u32>, 6>;

var<workgroup> group_counts: array<atomic<u32>, 6>;

fn is_number(x: f32) -> bool {
  return abs(x) <= 3.4e38;
}

// The voxels of the stencil: the sample's own, and a descent only for points that leave it.
fn locate_stencil(point: vec3f, centre: u32, site: ptr<function, Site>) {
  let home = voxel_box(point, voxel_log2(centre));
  let high = home.xyz + vec3f(home.w);
  for (var i = 0u; i < POINTS - 1u; i += 1u) {
    let at = point + stencil_offset(i);
    var voxel = centre;
    if !(all(at >= home.xyz) && all(at < high)) {
      voxel = find_voxel(at);
    }
    if !usable(voxel) {
      (*site).around[0] = NONE;
      return;
    }
    (*site).around[i] = voxel;
  }
}

@compute @workgroup_size(64)
fn main(
  @builtin(global_invocation_id) id: vec3u,
  @builtin(local_invocation_index) local: u32,
) {
  if local < 6u {
    atomicStore(&group_counts[local], 0u);
  }
  workgroupBarrier();
  if id.x < step.samples {
    let sample = samples[id.x];
    var site: Site;
    site.centre = NONE;
    site.around[0] = NONE;
    if sample.kind <= SURFACE && is_number(sample.distance) && is_number(sample.occupancy) {
      let voxel = find_voxel(sample.point);
      if usable(voxel) {
        site.centre = voxel;
        if sample.eikonal != 0u {
          locate_stencil(sample.point, voxel, &site);
        }
        atomicAdd(&group_counts[sample.kind], 1u);
        if site.around[0] != NONE {
          atomicAdd(&group_counts[3u + sample.kind], 1u);
        }
      }
    }
    sites[id.x] = site;
  }
  workgroupBarrier();
  if local < 6u {
    atomicAdd(&counts[local], atomicLoad(&group_counts[local]));
  }
}
