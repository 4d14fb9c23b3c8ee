//! What belongs to a wall, a kitchen or a bathroom, each from a few solids. The spot is on the wall's
//! face; things extend forward. Sizes are width, depth and height, m.

use super::super::scene::SceneBuilder;
use super::super::texture::Texture;
use super::{DARK, METAL, SUNK_M, Spot, WHITE};

/// A door that stands open at a right angle; the spot is the opening's middle, in a wall.
pub(super) fn open_door(house: &mut SceneBuilder, spot: Spot) {
    let yaw = spot.yaw_rad();
    house
        .object("door", "door", [0.55, 0.4, 0.26], Texture::Planks { width: 0.2 })
        .block(spot.at(0.0, 0.48, 1.02), [0.08, 0.17, 2.14], yaw)
        .block(spot.at(0.0, -0.48, 1.02), [0.08, 0.17, 2.14], yaw)
        .block(spot.at(0.0, 0.0, 2.08), [1.06, 0.17, 0.1], yaw)
        .block(spot.at(0.49, 0.47, 1.01), [0.04, 0.86, 1.98], yaw)
        .rod(spot.at(0.84, 0.38, 1.0), spot.at(0.84, 0.56, 1.0), 0.015);
}

pub(super) fn closed_door(house: &mut SceneBuilder, spot: Spot) {
    let yaw = spot.yaw_rad();
    house
        .object("house door", "door", [0.5, 0.33, 0.2], Texture::Planks { width: 0.18 })
        .block(spot.at(0.0, 0.0, 1.0), [0.95, 0.1, 2.1], yaw)
        .block(spot.at(0.03, 0.52, 1.03), [0.09, 0.1, 2.18], yaw)
        .block(spot.at(0.03, -0.52, 1.03), [0.09, 0.1, 2.18], yaw)
        .block(spot.at(0.03, 0.0, 2.09), [1.13, 0.1, 0.09], yaw)
        .rod(spot.at(0.04, 0.36, 1.0), spot.at(0.12, 0.36, 1.0), 0.014)
        .rod(spot.at(0.11, 0.38, 1.0), spot.at(0.11, 0.24, 1.0), 0.014);
}

/// Panes with a cross and a sill, `[width, height]` around the height `z_m`.
pub(super) fn window(house: &mut SceneBuilder, spot: Spot, [width, height]: [f32; 2], z_m: f32) {
    let yaw = spot.yaw_rad();
    house
        .object("panes", "window", [0.55, 0.75, 0.95], Texture::Plain)
        .block(spot.at(0.0, 0.0, z_m), [width, 0.04, height], yaw)
        .object("window frame", "window", WHITE, Texture::Plain)
        .block(spot.at(0.0, 0.0, z_m), [0.05, 0.09, height], yaw)
        .block(spot.at(0.0, 0.0, z_m), [width, 0.09, 0.05], yaw)
        .block(spot.at(0.0, 0.0, z_m + height * 0.5), [width + 0.1, 0.1, 0.07], yaw)
        .block(spot.at(0.05, 0.0, z_m - height * 0.5), [width + 0.16, 0.2, 0.05], yaw);
    for side in [-0.5, 0.5] {
        house.block(spot.at(0.0, side * width, z_m), [0.07, 0.1, height], yaw);
    }
}

/// Folds on both sides of a window `width_m` wide, and their rod.
pub(super) fn curtains(house: &mut SceneBuilder, spot: Spot, width_m: f32, color: [f32; 3]) {
    let end = width_m * 0.5 + 0.4;
    house.object("curtains", "curtain", color, Texture::Plain);
    for fold in 0..5 {
        for side in [-1.0, 1.0] {
            let left = side * (width_m * 0.5 - 0.08 + 0.085 * fold as f32);
            house.capsule(spot.at(0.16, left, 1.0), spot.at(0.16, left, 2.28), 0.055);
        }
    }
    house.rod(spot.at(0.16, -end, 2.35), spot.at(0.16, end, 2.35), 0.02);
}

