//! A furnished house of 9.2 × 6.2 × 2.6 m around the origin, floor at z = 0: living room with kitchen
//! in the west, bedroom in the south-east, bathroom in the north-east; and a walk through all of it.
//!
//! Its classes are words of everyday use, most of them a word that tokenizers keep whole, so that a
//! small text encoder knows them too.

mod fittings;
mod furniture;
mod rooms;

use std::f32::consts::FRAC_PI_2;

use glam::{DVec3, Vec3};

use super::scene::{Scene, SceneBuilder};
use super::texture::Texture;
use crate::geometry::{Aabb, Pose};

/// The inner faces of the outer walls, of the floor and of the ceiling.
pub const SHELL: Aabb = Aabb { min: Vec3::new(-4.6, -3.1, 0.0), max: Vec3::new(4.6, 3.1, 2.6) };

const WOOD: [f32; 3] = [0.42, 0.26, 0.13];
const DARK: [f32; 3] = [0.06, 0.06, 0.07];
const METAL: [f32; 3] = [0.5, 0.52, 0.55];
const WHITE: [f32; 3] = [0.85, 0.85, 0.83];

/// How far things reach into what they stand on, so that nothing floats.
const SUNK_M: f32 = 0.05;

/// Eyes are about as high as those of somebody who stands.
const EYE_M: f64 = 1.45;

/// The house with everything in it.
pub fn scene() -> Scene {
    let mut house = SceneBuilder::new(SHELL);
    inner_walls(&mut house);
    rooms::living_room(&mut house);
    rooms::kitchen(&mut house);
    rooms::bedroom(&mut house);
    rooms::bathroom(&mut house);
    house.build()
}

/// A place on the floor, or against a wall, and where what stands there faces.
#[derive(Debug, Clone, Copy)]
struct Spot {
    x: f32,
    y: f32,
    facing_rad: f32,
}

const EAST: f32 = 0.0;
const NORTH: f32 = FRAC_PI_2;
const WEST: f32 = 2.0 * FRAC_PI_2;
const SOUTH: f32 = 3.0 * FRAC_PI_2;

impl Spot {
    const fn new(x: f32, y: f32, facing_rad: f32) -> Self {
        Self { x, y, facing_rad }
    }

    /// The point so far forward, to the left and up.
    fn at(self, forward: f32, left: f32, z: f32) -> [f32; 3] {
        let (sin, cos) = self.facing_rad.sin_cos();
        [self.x + forward * cos - left * sin, self.y + forward * sin + left * cos, z]
    }

    /// How a block is turned that is as wide as its x is long, and as deep as its y.
    fn yaw_rad(self) -> f32 {
        self.facing_rad - FRAC_PI_2
    }
}

/// The walls between the rooms, with openings for two doors.
fn inner_walls(house: &mut SceneBuilder) {
    house
        .object("inner walls", "wall", [0.72, 0.74, 0.68], Texture::Speckles { size: 0.25 })
        .block([0.0, -2.15, 1.35], [0.12, 2.1, 2.9], 0.0)
        .block([0.0, 0.65, 1.35], [0.12, 1.7, 2.9], 0.0)
        .block([0.0, 2.8, 1.35], [0.12, 0.8, 2.9], 0.0)
        .block([0.0, -0.65, 2.4], [0.12, 1.1, 0.7], 0.0)
        .block([0.0, 1.95, 2.4], [0.12, 1.1, 0.7], 0.0)
        .block([2.4, 0.6, 1.35], [4.8, 0.12, 2.9], 0.0);
    fittings::open_door(house, Spot::new(0.0, -0.65, EAST));
    fittings::open_door(house, Spot::new(0.0, 1.95, EAST));
}

/// Where the walk passes: x and y, m; yaw and pitch, degrees. Yaw goes on counting past a full turn.
const STATIONS: [[f64; 4]; 46] = [
    // Around the coffee table.
    [-1.0, -1.6, 180.0, -15.0],
    [-1.2, -0.7, 215.0, -25.0],
    [-2.0, -0.3, 255.0, -20.0],
    [-3.0, -0.5, 300.0, -15.0],
    [-3.4, -1.2, 350.0, -15.0],
    [-3.0, -2.0, 390.0, -20.0],
    [-2.2, -2.2, 450.0, 8.0],
    [-1.6, -1.4, 510.0, 5.0],
    // Around the dining table, along the counter.
    [-1.0, -0.2, 485.0, -20.0],
    [-0.9, 0.8, 490.0, -15.0],
    [-1.0, 1.7, 515.0, -15.0],
    [-2.0, 1.5, 455.0, -10.0],
    [-2.9, 1.5, 490.0, -15.0],
    [-3.0, 1.1, 560.0, 10.0],
    [-3.6, 0.4, 640.0, -20.0],
    [-3.2, -0.1, 715.0, -25.0],
    [-2.3, -0.3, 770.0, -25.0],
    [-1.2, -0.6, 725.0, -10.0],
    // The bedroom.
    [-0.4, -0.65, 720.0, -10.0],
    [0.5, -0.7, 705.0, -15.0],
    [1.3, -0.9, 690.0, -20.0],
    [2.0, -1.2, 660.0, -10.0],
    [2.2, -1.8, 625.0, -10.0],
    [2.3, -1.5, 570.0, -5.0],
    [2.1, -1.2, 510.0, 5.0],
    [1.9, -1.1, 450.0, -20.0],
    [1.6, -1.2, 395.0, -15.0],
    [1.3, -1.3, 345.0, -20.0],
    [1.0, -0.9, 270.0, -15.0],
    [0.6, -0.65, 190.0, -5.0],
    // To the bathroom.
    [-0.4, -0.65, 180.0, -10.0],
    [-1.0, -0.2, 130.0, -10.0],
    [-1.1, 0.9, 80.0, -15.0],
    [-0.9, 1.7, 30.0, -15.0],
    [-0.4, 1.95, 0.0, -10.0],
    [0.6, 1.9, 15.0, -15.0],
    [1.4, 1.8, 60.0, -15.0],
    [2.1, 1.7, 70.0, -25.0],
    [2.8, 1.7, 15.0, -25.0],
    [3.0, 1.9, -50.0, -20.0],
    [2.8, 2.1, -115.0, -10.0],
    [2.2, 2.0, -165.0, 10.0],
    [1.6, 1.9, -205.0, 5.0],
    [0.9, 1.95, -180.0, -10.0],
    // Back through the kitchen.
    [-0.5, 1.9, -195.0, -15.0],
    [-1.3, 0.3, -165.0, -20.0],
];

