//! A scene: one room shell and the solids in it, each a part of a named object.

use std::sync::Arc;

use glam::{Mat3, Quat, Vec3};

use super::bvh::Bvh;
use super::solid::{Nearest, Shape, Solid, nearest_box};
use super::texture::Texture;
use crate::frame::Class;
use crate::geometry::Aabb;

/// A thing with a name, a class that a labelling would use, and a look.
#[derive(Debug, Clone)]
pub struct Object {
    pub name: String,
    pub class: &'static str,
    /// Linear RGB, 0 to 1.
    pub albedo: Vec3,
    pub texture: Texture,
}

/// Objects 0, 1 and 2 of every scene are the shell's.
const FLOOR: u16 = 0;
const CEILING: u16 = 1;
const WALLS: u16 = 2;

/// The free space within a shell, less the solids in it.
#[derive(Debug, Clone)]
pub struct Scene {
    /// The inner faces of floor, walls and ceiling, world metres.
    room: Aabb,
    objects: Vec<Object>,
    /// The classes of the objects, in the order of their first objects, ids from 1 on.
    classes: Arc<[Class]>,
    /// For each object, the id of its class.
    class_ids: Vec<u16>,
    solids: Vec<Solid>,
    tree: Bvh,
}

/// What a ray met.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// In lengths of the ray's direction.
    pub t: f32,
    /// Unit normal towards free space.
    pub normal: Vec3,
    /// Index into [`Scene::objects`].
    pub object: u16,
    /// Index of the solid; `None` for the shell.
    solid: Option<u32>,
}

/// The solids that a bundle of rays can meet, nearest boxes first: (distance, solid).
#[derive(Debug, Clone, Default)]
pub struct Beam {
    solids: Vec<(f32, u32)>,
}

impl Scene {
    /// The objects; the first three are floor, ceiling and walls.
    pub fn objects(&self) -> &[Object] {
        &self.objects
    }

    /// The classes that occur, sorted by id.
    pub fn classes(&self) -> &Arc<[Class]> {
        &self.classes
    }

    /// The id of an object's class.
    pub fn class_id(&self, object: u16) -> u16 {
        self.class_ids[usize::from(object)]
    }

    /// The inner faces of floor, walls and ceiling, world metres.
    pub fn room(&self) -> Aabb {
        self.room
    }

    /// Signed distance to the nearest surface, m: positive in free space, negative inside solids
    /// and behind walls. Exact where [`Scene::is_exact`] says so, which is all of free space;
    /// elsewhere the surface is at least that deep.
    pub fn distance(&self, point: Vec3) -> f32 {
        self.nearest(point).distance
    }

    /// Signed distance as [`Scene::distance`], with its gradient.
    pub fn nearest(&self, point: Vec3) -> Nearest {
        self.nearest_with_owner(point).0
    }

    /// Whether the distance at a point is exact: in free space always; inside, when the nearest
    /// face of the solid that the point is deepest in is not covered by another solid (a chair leg
    /// against the floor).
    pub fn is_exact(&self, point: Vec3) -> bool {
        let (nearest, owner) = self.nearest_with_owner(point);
        if nearest.distance >= 0.0 {
            return true;
        }
        let foot = point - nearest.gradient * nearest.distance;
        let mut clear = owner.is_none() || self.nearest_shell(foot).distance > -1e-4;
        self.tree.around(foot, 0.0, |index| {
            if Some(index) != owner {
                clear &= self.solids[index as usize].nearest(foot).distance > -1e-4;
            }
            0.0
        });
        clear
    }

    fn nearest_with_owner(&self, point: Vec3) -> (Nearest, Option<u32>) {
        let mut best = (self.nearest_shell(point), None);
        self.tree.around(point, best.0.distance, |index| {
            let nearest = self.solids[index as usize].nearest(point);
            if nearest.distance < best.0.distance {
                best = (nearest, Some(index));
            }
            best.0.distance
        });
        best
    }

    fn nearest_shell(&self, point: Vec3) -> Nearest {
        let half = self.room.size() * 0.5;
        let (distance, gradient) = nearest_box(point - (self.room.min + half), half);
        Nearest { distance: -distance, gradient: -gradient }
    }

