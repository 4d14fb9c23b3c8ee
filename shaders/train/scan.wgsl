// Gives the points of each ray their place, in the order of rays: one workgroup. Rays that find no
// room get none, and are counted.
#import lib/radiance

@group(0) @binding(0) var<uniform> radiance: Radiance;
@group(0) @binding(1) var<storage, read_write> rays: array<Ray>;
@group(0) @binding(2) var<storage, read_write> compared: array<atomic<u32>, 4>;

const THREADS = 256u;

var<workgroup> sums: array<u32, THREADS>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) t: u32) {
  let share = (radiance.rays + THREADS - 1u) / THREADS;
  let begin = min(t * share, radiance.rays);
  let end = min(begin + share, radiance.rays);
  var sum = 0u;
  for (var i = begin; i < end; i += 1u) {
    sum += rays[i].points;
  }
  sums[t] = sum;
  workgroupBarrier();
  var first = 0u;
  for (var i = 0u; i < t; i += 1u) {
    first += sums[i];
  }
  for (var i = begin; i < end; i += 1u) {
    let points = rays[i].points;
    rays[i].first = first;
    first += points;
    if first <= radiance.room {
      atomicMax(&compared[POINTS_AT], first);
    } else if points > 0u {
      rays[i].points = 0u;
      atomicAdd(&compared[CROWDED_AT], 1u);
    }
  }
}
