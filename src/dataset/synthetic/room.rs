//! A furnished room of 6 × 4.5 × 2.7 m around the origin, floor at z = 0, and a walk through it.

use std::f32::consts::{FRAC_PI_2, PI};
use std::f64::consts::TAU;

use glam::{DVec3, Vec3};

use super::scene::{Scene, SceneBuilder};
use super::texture::Texture;
use crate::geometry::random::{pcg4d, unit};
use crate::geometry::{Aabb, Pose};

const WOOD: [f32; 3] = [0.42, 0.26, 0.13];
const DARK: [f32; 3] = [0.08, 0.08, 0.09];
const METAL: [f32; 3] = [0.5, 0.52, 0.55];
const WHITE: [f32; 3] = [0.85, 0.85, 0.83];

/// The inner faces of the shell.
pub const ROOM: Aabb = Aabb { min: Vec3::new(-3.0, -2.25, 0.0), max: Vec3::new(3.0, 2.25, 2.7) };

/// The room with everything in it.
pub fn scene() -> Scene {
    let mut room = SceneBuilder::new(ROOM);
    sitting_corner(&mut room);
    sofa(&mut room);
    bed(&mut room);
    desk(&mut room);
    desk_things(&mut room);
    shelf(&mut room);
    corners(&mut room);
    wall_things(&mut room);
    room.build()
}

/// The camera at a share of the walk, 0 to 1: two laps around the coffee table, first looking
/// outward, then inward, and back to where it began.
pub fn walk(share: f64) -> Pose {
    let lap = TAU * 2.0 * share;
    let eye =
        DVec3::new(1.15 * lap.cos(), 0.75 * lap.sin(), 1.35 + 0.2 * (TAU * 3.0 * share).sin());
    // Half a turn over the first half of the walk, and back over the second.
    let turn = TAU / 4.0 * (1.0 - (TAU * share).cos());
    let yaw = lap + turn + 0.35 * (TAU * 5.0 * share).sin();
    let pitch = -0.3 + 0.45 * (TAU * 7.0 * share).sin();
    let gaze = DVec3::new(yaw.cos() * pitch.cos(), yaw.sin() * pitch.cos(), pitch.sin());
    Pose::looking_at(eye, eye + gaze, DVec3::Z)
}

fn sitting_corner(room: &mut SceneBuilder) {
    room.object("rug", "rug", [0.5, 0.12, 0.1], Texture::Checker { size: 0.2 })
        .block([0.0, 0.0, 0.005], [2.1, 1.4, 0.03], 0.0)
        .object("coffee table", "table", WOOD, Texture::Planks { width: 0.09 })
        .block([0.0, 0.0, 0.42], [1.0, 0.55, 0.04], 0.0);
    for (x, y) in [(-0.44, -0.21), (0.44, -0.21), (-0.44, 0.21), (0.44, 0.21)] {
        room.cylinder([x, y, -0.1], 0.03, 0.51);
    }
    room.object("magazine", "book", [0.1, 0.3, 0.55], Texture::Stripes { size: 0.05 })
        .block([-0.2, 0.05, 0.448], [0.22, 0.3, 0.02], 0.4)
        .object("mug", "cup", [0.8, 0.25, 0.1], Texture::Plain)
        .cylinder([0.15, -0.1, 0.435], 0.042, 0.1)
        .object("orange", "fruit", [0.95, 0.42, 0.05], Texture::Plain)
        .sphere([0.33, 0.12, 0.479], 0.04);
}