    /// The first surface along a ray that starts in free space. `direction` need not have unit
    /// length: with a camera's direction of z = 1, `t` is the z-depth.
    pub fn cast(&self, origin: Vec3, direction: Vec3) -> Option<Hit> {
        let mut best = self.cast_shell(origin, direction);
        let limit = best.map_or(f32::INFINITY, |hit| hit.t);
        let mut nearest = limit;
        self.tree.along(origin, direction, limit, |index| {
            let solid = &self.solids[index as usize];
            if let Some(hit) = solid.cast(origin, direction).filter(|hit| hit.t < nearest) {
                nearest = hit.t;
                let (t, normal) = (hit.t, hit.normal);
                best = Some(Hit { t, normal, object: solid.object, solid: Some(index) });
            }
            nearest
        });
        best
    }

    /// Collects into `beam` what rays from `apex` between four planes through it can meet; the
    /// planes are given by their inward normals.
    pub fn gather(&self, apex: Vec3, planes: &[Vec3; 4], beam: &mut Beam) {
        beam.solids.clear();
        self.tree.within(apex, planes, &mut beam.solids);
        beam.solids.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }

    /// The same as [`Scene::cast`] for a ray within the planes that `beam` was gathered for.
    pub fn cast_in(&self, beam: &Beam, origin: Vec3, direction: Vec3) -> Option<Hit> {
        let mut best = self.cast_shell(origin, direction);
        let length = direction.length();
        for &(distance, index) in &beam.solids {
            let limit = best.map_or(f32::INFINITY, |hit| hit.t);
            if distance > limit * length {
                break;
            }
            let solid = &self.solids[index as usize];
            if let Some(hit) = solid.cast(origin, direction).filter(|hit| hit.t < limit) {
                let (t, normal) = (hit.t, hit.normal);
                best = Some(Hit { t, normal, object: solid.object, solid: Some(index) });
            }
        }
        best
    }

    fn cast_shell(&self, origin: Vec3, direction: Vec3) -> Option<Hit> {
        if !self.room.contains(origin) {
            return None;
        }
        let bound = Vec3::select(direction.cmpgt(Vec3::ZERO), self.room.max, self.room.min);
        let leave = (bound - origin) / direction;
        // Along a face the ray never leaves through it; the quotient may be any infinity or NaN.
        let leave = Vec3::select(direction.cmpeq(Vec3::ZERO), Vec3::INFINITY, leave);
        let axis = leave.min_position();
        let object = match axis {
            2 if direction.z < 0.0 => FLOOR,
            2 => CEILING,
            _ => WALLS,
        };
        let normal = -Vec3::AXES[axis] * 1f32.copysign(direction[axis]);
        leave[axis].is_finite().then_some(Hit { t: leave[axis], normal, object, solid: None })
    }

    /// The albedo of a hit at a world point, linear RGB.
    pub fn albedo(&self, hit: &Hit, point: Vec3) -> Vec3 {
        let object = &self.objects[usize::from(hit.object)];
        let local =
            hit.solid.map_or(point, |index| self.solids[index as usize].point_in_axes(point));
        object.albedo * object.texture.shade(local)
    }
}

/// Puts a scene together, object by object; lengths in metres, z up.
pub struct SceneBuilder {
    room: Aabb,
    objects: Vec<Object>,
    solids: Vec<Solid>,
}

impl SceneBuilder {
    /// An empty room with the given inner faces.
    pub fn new(room: Aabb) -> Self {
        let mut builder = Self { room, objects: Vec::new(), solids: Vec::new() };
        builder
            .object("floor", "floor", [0.55, 0.38, 0.22], Texture::Planks { width: 0.14 })
            .object("ceiling", "ceiling", [0.9, 0.9, 0.88], Texture::Plain)
            .object("walls", "wall", [0.72, 0.74, 0.68], Texture::Speckles { size: 0.25 });
        builder
    }

    /// Begins a new object; the shapes that follow are its parts.
    pub fn object(
        &mut self,
        name: impl Into<String>,
        class: &'static str,
        albedo: [f32; 3],
        texture: Texture,
    ) -> &mut Self {
        self.objects.push(Object { name: name.into(), class, albedo: albedo.into(), texture });
        self
    }

    /// A box by its centre and edge lengths, turned about z by `yaw_rad`.
    pub fn block(&mut self, centre: [f32; 3], size: [f32; 3], yaw_rad: f32) -> &mut Self {
        let shape = Shape::Box { half: Vec3::from(size) * 0.5 };
        self.solid(shape, centre.into(), Mat3::from_rotation_z(yaw_rad))
    }

    /// A box leaning about its own x axis by `lean_rad` before it is turned about z.
    pub fn leaning_block(
        &mut self,
        centre: [f32; 3],
        size: [f32; 3],
        yaw_rad: f32,
        lean_rad: f32,
    ) -> &mut Self {
        let shape = Shape::Box { half: Vec3::from(size) * 0.5 };
        let turn = Mat3::from_rotation_z(yaw_rad) * Mat3::from_rotation_x(lean_rad);
        self.solid(shape, centre.into(), turn)
    }

