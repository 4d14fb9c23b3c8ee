// A camera and the image that it takes. The kernel declares `view`.

struct View {
  // Camera centre, world metres.
  eye: vec3f,
  // s of the density, 1/m.
  sharpness: f32,
  // The camera's axes in the world.
  x_axis: vec3f,
  width: u32,
  y_axis: vec3f,
  height: u32,
  z_axis: vec3f,
  // Tiles in a row of the image.
  columns: u32,
  // fx, fy, cx, cy, pixels.
  camera: vec4f,
  // The cell of the camera's centre in the lattice of cubes.
  eye_cell: vec3i,
  // Tiles of the image.
  tiles: u32,
  // Cubes of the scene, and room for pairs of a cube and a tile.
  cubes: u32,
  room: u32,
  // 1: colours are taken halfway through a voxel, for comparison.
  midpoint: u32,
  // Where the planes of the image begin, in numbers; NONE where one is not drawn.
  color_at: u32,
  normal_at: u32,
  depth_at: u32,
  opacity_at: u32,
  // A unit of the lattice of cubes, m.
  unit_m: f32,
}

// The direction through a pixel, whose z in camera axes is 1.
fn ray_through(u: u32, v: u32) -> vec3f {
  let x = (f32(u) - view.camera.z) / view.camera.x;
  let y = (f32(v) - view.camera.w) / view.camera.y;
  return view.x_axis * x + view.y_axis * y + view.z_axis;
}