fn sofa(room: &mut SceneBuilder) {
    let green = [0.12, 0.3, 0.24];
    room.object("sofa", "couch", green, Texture::Speckles { size: 0.03 })
        .block([-0.4, -1.82, 0.2], [1.9, 0.82, 0.44], 0.0)
        .block([-0.4, -2.13, 0.4], [1.9, 0.3, 0.86], 0.0)
        .block([-1.4, -1.82, 0.28], [0.18, 0.84, 0.64], 0.0)
        .block([0.6, -1.82, 0.28], [0.18, 0.84, 0.64], 0.0)
        .object("left seat cushion", "cushion", [0.16, 0.36, 0.28], Texture::Plain)
        .block([-0.86, -1.7, 0.47], [0.88, 0.56, 0.12], 0.0)
        .object("right seat cushion", "cushion", [0.16, 0.36, 0.28], Texture::Plain)
        .block([0.06, -1.7, 0.47], [0.88, 0.56, 0.12], 0.0)
        .object("striped cushion", "cushion", [0.8, 0.62, 0.2], Texture::Stripes { size: 0.06 })
        .leaning_block([-1.05, -1.84, 0.72], [0.42, 0.12, 0.4], 0.15, 0.3)
        .object("bolster", "cushion", [0.65, 0.2, 0.2], Texture::Plain)
        .capsule([0.15, -1.82, 0.62], [0.36, -1.78, 0.62], 0.1);
}

fn bed(room: &mut SceneBuilder) {
    room.object("bed", "bed", WOOD, Texture::Planks { width: 0.12 })
        .block([2.0, 1.5, 0.12], [1.96, 1.44, 0.36], 0.0)
        .block([2.95, 1.5, 0.42], [0.1, 1.5, 0.96], 0.0)
        .object("mattress", "mattress", WHITE, Texture::Plain)
        .block([1.97, 1.5, 0.38], [1.84, 1.36, 0.2], 0.0)
        .object("blanket", "blanket", [0.2, 0.28, 0.5], Texture::Stripes { size: 0.12 })
        .block([1.62, 1.5, 0.42], [1.2, 1.4, 0.17], 0.0)
        .object("left pillow", "pillow", WHITE, Texture::Speckles { size: 0.08 })
        .leaning_block([2.62, 1.17, 0.55], [0.36, 0.52, 0.12], 0.05, 0.06)
        .object("right pillow", "pillow", WHITE, Texture::Speckles { size: 0.08 })
        .leaning_block([2.62, 1.84, 0.55], [0.36, 0.52, 0.12], -0.08, -0.05);
}

fn desk(room: &mut SceneBuilder) {
    room.object("desk", "desk", WOOD, Texture::Planks { width: 0.1 }).block(
        [-2.62, -0.1, 0.73],
        [0.72, 1.5, 0.04],
        0.0,
    );
    for (x, y) in [(-2.94, -0.8), (-2.3, -0.8), (-2.94, 0.6), (-2.3, 0.6)] {
        room.block([x, y, 0.3], [0.05, 0.05, 0.84], 0.0);
    }
    // A swivel chair, turned a little: seat, back, post and a foot of five rods.
    room.object("desk chair", "chair", DARK, Texture::Speckles { size: 0.04 })
        .block([-1.95, -0.1, 0.47], [0.46, 0.48, 0.08], 0.3)
        .leaning_block([-1.73, -0.03, 0.84], [0.44, 0.06, 0.56], 0.3 - FRAC_PI_2, -0.12)
        .rod([-1.76, -0.04, 0.45], [-1.71, -0.02, 0.7], 0.025)
        .cylinder([-1.95, -0.1, 0.07], 0.035, 0.38);
    for i in 0..5 {
        let angle = 0.3 + PI * 0.4 * i as f32;
        let foot = [-1.95 + 0.27 * angle.cos(), -0.1 + 0.27 * angle.sin(), 0.045];
        room.rod([-1.95, -0.1, 0.1], foot, 0.02).sphere(foot, 0.035);
    }
}