/// The camera at a share of the walk, 0 to 1, back to where it began.
pub fn walk(share: f64) -> Pose {
    let count = STATIONS.len();
    let along = share.rem_euclid(1.0) * count as f64;
    let (station, t) = (along as usize % count, along.fract());
    // The walk makes one turn to the right in all.
    let place = |offset: usize| {
        let index = station + offset + count - 1;
        let mut place = STATIONS[index % count];
        place[2] -= 360.0 * (index / count) as f64;
        place
    };
    let places = [0, 1, 2, 3].map(place);
    let [x, y, yaw, pitch] = [0, 1, 2, 3].map(|axis| spline(places.map(|place| place[axis]), t));
    let (yaw, pitch) = (yaw.to_radians(), pitch.to_radians());
    let eye = DVec3::new(x, y, EYE_M);
    let gaze = DVec3::new(yaw.cos() * pitch.cos(), yaw.sin() * pitch.cos(), pitch.sin());
    Pose::looking_at(eye, eye + gaze, DVec3::Z)
}

/// Between `b` and `c` of four values in a row, smoothly (Catmull and Rom).
fn spline([a, b, c, d]: [f64; 4], t: f64) -> f64 {
    let (linear, square, cube) = (c - a, 2.0 * a - 5.0 * b + 4.0 * c - d, 3.0 * (b - c) + d - a);
    b + 0.5 * t * (linear + t * (square + t * cube))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Dataset;
    use crate::dataset::synthetic::Synthetic;

    #[test]
    fn the_walk_keeps_clear_of_things_and_closes() {
        let scene = scene();
        for i in 0..1200 {
            let share = f64::from(i) / 1200.0;
            let eye = walk(share).position_f32();
            assert!(scene.distance(eye) > 0.3, "{} m at {eye}", scene.distance(eye));
            let turn = walk(share).rotation.angle_between(walk(share + 1.0 / 1200.0).rotation);
            assert!(turn < 0.09, "{turn} rad at {share}");
        }
        let (start, end) = (walk(0.0), walk(1.0 - 1e-12));
        assert!((start.translation - end.translation).length() < 1e-6);
        assert!(start.rotation.dot(end.rotation).abs() > 1.0 - 1e-6);
    }

    #[test]
    fn it_is_closed_and_every_class_and_every_object_is_seen() {
        let data = Synthetic::house(400).with_width(96);
        let scene = data.scene(0);
        let (mut of_class, mut of_object) = (vec![0u32; 64], vec![0u32; scene.objects().len()]);
        for index in (0..data.len()).step_by(4) {
            let frame = data.load(index, false).unwrap();
            let labels = data.labels(index).unwrap().expect("labels");
            labels.check().unwrap();
            assert_eq!(frame.depth.valid_pixels(), data.intrinsics().pixels());
            for (pixel, id) in labels.ids.iter().enumerate() {
                let (u, v) = (pixel as u32 % labels.width, pixel as u32 / labels.width);
                let direction = data.intrinsics().direction(u as f32, v as f32);
                let pose = &frame.world_from_camera;
                let hit = scene.cast(pose.position_f32(), pose.rotation_f32() * direction);
                let object = usize::from(hit.expect("a closed house").object);
                of_object[object] += 1;
                of_class[usize::from(*id)] += 1;
                let class = labels.classes.iter().find(|class| class.id == *id).expect("a class");
                let name = &scene.objects()[object].name;
                assert_eq!(
                    class.name,
                    scene.objects()[object].class,
                    "{name} at {u} {v} of {index}"
                );
            }
        }
        let objects = scene.objects().iter().zip(of_object);
        let hidden: Vec<_> = objects.filter(|(_, seen)| *seen < 10).map(|(o, _)| &o.name).collect();
        assert!(hidden.is_empty(), "hardly seen: {hidden:?}");
        let (classes, pixels) = (scene.classes(), of_class.iter().sum::<u32>());
        // Floor, ceiling and wall, and what stands in the rooms.
        assert!(classes.len() >= 3 + 18, "{} classes", classes.len());
        let share = |id: u16| f64::from(of_class[usize::from(id)]) / f64::from(pixels);
        let rare: Vec<_> = classes.iter().filter(|class| share(class.id) < 0.0015).collect();
        assert!(rare.is_empty(), "hardly seen: {rare:?}");
        for class in classes.iter() {
            assert!(class.name.chars().all(|c| c.is_ascii_lowercase()), "one word: {}", class.name);
        }
    }
}
