// Descent from the root to the finest voxel with rows. The kernel declares `step`, `links` (child
// links by node) and `corners` (the rows of a node's corners).
#import lib/lattice
#import lib/sample

// The octant of a cell at one level.
fn octant_of(offset: vec3u, bit: u32) -> u32 {
  let bits = (offset >> vec3u(bit)) & vec3u(1u);
  return bits.x | (bits.y << 1u) | (bits.z << 2u);
}

// Whether a point lies in the root; not a number does not.
fn in_root(point: vec3f) -> bool {
  let at = point / step.unit_m;
  let low = vec3f(step.root_min);
  let high = low + vec3f(f32(1u << step.root_log2));
  return all(at >= low) && all(at < high);
}

// The finest voxel with rows that contains a point, packed; NONE outside the tree.
fn find_voxel(point: vec3f) -> u32 {
  if step.root_node == NONE || !in_root(point) {
    return NONE;
  }
  let offset = offset_of(point);
  var node = step.root_node;
  var bit = step.root_log2;
  var found = NONE;
  loop {
    if corners[node][0] != NONE {
      found = pack_voxel(node, bit);
    }
    if bit == 0u {
      break;
    }
    bit -= 1u;
    let link = links[node];
    let octant = octant_of(offset, bit);
    if ((link >> octant) & 1u) == 0u {
      break;
    }
    node = (link >> 8u) * 8u + octant;
  }
  return found;
}

// Whether all corner rows of a voxel exist.
fn usable(voxel: u32) -> bool {
  if voxel == NONE {
    return false;
  }
  let node = voxel_node(voxel);
  for (var k = 0u; k < 8u; k += 1u) {
    if corners[node][k] >= step.rows {
      return false;
    }
  }
  return true;
}