pub(super) fn picture(house: &mut SceneBuilder, spot: Spot, [width, height]: [f32; 2], z_m: f32) {
    let yaw = spot.yaw_rad();
    house
        .object("picture frame", "picture", DARK, Texture::Plain)
        .block(spot.at(0.0, 0.0, z_m), [width, 0.08, height], yaw)
        .object("canvas", "picture", [0.85, 0.5, 0.25], Texture::Speckles { size: 0.09 })
        .block(spot.at(0.0, 0.0, z_m), [width - 0.1, 0.1, height - 0.1], yaw);
}

pub(super) fn mirror(house: &mut SceneBuilder, spot: Spot, [width, height]: [f32; 2], z_m: f32) {
    let yaw = spot.yaw_rad();
    house
        .object("mirror", "mirror", [0.6, 0.72, 0.78], Texture::Plain)
        .block(spot.at(0.0, 0.0, z_m), [width, 0.08, height], yaw)
        .object("mirror frame", "mirror", METAL, Texture::Plain)
        .block(spot.at(0.0, 0.0, z_m + height * 0.5), [width + 0.06, 0.1, 0.05], yaw)
        .block(spot.at(0.0, 0.0, z_m - height * 0.5), [width + 0.06, 0.1, 0.05], yaw);
}

/// A round face at the height `z_m`, ten past ten.
pub(super) fn clock(house: &mut SceneBuilder, spot: Spot, z_m: f32) {
    let hand = |left: f32, up: f32| spot.at(0.07, left, z_m + up);
    house
        .object("clock rim", "clock", [0.6, 0.1, 0.08], Texture::Plain)
        .rod(spot.at(-SUNK_M, 0.0, z_m), spot.at(0.05, 0.0, z_m), 0.22)
        .object("clock face", "clock", WHITE, Texture::Plain)
        .rod(spot.at(-SUNK_M, 0.0, z_m), spot.at(0.065, 0.0, z_m), 0.19)
        .object("clock hands", "clock", DARK, Texture::Plain)
        .capsule(hand(0.0, 0.0), hand(0.09, 0.05), 0.012)
        .capsule(hand(0.0, 0.0), hand(-0.12, 0.07), 0.012);
}

/// Another floor than the house's own, around `centre`.
pub(super) fn tiles(house: &mut SceneBuilder, centre: [f32; 2], [x, y]: [f32; 2], color: [f32; 3]) {
    house.object("tiles", "floor", color, Texture::Checker { size: 0.3 }).block(
        [centre[0], centre[1], -0.04],
        [x, y, 0.1],
        0.0,
    );
}

/// A refrigerator with its freezer below.
pub(super) fn refrigerator(house: &mut SceneBuilder, spot: Spot) {
    let yaw = spot.yaw_rad();
    house
        .object("refrigerator", "refrigerator", [0.78, 0.82, 0.86], Texture::Plain)
        .block(spot.at(0.32, 0.0, 0.9), [0.72, 0.62, 1.86], yaw)
        .block(spot.at(0.65, 0.0, 1.22), [0.72, 0.06, 1.22], yaw)
        .block(spot.at(0.65, 0.0, 0.32), [0.72, 0.06, 0.54], yaw)
        .object("refrigerator handles", "refrigerator", METAL, Texture::Plain)
        .capsule(spot.at(0.72, 0.28, 0.8), spot.at(0.72, 0.28, 1.4), 0.018)
        .capsule(spot.at(0.72, 0.28, 0.3), spot.at(0.72, 0.28, 0.54), 0.018);
}