fn desk_things(room: &mut SceneBuilder) {
    room.object("monitor", "monitor", DARK, Texture::Plain)
        .block([-2.78, -0.15, 1.09], [0.04, 0.6, 0.36], 0.0)
        .block([-2.82, -0.15, 0.9], [0.03, 0.06, 0.3], 0.0)
        .block([-2.8, -0.15, 0.753], [0.18, 0.26, 0.015], 0.0)
        .object("keyboard", "keyboard", [0.2, 0.2, 0.22], Texture::Checker { size: 0.02 })
        .block([-2.48, -0.15, 0.758], [0.15, 0.44, 0.025], 0.0)
        .object("desk lamp", "lamp", [0.75, 0.15, 0.1], Texture::Plain)
        .cylinder([-2.75, 0.42, 0.745], 0.08, 0.025)
        .rod([-2.75, 0.42, 0.76], [-2.68, 0.36, 1.1], 0.012)
        .rod([-2.68, 0.36, 1.1], [-2.5, 0.28, 1.22], 0.012)
        .capsule([-2.52, 0.29, 1.21], [-2.44, 0.26, 1.17], 0.05)
        .object("pen pot", "cup", METAL, Texture::Plain)
        .cylinder([-2.45, -0.62, 0.745], 0.04, 0.11)
        .object("notebook", "book", [0.15, 0.45, 0.3], Texture::Plain)
        .block([-2.55, -0.5, 0.757], [0.15, 0.21, 0.02], -0.5);
}

/// A shelf of four boards at the wall y = 2.25, with a row of books on each and things between.
fn shelf(room: &mut SceneBuilder) {
    const BOARDS_M: [f32; 4] = [0.12, 0.6, 1.08, 1.56];
    room.object("shelf", "shelf", WHITE, Texture::Plain)
        .block([-2.2, 2.1, 0.9], [0.03, 0.32, 2.0], 0.0)
        .block([-0.6, 2.1, 0.9], [0.03, 0.32, 2.0], 0.0)
        .block([-1.4, 2.245, 0.9], [1.63, 0.03, 2.0], 0.0)
        .block([-1.4, 2.1, 1.905], [1.63, 0.32, 0.03], 0.0);
    for z in BOARDS_M {
        room.block([-1.4, 2.1, z - 0.015], [1.6, 0.32, 0.03], 0.0);
    }
    for (row, z) in BOARDS_M.into_iter().enumerate() {
        let mut x = if row % 2 == 0 { -2.15 } else { -1.5 };
        for i in 0..9 {
            let random = pcg4d([row as u32, i, 5, 0]).map(unit);
            let (width, height) = (0.025 + 0.035 * random[0], 0.2 + 0.12 * random[1]);
            let depth = 0.14 + 0.06 * random[2];
            let hue = [0.15 + 0.6 * random[3], 0.15 + 0.5 * random[0], 0.15 + 0.5 * random[1]];
            room.object(format!("book {}", row * 9 + i as usize), "book", hue, Texture::Plain)
                .block([x + width * 0.5, 2.12, z + height * 0.5], [width, depth, height], 0.0);
            x += width + 0.004;
        }
    }
    room.object("vase", "vase", [0.1, 0.35, 0.6], Texture::Stripes { size: 0.04 })
        .sphere([-1.0, 2.1, 0.23], 0.11)
        .cylinder([-1.0, 2.1, 0.3], 0.045, 0.13)
        .object("globe", "globe", [0.2, 0.45, 0.75], Texture::Checker { size: 0.06 })
        .cylinder([-1.85, 2.1, 0.6], 0.06, 0.02)
        .sphere([-1.85, 2.1, 0.73], 0.12)
        .object("box", "box", [0.6, 0.45, 0.25], Texture::Plain)
        .block([-1.1, 2.1, 1.17], [0.34, 0.24, 0.18], 0.1)
        .object("speaker", "speaker", DARK, Texture::Plain)
        .block([-1.95, 2.1, 1.72], [0.18, 0.2, 0.32], 0.0);
}

