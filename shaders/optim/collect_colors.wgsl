// Copies blocks of colour that changed to where the host reads them, from the end of the list, and
// takes their flags; optim/trim then shortens the list. An invocation a word. Constant: VERTICES (of
// a block).
#import lib/constants

@group(0) @binding(0) var<storage, read> learned_colors: array<u32>;
@group(0) @binding(1) var<storage, read_write> block_flags: array<u32>;
// Blocks that changed since the host read them; [0] is their number.
@group(0) @binding(2) var<storage, read> changed_blocks: array<u32>;
// By block: its number, then three logits a vertex.
@group(0) @binding(3) var<storage, read_write> copied: array<u32>;
// x: blocks that there is room for.
@group(0) @binding(4) var<uniform> room: vec4u;

const WORDS = 3u * VERTICES;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
  let count = changed_blocks[0];
  let copies = min(count, room.x);
  for (var item = id.x; item < copies * (WORDS + 1u); item += groups.x * 64u) {
    let block = changed_blocks[1u + (count - copies) + item / (WORDS + 1u)];
    let word = item % (WORDS + 1u);
    if word == 0u {
      copied[item] = block;
      block_flags[block] &= ~CHANGED;
    } else {
      copied[item] = learned_colors[block * WORDS + word - 1u];
    }
  }
}
