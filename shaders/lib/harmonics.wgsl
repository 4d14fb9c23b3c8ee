// Real spherical harmonics, and what they add to colours; the twin of src/geometry/harmonics.rs and
// src/modality/radiance.rs. The kernel declares `harmonics` (vertex by vertex, all of one before the
// next: three coefficients of 16 bits each, first what is added along the mean of all directions).
#import lib/constants

// Steps of a stored coefficient in one unit.
const HARMONIC_STEPS: f32 = 8192.0;
// √(3 / 4π).
const DEGREE_1: f32 = 0.4886025;
// √(15 / 4π), √(5 / 16π) and √(15 / 16π).
const DEGREE_2 = vec3f(1.0925484, 0.31539157, 0.5462742);
// √(35 / 32π), √(105 / 4π), √(21 / 32π), and √(7 / 16π) and √(105 / 16π).
const DEGREE_3 = vec3f(0.5900436, 2.8906114, 0.4570458);
const DEGREE_3_ALONG_Z = vec2f(0.37317634, 1.4453057);

// What coefficients are multiplied with: 1, and the harmonics of degrees 1 to 3 along a direction.
var<private> basis: array<f32, 16>;

// Sets the basis to that of a direction of any length but 0.
fn look_along(direction: vec3f) {
  let d = normalize(direction);
  let s = d * d;
  basis = array<f32, 16>(
    1.0,
    -DEGREE_1 * d.y,
    DEGREE_1 * d.z,
    -DEGREE_1 * d.x,
    DEGREE_2.x * d.x * d.y,
    -DEGREE_2.x * d.y * d.z,
    DEGREE_2.y * (2.0 * s.z - s.x - s.y),
    -DEGREE_2.x * d.x * d.z,
    DEGREE_2.z * (s.x - s.y),
    -DEGREE_3.x * d.y * (3.0 * s.x - s.y),
    DEGREE_3.y * d.x * d.y * d.z,
    -DEGREE_3.z * d.y * (4.0 * s.z - s.x - s.y),
    DEGREE_3_ALONG_Z.x * d.z * (2.0 * s.z - 3.0 * s.x - 3.0 * s.y),
    -DEGREE_3.z * d.x * (4.0 * s.z - s.x - s.y),
    DEGREE_3_ALONG_Z.y * d.z * (s.x - s.y),
    -DEGREE_3.x * d.x * (s.x - 3.0 * s.y),
  );
}

// What the coefficients of a vertex, as many as there are for one, add along the direction, in steps.
fn added_at(vertex: u32, terms: u32) -> vec3f {
  var sum = vec3f(0.0);
  for (var i = 0u; i < terms; i += 1u) {
    let term = harmonics[vertex * terms + i];
    let words = vec3u(term.x << 16u, term.x, term.y << 16u);
    sum += basis[i] * vec3f(bitcast<vec3i>(words) >> vec3u(16u));
  }
  return sum;
}
