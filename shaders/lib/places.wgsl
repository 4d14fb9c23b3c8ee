// Tables of places in open addressing, with a power of two of slots; the twin of
// src/backend/gpu/places.rs.

// The slot where the search for a place starts, before it is cut to the table's size.
fn place_slot(place: vec3i) -> u32 {
  let p = vec3u(place);
  let h = p.x * 0x9e3779b1u + p.y * 0x85ebca77u + p.z * 0xc2b2ae3du;
  return h ^ (h >> 15u);
}
