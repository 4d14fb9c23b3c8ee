//! Furniture and lamps, each from a few solids, for any spot. What stands against a wall has its spot on
//! the wall's face, and extends forward. Sizes are width, depth and height, m.

use super::super::scene::SceneBuilder;
use super::super::texture::Texture;
use super::{DARK, METAL, SUNK_M, Spot, WHITE, WOOD};
use crate::geometry::random::{pcg4d, unit};

/// A couch for three with its pillows.
pub(super) fn couch(house: &mut SceneBuilder, spot: Spot) {
    let yaw = spot.yaw_rad();
    house
        .object("couch", "couch", [0.12, 0.3, 0.24], Texture::Speckles { size: 0.03 })
        .block(spot.at(0.43, 0.0, 0.19), [2.0, 0.86, 0.42], yaw)
        .block(spot.at(0.12, 0.0, 0.4), [2.0, 0.24, 0.86], yaw)
        .block(spot.at(0.43, 1.03, 0.28), [0.18, 0.88, 0.64], yaw)
        .block(spot.at(0.43, -1.03, 0.28), [0.18, 0.88, 0.64], yaw)
        .object("seats", "couch", [0.16, 0.36, 0.28], Texture::Plain)
        .block(spot.at(0.55, 0.47, 0.45), [0.92, 0.66, 0.14], yaw)
        .block(spot.at(0.55, -0.47, 0.45), [0.92, 0.66, 0.14], yaw)
        .object("yellow pillow", "pillow", [0.85, 0.65, 0.15], Texture::Stripes { size: 0.06 })
        .leaning_block(spot.at(0.36, 0.62, 0.72), [0.46, 0.15, 0.44], yaw + 0.1, 0.25)
        .object("red pillow", "pillow", [0.65, 0.16, 0.16], Texture::Plain)
        .leaning_block(spot.at(0.36, -0.02, 0.71), [0.44, 0.15, 0.42], yaw - 0.15, 0.28);
}

/// A blanket over one end of a couch, down to near the floor.
pub(super) fn throw(house: &mut SceneBuilder, couch: Spot) {
    let yaw = couch.yaw_rad();
    house
        .object("throw", "blanket", [0.55, 0.25, 0.4], Texture::Stripes { size: 0.1 })
        .block(couch.at(0.58, -0.62, 0.53), [0.62, 0.68, 0.06], yaw)
        .block(couch.at(0.9, -0.62, 0.33), [0.62, 0.06, 0.44], yaw);
}

pub(super) fn bed(house: &mut SceneBuilder, head: Spot) {
    let yaw = head.yaw_rad();
    house
        .object("bed", "bed", WOOD, Texture::Planks { width: 0.12 })
        .block(head.at(1.06, 0.0, 0.14), [1.66, 2.1, 0.38], yaw)
        .block(head.at(0.05, 0.0, 0.5), [1.72, 0.12, 1.1], yaw)
        .object("mattress", "bed", WHITE, Texture::Plain)
        .block(head.at(1.06, 0.0, 0.42), [1.58, 1.94, 0.22], yaw)
        .object("quilt", "blanket", [0.2, 0.28, 0.5], Texture::Stripes { size: 0.12 })
        .block(head.at(1.45, 0.0, 0.44), [1.7, 1.34, 0.26], yaw);
    for (left, turn) in [(0.39, 0.06), (-0.39, -0.08)] {
        house
            .object("bed pillow", "pillow", [0.9, 0.88, 0.8], Texture::Speckles { size: 0.08 })
            .leaning_block(head.at(0.36, left, 0.61), [0.6, 0.4, 0.16], yaw + turn, -0.15);
    }
}

/// A four-legged table around its spot.
pub(super) fn table(house: &mut SceneBuilder, spot: Spot, [width, depth, height]: [f32; 3]) {
    let yaw = spot.yaw_rad();
    house.object("table", "table", WOOD, Texture::Planks { width: 0.1 }).block(
        spot.at(0.0, 0.0, height - 0.02),
        [width, depth, 0.04],
        yaw,
    );
    let (forward, left) = (depth * 0.5 - 0.06, width * 0.5 - 0.06);
    for (f, l) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
        let leg = spot.at(f * forward, l * left, -SUNK_M);
        house.cylinder(leg, 0.035, height - 0.02 + SUNK_M);
    }
}

