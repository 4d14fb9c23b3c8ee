//! What stands where.

use super::super::scene::SceneBuilder;
use super::super::texture::Texture;
use super::{EAST, NORTH, SOUTH, Spot, WEST, WOOD, fittings, furniture};

/// The faces of the outer walls, and those of the wall between west and east.
const WEST_WALL: f32 = -4.6;
const EAST_WALL: f32 = 4.6;
const SOUTH_WALL: f32 = -3.1;
const NORTH_WALL: f32 = 3.1;
const MIDDLE_WEST: f32 = -0.06;
const MIDDLE_EAST: f32 = 0.06;
/// The faces of the wall between bedroom and bathroom.
const BEDROOM_NORTH: f32 = 0.54;
const BATHROOM_SOUTH: f32 = 0.66;

pub(super) fn living_room(house: &mut SceneBuilder) {
    let couch = Spot::new(WEST_WALL + 0.02, -1.5, EAST);
    furniture::couch(house, couch);
    furniture::throw(house, couch);
    furniture::rug(house, Spot::new(-2.85, -1.5, EAST), [2.4, 1.7], [0.5, 0.12, 0.1]);
    furniture::table(house, Spot::new(-2.85, -1.5, EAST), [1.1, 0.6, 0.42]);
    furniture::book(house, Spot::new(-2.8, -1.7, 0.4), 0.42, [0.1, 0.3, 0.55]);
    let media = Spot::new(MIDDLE_WEST, -2.1, WEST);
    furniture::cabinet(house, media, [1.5, 0.42, 0.5], WOOD);
    furniture::television(house, media, 0.5);
    furniture::floor_lamp(house, Spot::new(-4.3, -2.85, EAST));
    furniture::plant(house, Spot::new(-4.25, -0.1, EAST), 1.0);
    furniture::bookshelf(house, Spot::new(-3.0, SOUTH_WALL, NORTH));
    fittings::closed_door(house, Spot::new(-1.5, SOUTH_WALL, NORTH));
    let window = Spot::new(WEST_WALL, -1.5, EAST);
    fittings::window(house, window, [1.3, 1.0], 1.65);
    fittings::curtains(house, window, 1.3, [0.75, 0.45, 0.12]);
    fittings::picture(house, Spot::new(MIDDLE_WEST, 0.6, WEST), [0.9, 0.65], 1.55);
}

pub(super) fn kitchen(house: &mut SceneBuilder) {
    fittings::tiles(house, [-2.33, 1.3], [4.54, 3.6], [0.62, 0.6, 0.55]);
    fittings::refrigerator(house, Spot::new(-4.2, NORTH_WALL, SOUTH));
    // The counter, with a gap for the stove.
    let white = [0.75, 0.72, 0.62];
    furniture::cabinet(house, Spot::new(-3.06, NORTH_WALL, SOUTH), [1.48, 0.6, 0.9], white);
    furniture::cabinet(house, Spot::new(-1.05, NORTH_WALL, SOUTH), [1.28, 0.6, 0.9], white);
    fittings::stove(house, Spot::new(-2.0, NORTH_WALL, SOUTH));
    fittings::basin(house, Spot::new(-3.1, NORTH_WALL - 0.08, SOUTH), [0.6, 0.44, 0.14], 0.9);
    furniture::hanging_cabinet(
        house,
        Spot::new(-1.05, NORTH_WALL, SOUTH),
        [1.28, 0.34, 0.65],
        white,
    );
    fittings::window(house, Spot::new(-3.06, NORTH_WALL, SOUTH), [1.2, 0.8], 1.7);
    furniture::table(house, Spot::new(-2.3, 0.9, NORTH), [1.4, 0.8, 0.75]);
    for (x, y, facing_rad) in
        [(-2.68, 0.32, NORTH), (-1.95, 0.26, NORTH), (-2.66, 1.52, SOUTH), (-1.92, 1.46, SOUTH)]
    {
        furniture::chair(house, Spot::new(x, y, facing_rad + 0.1 * (x + 2.3)), [0.5, 0.3, 0.14]);
    }
    furniture::hanging_lamp(house, [-2.3, 0.9]);
    fittings::clock(house, Spot::new(WEST_WALL, 1.3, EAST), 1.75);
    furniture::plant(house, Spot::new(-0.4, 0.15, EAST), 0.8);
}

