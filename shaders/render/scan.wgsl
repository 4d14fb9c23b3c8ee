// Where the cubes of each tile begin, from how many there are; one workgroup. The counts become
// where the next one goes.
#import lib/view

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;
// One more than there are tiles: the last is the number of pairs.
@group(0) @binding(2) var<storage, read_write> starts: array<u32>;

const GROUP = 256u;

var<workgroup> sums: array<u32, GROUP>;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) t: u32) {
  let share = (view.tiles + GROUP - 1u) / GROUP;
  let first = min(t * share, view.tiles);
  let last = min(first + share, view.tiles);
  var sum = 0u;
  for (var tile = first; tile < last; tile += 1u) {
    sum += counts[tile];
  }
  sums[t] = sum;
  workgroupBarrier();
  for (var reach = 1u; reach < GROUP; reach *= 2u) {
    var before = 0u;
    if t >= reach {
      before = sums[t - reach];
    }
    workgroupBarrier();
    sums[t] += before;
    workgroupBarrier();
  }
  var start = sums[t] - sum;
  for (var tile = first; tile < last; tile += 1u) {
    let count = counts[tile];
    starts[tile] = start;
    counts[tile] = start;
    start += count;
  }
  if t == GROUP - 1u {
    starts[view.tiles] = sums[t];
  }
}
