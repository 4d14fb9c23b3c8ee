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
  // What its colours are multiplied by.
  gain: vec3f,
}

// World direction of a pixel, u and v in 16 bits each, with z = 1 in camera axes.
fn pixel_direction(frame: Frame, place: u32) -> vec3f {
  let at = vec2f(f32(place & 0xffffu), f32(place >> 16u));
  let across = (at - frame.camera.zw) * frame.camera.xy;
  return frame.x_axis * across.x + frame.y_axis * across.y + frame.z_axis;
}