/// A chair whose seat is at its spot.
pub(super) fn chair(house: &mut SceneBuilder, spot: Spot, color: [f32; 3]) {
    let yaw = spot.yaw_rad();
    house
        .object("chair", "chair", color, Texture::Planks { width: 0.08 })
        .block(spot.at(0.0, 0.0, 0.45), [0.44, 0.44, 0.05], yaw)
        .leaning_block(spot.at(-0.24, 0.0, 0.76), [0.42, 0.05, 0.32], yaw, 0.12);
    for left in [0.18, -0.18] {
        house
            .rod(spot.at(-0.19, left, -SUNK_M), spot.at(-0.19, left, 0.45), 0.024)
            .rod(spot.at(-0.19, left, 0.45), spot.at(-0.24, left, 0.78), 0.022)
            .rod(spot.at(0.19, left, -SUNK_M), spot.at(0.19, left, 0.45), 0.024);
    }
}

pub(super) fn rug(house: &mut SceneBuilder, spot: Spot, [width, depth]: [f32; 2], color: [f32; 3]) {
    house.object("rug", "rug", color, Texture::Checker { size: 0.2 }).block(
        spot.at(0.0, 0.0, 0.0),
        [width, depth, 0.05],
        spot.yaw_rad(),
    );
}

/// A cabinet with two doors and their knobs.
pub(super) fn cabinet(house: &mut SceneBuilder, spot: Spot, size: [f32; 3], color: [f32; 3]) {
    let [width, depth, height] = size;
    let yaw = spot.yaw_rad();
    house.object("cabinet", "cabinet", color, Texture::Plain).block(
        spot.at(depth * 0.5 - 0.02, 0.0, height * 0.5 - 0.03),
        [width, depth, height + 0.02],
        yaw,
    );
    doors(house, spot, size, height * 0.5);
    house
        .object("cabinet top", "cabinet", color.map(|c| c * 0.6), Texture::Speckles { size: 0.02 })
        .block(spot.at(depth * 0.5, 0.0, height - 0.02), [width + 0.02, depth + 0.02, 0.04], yaw);
}

/// The same above eye height, on the wall.
pub(super) fn hanging_cabinet(
    house: &mut SceneBuilder,
    spot: Spot,
    size: [f32; 3],
    color: [f32; 3],
) {
    let [width, depth, height] = size;
    house.object("hanging cabinet", "cabinet", color, Texture::Plain).block(
        spot.at(depth * 0.5 - 0.02, 0.0, 1.85),
        [width, depth, height],
        spot.yaw_rad(),
    );
    doors(house, spot, size, 1.85);
}

fn doors(house: &mut SceneBuilder, spot: Spot, [width, depth, height]: [f32; 3], z_m: f32) {
    for side in [-1.0, 1.0] {
        house
            .block(
                spot.at(depth - 0.02, side * width * 0.25, z_m),
                [width * 0.5 - 0.03, 0.03, height - 0.12],
                spot.yaw_rad(),
            )
            .sphere(spot.at(depth + 0.01, side * 0.06, z_m), 0.02);
    }
}

pub(super) fn television(house: &mut SceneBuilder, spot: Spot, z_m: f32) {
    let yaw = spot.yaw_rad();
    house
        .object("television", "television", DARK, Texture::Plain)
        .block(spot.at(0.2, 0.0, z_m + 0.46), [1.25, 0.05, 0.74], yaw)
        .block(spot.at(0.19, 0.0, z_m + 0.06), [0.1, 0.04, 0.16], yaw)
        .block(spot.at(0.2, 0.0, z_m + 0.005), [0.5, 0.24, 0.03], yaw)
        .object("screen", "television", [0.05, 0.09, 0.16], Texture::Plain)
        .block(spot.at(0.21, 0.0, z_m + 0.47), [1.19, 0.045, 0.67], yaw);
}

pub(super) fn floor_lamp(house: &mut SceneBuilder, spot: Spot) {
    house
        .object("lamp foot", "lamp", DARK, Texture::Plain)
        .cylinder(spot.at(0.0, 0.0, -SUNK_M), 0.14, 0.08)
        .cylinder(spot.at(0.0, 0.0, 0.0), 0.018, 1.5)
        .object("lamp shade", "lamp", [0.9, 0.8, 0.5], Texture::Plain)
        .cylinder(spot.at(0.0, 0.0, 1.4), 0.18, 0.3);
}

pub(super) fn table_lamp(house: &mut SceneBuilder, [x, y, z]: [f32; 3]) {
    house
        .object("lamp foot", "lamp", METAL, Texture::Plain)
        .cylinder([x, y, z - 0.02], 0.07, 0.04)
        .cylinder([x, y, z], 0.02, 0.25)
        .object("lamp shade", "lamp", [0.9, 0.8, 0.5], Texture::Plain)
        .cylinder([x, y, z + 0.2], 0.13, 0.2);
}

