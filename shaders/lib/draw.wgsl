// Which rays a step draws, and what they are labelled by.

struct Draw {
  rays: u32,
  // Frames that share them.
  frames: u32,
  // What random numbers count from.
  seed: u32,
  counter: u32,
  // Share of the samples that are asked to pay the Eikonal loss.
  eikonal_share: f32,
  // Edge length of an evidence cell, m, and its inverse, as the host has it.
  cell_m: f32,
  inverse_cell: f32,
  // Radius of a surfel's disc, m.
  radius_m: f32,
  // A ray whose end lies farther than this from every surfel is skipped, m.
  stale_m: f32,
}

// A frame of the window.
struct Frame {
  // Camera centre, world metres.
  origin: vec3f,
  // The place of its first pixel.
  first: u32,
  // The camera's axes in the world.
  x_axis: vec3f,
  pixels: u32,
  y_axis: vec3f,
  z_axis: vec3f,
  // 1/fx, 1/fy, cx, cy.
  camera: vec4f,
}
