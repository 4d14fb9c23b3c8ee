// Brings records from the host to their places: an invocation writes one word. A record is the
// index of its place and WORDS words (a constant).

@group(0) @binding(0) var<storage, read> records: array<u32>;
@group(0) @binding(1) var<storage, read_write> pool: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
  let words = arrayLength(&records) / (WORDS + 1u) * WORDS;
  for (var item = id.x; item < words; item += groups.x * 64u) {
    let record = item / WORDS * (WORDS + 1u);
    let word = item % WORDS;
    pool[records[record] * WORDS + word] = records[record + 1u + word];
  }
}