pub(super) fn hanging_lamp(house: &mut SceneBuilder, [x, y]: [f32; 2]) {
    house
        .object("lamp cord", "lamp", DARK, Texture::Plain)
        .cylinder([x, y, 2.0], 0.015, 0.7)
        .object("lamp shade", "lamp", [0.85, 0.3, 0.1], Texture::Plain)
        .cylinder([x, y, 1.9], 0.24, 0.18);
}

/// A plant in its pot, with a height of about 1.4 times `scale`.
pub(super) fn plant(house: &mut SceneBuilder, spot: Spot, scale: f32) {
    let at = |x: f32, y: f32, z: f32| [spot.x + x * scale, spot.y + y * scale, z * scale];
    house
        .object("plant pot", "plant", [0.6, 0.28, 0.16], Texture::Plain)
        .cylinder([spot.x, spot.y, -SUNK_M], 0.17 * scale, 0.35 * scale + SUNK_M)
        .object("plant", "plant", [0.1, 0.4, 0.12], Texture::Speckles { size: 0.04 })
        .rod(at(0.0, 0.0, 0.3), at(0.04, 0.04, 0.95), 0.02);
    for (x, y, z, radius) in [
        (0.0, 0.0, 1.1, 0.2),
        (0.13, 0.08, 0.92, 0.14),
        (-0.12, 0.09, 0.98, 0.13),
        (0.03, 0.1, 1.28, 0.12),
        (-0.04, -0.12, 0.82, 0.12),
    ] {
        house.sphere(at(x, y, z), radius * scale);
    }
}

/// A shelf of four boards with a row of books on each.
pub(super) fn bookshelf(house: &mut SceneBuilder, spot: Spot) {
    const BOARDS_M: [f32; 4] = [0.12, 0.56, 1.0, 1.44];
    let yaw = spot.yaw_rad();
    house
        .object("shelf", "shelf", WHITE, Texture::Plain)
        .block(spot.at(0.15, 0.65, 0.9), [0.03, 0.32, 1.98], yaw)
        .block(spot.at(0.15, -0.65, 0.9), [0.03, 0.32, 1.98], yaw)
        .block(spot.at(0.005, 0.0, 0.9), [1.33, 0.03, 1.98], yaw)
        .block(spot.at(0.15, 0.0, 1.875), [1.33, 0.32, 0.03], yaw);
    for z in BOARDS_M {
        house.block(spot.at(0.15, 0.0, z - 0.015), [1.3, 0.32, 0.03], yaw);
    }
    for (row, z) in BOARDS_M.into_iter().enumerate() {
        let mut left = if row % 2 == 0 { 0.62 } else { 0.3 };
        for i in 0..18 {
            let random = pcg4d([row as u32, i, 6, 0]).map(unit);
            let (width, height) = (0.03 + 0.03 * random[0], 0.22 + 0.12 * random[1]);
            if left - width < -0.62 {
                break;
            }
            let hue = [0.15 + 0.6 * random[3], 0.15 + 0.5 * random[0], 0.15 + 0.5 * random[1]];
            house.object(format!("book {row}.{i}"), "book", hue, Texture::Plain).block(
                spot.at(0.14, left - width * 0.5, z + height * 0.5),
                [width, 0.2 + 0.05 * random[2], height],
                yaw,
            );
            left -= width + 0.004;
        }
    }
}

/// A book that lies at the height `z_m`.
pub(super) fn book(house: &mut SceneBuilder, spot: Spot, z_m: f32, color: [f32; 3]) {
    house.object("book", "book", color, Texture::Plain).block(
        spot.at(0.0, 0.0, z_m + 0.02),
        [0.22, 0.3, 0.05],
        spot.yaw_rad(),
    );
}

pub(super) fn wardrobe(house: &mut SceneBuilder, spot: Spot) {
    let size = [1.7, 0.6, 2.1];
    house
        .object("wardrobe", "wardrobe", [0.7, 0.62, 0.5], Texture::Planks { width: 0.3 })
        .block(spot.at(0.28, 0.0, 1.03), [1.7, 0.6, 2.12], spot.yaw_rad())
        .object("wardrobe doors", "wardrobe", [0.5, 0.34, 0.2], Texture::Planks { width: 0.15 });
    doors(house, spot, size, 1.05);
}