    pub fn sphere(&mut self, centre: [f32; 3], radius: f32) -> &mut Self {
        self.solid(Shape::Sphere { radius }, centre.into(), Mat3::IDENTITY)
    }

    /// An upright cylinder that stands on `base`.
    pub fn cylinder(&mut self, base: [f32; 3], radius: f32, height: f32) -> &mut Self {
        let half_height = height * 0.5;
        let centre = Vec3::from(base) + Vec3::Z * half_height;
        self.solid(Shape::Cylinder { radius, half_height }, centre, Mat3::IDENTITY)
    }

    /// A cylinder with flat ends from `a` to `b`.
    pub fn rod(&mut self, a: [f32; 3], b: [f32; 3], radius: f32) -> &mut Self {
        let (centre, half_height, turn) = between(a, b);
        self.solid(Shape::Cylinder { radius, half_height }, centre, turn)
    }

    /// A cylinder with round ends around `a` and `b`.
    pub fn capsule(&mut self, a: [f32; 3], b: [f32; 3], radius: f32) -> &mut Self {
        let (centre, half_length, turn) = between(a, b);
        self.solid(Shape::Capsule { radius, half_length }, centre, turn)
    }

    fn solid(&mut self, shape: Shape, centre: Vec3, world_from_local: Mat3) -> &mut Self {
        let object = (self.objects.len() - 1) as u16;
        self.solids.push(Solid { shape, centre, world_from_local, object });
        self
    }

    /// The finished scene.
    pub fn build(self) -> Scene {
        let tree = Bvh::new(&self.solids);
        let (classes, class_ids) = classes(&self.objects);
        let Self { room, objects, solids } = self;
        Scene { room, objects, classes, class_ids, solids, tree }
    }
}

/// The classes of objects, and for each object the id of its class.
fn classes(objects: &[Object]) -> (Arc<[Class]>, Vec<u16>) {
    let mut names: Vec<&str> = Vec::new();
    let mut ids = Vec::with_capacity(objects.len());
    for object in objects {
        let place = names.iter().position(|name| *name == object.class).unwrap_or(names.len());
        if place == names.len() {
            names.push(object.class);
        }
        ids.push(place as u16 + 1);
    }
    let class =
        |(place, name): (usize, &&str)| Class { id: place as u16 + 1, name: (*name).into() };
    (names.iter().enumerate().map(class).collect(), ids)
}

/// Centre, half length and the rotation that takes z to the direction from `a` to `b`.
fn between(a: [f32; 3], b: [f32; 3]) -> (Vec3, f32, Mat3) {
    let (a, b) = (Vec3::from(a), Vec3::from(b));
    let turn = Quat::from_rotation_arc(Vec3::Z, (b - a).normalize());
    ((a + b) * 0.5, (b - a).length() * 0.5, Mat3::from_quat(turn))
}

#[cfg(test)]
mod tests {
    use super::super::{corridor, room};
    use super::*;
    use crate::geometry::random::{pcg4d, unit};

    #[test]
    fn the_tree_finds_what_a_search_of_all_solids_finds() {
        for (scene, seed) in [(room::scene(), 1), (corridor::scene(40.0), 2)] {
            let (low, size) = (scene.room.min - 0.3, scene.room.size() + 0.6);
            for i in 0..3000 {
                let random = pcg4d([seed, 0, 0, i]).map(unit);
                let point = low + size * Vec3::new(random[0], random[1], random[2]);
                let all = scene.solids.iter().map(|s| s.nearest(point).distance);
                let least = all.fold(scene.nearest_shell(point).distance, f32::min);
                assert_eq!(scene.distance(point), least, "{point}");
            }
        }
    }

    #[test]
    fn depth_inside_is_exact_only_under_a_bare_face() {
        let scene = room::scene();
        // The foot of a desk leg stands below the floor; the top of the desk is bare.
        assert!(scene.is_exact(Vec3::new(-2.94, -0.3, 0.74)));
        assert!(!scene.is_exact(Vec3::new(-2.94, -0.8, -0.05)), "under a leg, in the floor");
        assert!(scene.is_exact(Vec3::new(0.0, 2.0, 2.0)), "free space");
        assert!(scene.is_exact(Vec3::new(1.0, 0.6, 3.0)), "above the ceiling");
        assert!(!scene.is_exact(Vec3::new(0.0, 0.0, 2.72)), "above the lamp's rod");
    }
}