/// A stove with four plates, an oven and knobs.
pub(super) fn stove(house: &mut SceneBuilder, spot: Spot) {
    let yaw = spot.yaw_rad();
    house
        .object("stove", "stove", METAL, Texture::Plain)
        .block(spot.at(0.3, 0.0, 0.45), [0.58, 0.62, 0.94], yaw)
        .capsule(spot.at(0.65, 0.22, 0.72), spot.at(0.65, -0.22, 0.72), 0.015)
        .object("plates and oven window", "stove", DARK, Texture::Plain)
        .block(spot.at(0.6, 0.0, 0.45), [0.44, 0.04, 0.36], yaw);
    for (forward, left) in [(0.18, 0.14), (0.18, -0.14), (0.44, 0.14), (0.44, -0.14)] {
        house.cylinder(spot.at(forward, left, 0.9), 0.1, 0.035);
    }
    for knob in 0..4 {
        let left = 0.21 - 0.14 * knob as f32;
        house.rod(spot.at(0.58, left, 0.83), spot.at(0.64, left, 0.83), 0.022);
    }
}

/// A hollow basin on the height `z_m`, with its tap.
pub(super) fn basin(house: &mut SceneBuilder, spot: Spot, size: [f32; 3], z_m: f32) {
    house.object("sink", "sink", [0.8, 0.83, 0.85], Texture::Plain);
    hollow(house, spot, size, z_m);
    let top = z_m + size[2];
    house
        .object("tap", "sink", METAL, Texture::Plain)
        .rod(spot.at(0.05, 0.0, top - 0.04), spot.at(0.05, 0.0, top + 0.16), 0.018)
        .rod(spot.at(0.05, 0.0, top + 0.15), spot.at(0.2, 0.0, top + 0.13), 0.015);
}

/// A bathtub along a wall.
pub(super) fn bathtub(house: &mut SceneBuilder, spot: Spot) {
    house.object("bathtub", "bathtub", WHITE, Texture::Plain);
    hollow(house, spot, [1.8, 0.8, 0.56], 0.0);
    house.object("bathtub tap", "bathtub", METAL, Texture::Plain).rod(
        spot.at(0.02, 0.0, 0.72),
        spot.at(0.18, 0.0, 0.7),
        0.025,
    );
}

/// A box open above, with a floor and walls 6 cm thick.
fn hollow(house: &mut SceneBuilder, spot: Spot, [width, depth, height]: [f32; 3], z_m: f32) {
    let (yaw, wall, middle) = (spot.yaw_rad(), 0.06, z_m + height * 0.5);
    house.block(spot.at(depth * 0.5, 0.0, z_m + 0.01), [width, depth, 0.1], yaw);
    for side in [-1.0, 1.0] {
        let left = side * (width - wall) * 0.5;
        house.block(spot.at(depth * 0.5, left, middle), [wall, depth, height], yaw);
        let forward = depth * 0.5 + side * (depth - wall) * 0.5;
        house.block(spot.at(forward, 0.0, middle), [width, wall, height], yaw);
    }
}

pub(super) fn toilet(house: &mut SceneBuilder, spot: Spot) {
    let yaw = spot.yaw_rad();
    house
        .object("toilet", "toilet", WHITE, Texture::Plain)
        .block(spot.at(0.09, 0.0, 0.6), [0.42, 0.2, 0.44], yaw)
        .block(spot.at(0.25, 0.0, 0.17), [0.22, 0.5, 0.4], yaw)
        .cylinder(spot.at(0.45, 0.0, -SUNK_M), 0.13, 0.3)
        .cylinder(spot.at(0.42, 0.0, 0.2), 0.2, 0.19)
        .object("toilet seat", "toilet", [0.7, 0.7, 0.66], Texture::Plain)
        .cylinder(spot.at(0.42, 0.0, 0.38), 0.215, 0.03)
        .leaning_block(spot.at(0.24, 0.0, 0.6), [0.38, 0.03, 0.4], yaw, 0.12);
}

/// A towel over its rail.
pub(super) fn towel(house: &mut SceneBuilder, spot: Spot, color: [f32; 3]) {
    house
        .object("towel", "towel", color, Texture::Stripes { size: 0.15 })
        .block(spot.at(0.08, 0.0, 1.1), [0.55, 0.06, 0.8], spot.yaw_rad())
        .rod(spot.at(0.08, 0.34, 1.48), spot.at(0.08, -0.34, 1.48), 0.025);
}
