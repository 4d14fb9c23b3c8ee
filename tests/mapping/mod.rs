//! What a map promises, held against scenes whose distance is known in closed form. Sequences are
//! short and images small; every bound is about 1.5 times what was measured.

mod bounds; // the root grows, the cost of a frame does not, memory has a limit
mod colors; // what was seen of colours is said, and survives a file
mod edits; // what is cleared is unknown, what is stamped is there
mod fields; // distance, sign, gradient and state against the truth
mod fixed; // the same input gives the same file: threads, interruption
mod gpu; // the GPU backend makes the map that the CPU backend makes
mod grids; // regular points, as any others
mod images; // drawn by tiles and by rays, against what a camera sees
mod language; // features become codes that texts find
mod meshes; // a wall that was seen everywhere has a surface everywhere
mod mirror; // a copy of a view that follows it
mod moved; // what is gone is gone
mod variants; // learned prior, fewer modalities

use glam::Vec3;

use orenx::config::{MapConfig, MapSettings};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::map::{Fields, MapView, Mapper, State};

/// The settings of a `lite` map with these steps a frame.
pub(crate) fn lite(steps: u32) -> MapConfig {
    let settings = MapSettings { steps: Some(steps), ..MapSettings::default() };
    MapConfig::from_settings(&settings).unwrap()
}

/// Takes frames of a sequence into a map, colours too.
pub(crate) fn integrate(
    mapper: &mut Mapper,
    data: &Synthetic,
    frames: impl IntoIterator<Item = usize>,
) {
    for index in frames {
        mapper.integrate(&data.load(index, true).unwrap()).unwrap();
    }
}

/// The state of one point.
pub(crate) fn state(view: &MapView, point: Vec3) -> State {
    match view.query(&[point], Fields::ALL).state[0] {
        1 => State::Free,
        2 => State::Occupied,
        _ => State::Unknown,
    }
}