pub(super) fn bedroom(house: &mut SceneBuilder) {
    furniture::bed(house, Spot::new(EAST_WALL, -1.3, WEST));
    for y in [-2.45, -0.15] {
        let beside = Spot::new(EAST_WALL, y, WEST);
        furniture::cabinet(house, beside, [0.45, 0.42, 0.5], WOOD);
        furniture::table_lamp(house, beside.at(0.2, 0.0, 0.5));
    }
    furniture::book(house, Spot::new(4.28, -0.3, 0.3), 0.5, [0.55, 0.15, 0.12]);
    furniture::wardrobe(house, Spot::new(1.15, SOUTH_WALL, NORTH));
    let window = Spot::new(3.1, SOUTH_WALL, NORTH);
    fittings::window(house, window, [1.2, 1.0], 1.6);
    fittings::curtains(house, window, 1.2, [0.2, 0.35, 0.55]);
    furniture::rug(house, Spot::new(1.6, -1.25, EAST), [2.0, 1.5], [0.14, 0.2, 0.42]);
    let desk = Spot::new(2.6, BEDROOM_NORTH - 0.32, SOUTH);
    furniture::table(house, desk, [1.4, 0.6, 0.75]);
    furniture::chair(house, Spot::new(2.55, -0.28, NORTH + 0.25), [0.12, 0.12, 0.14]);
    furniture::book(house, Spot::new(2.4, 0.15, 1.2), 0.75, [0.15, 0.45, 0.3]);
    furniture::table_lamp(house, [3.1, BEDROOM_NORTH - 0.3, 0.75]);
    fittings::picture(house, Spot::new(2.6, BEDROOM_NORTH, SOUTH), [1.0, 0.6], 1.6);
    fittings::clock(house, Spot::new(MIDDLE_EAST, -1.9, EAST), 1.75);
    fittings::mirror(house, Spot::new(1.4, BEDROOM_NORTH, SOUTH), [0.5, 1.5], 1.15);
}

pub(super) fn bathroom(house: &mut SceneBuilder) {
    fittings::tiles(house, [2.33, 1.88], [4.54, 2.44], [0.35, 0.5, 0.58]);
    fittings::bathtub(house, Spot::new(EAST_WALL, 2.0, WEST));
    fittings::toilet(house, Spot::new(2.7, NORTH_WALL, SOUTH));
    let basin = Spot::new(1.5, NORTH_WALL, SOUTH);
    fittings::basin(house, basin, [0.6, 0.46, 0.18], 0.72);
    house.cylinder(basin.at(0.23, 0.0, -0.05), 0.09, 0.78);
    fittings::mirror(house, basin, [0.75, 0.85], 1.55);
    fittings::towel(house, Spot::new(1.7, BATHROOM_SOUTH, NORTH), [0.7, 0.12, 0.12]);
    fittings::towel(house, Spot::new(3.4, NORTH_WALL, SOUTH), [0.2, 0.45, 0.5]);
    furniture::cabinet(
        house,
        Spot::new(2.9, BATHROOM_SOUTH, NORTH),
        [0.8, 0.36, 0.85],
        [0.8, 0.8, 0.78],
    );
    furniture::rug(house, Spot::new(3.3, 1.9, EAST), [1.1, 0.65], [0.7, 0.65, 0.5]);
    house
        .object("bathroom lamp", "lamp", [0.95, 0.93, 0.85], Texture::Plain)
        .cylinder([1.0, 1.15, 2.1], 0.015, 0.6)
        .sphere([1.0, 1.15, 2.05], 0.16);
}