/// What stands in the corners: wardrobe, plant, floor lamp, bin, toy ball.
fn corners(room: &mut SceneBuilder) {
    room.object("wardrobe", "wardrobe", [0.7, 0.62, 0.5], Texture::Planks { width: 0.3 })
        .block([2.68, -1.3, 1.0], [0.66, 1.3, 2.1], 0.0)
        .sphere([2.33, -1.36, 1.05], 0.025)
        .sphere([2.33, -1.24, 1.05], 0.025)
        .object("plant", "plant", [0.1, 0.4, 0.12], Texture::Speckles { size: 0.04 })
        .rod([-2.6, -1.85, 0.3], [-2.55, -1.8, 0.95], 0.02);
    for (dx, dy, z, radius) in [
        (0.0, 0.0, 1.15, 0.22),
        (0.16, 0.08, 0.95, 0.15),
        (-0.14, 0.1, 1.0, 0.14),
        (0.04, 0.2, 1.3, 0.13),
        (-0.05, -0.12, 0.85, 0.12),
    ] {
        room.sphere([-2.55 + dx, -1.8 + dy, z], radius);
    }
    room.object("plant pot", "pot", [0.6, 0.28, 0.16], Texture::Plain)
        .cylinder([-2.6, -1.85, -0.05], 0.18, 0.37)
        .object("floor lamp", "lamp", [0.9, 0.82, 0.6], Texture::Plain)
        .cylinder([1.1, -1.95, -0.02], 0.14, 0.05)
        .cylinder([1.1, -1.95, 0.0], 0.015, 1.5)
        .cylinder([1.1, -1.95, 1.4], 0.2, 0.28)
        .object("bin", "bin", METAL, Texture::Plain)
        .cylinder([-2.75, 0.95, -0.05], 0.14, 0.37)
        .object("ball", "ball", [0.85, 0.1, 0.3], Texture::Checker { size: 0.1 })
        .sphere([1.75, -0.35, 0.13], 0.13);
}

fn wall_things(room: &mut SceneBuilder) {
    room.object("picture", "picture", [0.75, 0.55, 0.3], Texture::Speckles { size: 0.07 })
        .block([-0.4, -2.24, 1.6], [0.9, 0.04, 0.6], 0.0)
        .object("door", "door", [0.55, 0.4, 0.26], Texture::Planks { width: 0.2 })
        .block([0.2, 2.25, 0.95], [0.9, 0.08, 2.1], 0.0)
        .rod([-0.14, 2.15, 1.0], [-0.14, 2.22, 1.0], 0.012)
        .rod([-0.15, 2.15, 1.0], [-0.03, 2.15, 1.0], 0.012)
        .object("window", "window", [0.65, 0.8, 0.9], Texture::Plain)
        .block([-2.99, -0.1, 1.85], [0.05, 1.3, 0.9], 0.0)
        .block([-2.95, -0.1, 1.85], [0.05, 0.04, 0.9], 0.0)
        .block([-2.95, -0.1, 1.85], [0.05, 1.3, 0.04], 0.0)
        .object("radiator", "radiator", WHITE, Texture::Plain);
    for i in 0..7 {
        room.capsule(
            [2.93, -0.35 + 0.11 * i as f32, 0.15],
            [2.93, -0.35 + 0.11 * i as f32, 0.65],
            0.035,
        );
    }
    room.object("ceiling lamp", "lamp", [0.95, 0.93, 0.85], Texture::Plain)
        .cylinder([0.0, 0.0, 2.35], 0.01, 0.4)
        .sphere([0.0, 0.0, 2.3], 0.16);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_walk_keeps_clear_of_things_and_closes() {
        let scene = scene();
        for i in 0..600 {
            let eye = walk(f64::from(i) / 600.0).position_f32();
            assert!(scene.distance(eye) > 0.25, "{} m at {eye}", scene.distance(eye));
        }
        let (start, end) = (walk(0.0), walk(1.0));
        assert!((start.translation - end.translation).length() < 1e-9);
        assert!(start.rotation.dot(end.rotation).abs() > 1.0 - 1e-9);
    }
}
