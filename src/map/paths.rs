//! Whether a body of spheres gets along paths: its least clearance, where it first hits something,
//! and what of its way nobody has seen.
//!
//! Between two poses the body moves in a straight line and turns at a constant rate the shortest way, so
//! that the centre of a sphere covers at most |Δp| + θ |c| metres. The field changes by at most
//! [`STEEPEST`] metres a metre, which bounds the clearance between two places from below: what the bound
//! leaves open is halved and looked at in the middle, all open pieces of all paths side by side, so that
//! their points share the decoder's tiles. Places that are unknown bound nothing: they are looked for
//! every [`LOOK_M`].

use glam::Vec3;
use rustc_hash::FxHashSet;

use super::parallel::PointQuery;
use super::query::Fields;
use super::sphere::Sphere;
use super::waypoint::Waypoint;

/// How much the field may change a metre. A distance has 1; interpolation and learning err by less
/// than the rest.
pub(super) const STEEPEST: f32 = 1.5;
/// Unknown space between two poses is looked for this densely, m: half an evidence cell.
pub(super) const LOOK_M: f32 = 0.05;
/// A way of a sphere's centre that is not halved any more, m: its middle may be closer to a surface
/// than its ends by half of that.
const FINEST_M: f32 = 0.004;
/// The least clearance is found to this, m.
const TOLERANCE_M: f32 = 0.01;

/// What paths are held against.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathSettings {
    /// A clearance below this is a hit, m.
    pub margin_m: f32,
    /// Between poses too.
    pub swept: bool,
    /// The distance that stands for unknown ones, m; `None`: they are counted apart.
    pub unknown_m: Option<f32>,
}

/// A part of a path: the poses in `from..to`, and the ways from each of them to the next pose.
#[derive(Debug, Clone, Copy)]
pub struct PathPart<'a> {
    /// Of the whole path.
    pub poses: &'a [Waypoint],
    pub from: usize,
    pub to: usize,
}

/// A place on a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPlace {
    pub pose: u32,
    /// The share of the way to the next pose, from 0 to below 1.
    pub fraction: f32,
    /// Which sphere of the body.
    pub sphere: u32,
}

/// What became of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathVerdict {
    /// m; NaN where everything is unknown.
    pub min_clearance_m: f32,
    pub min_at: Option<PathPlace>,
    pub first_hit: Option<PathPlace>,
    /// Pairs of pose and sphere, or of a way between known poses and a sphere, that meet unknown space.
    pub unknown_hits: u64,
}

impl PathVerdict {
    /// Of nothing.
    pub const NONE: Self =
        Self { min_clearance_m: f32::NAN, min_at: None, first_hit: None, unknown_hits: 0 };

    /// Of a path, from those of its beginning and of what follows.
    pub fn then(self, next: Self) -> Self {
        let is_less = next.min_at.is_some()
            && (self.min_at.is_none() || next.min_clearance_m < self.min_clearance_m);
        let least = if is_less { &next } else { &self };
        Self {
            min_clearance_m: least.min_clearance_m,
            min_at: least.min_at,
            first_hit: self.first_hit.or(next.first_hit),
            unknown_hits: self.unknown_hits + next.unknown_hits,
        }
    }

    fn time_of_hit(&self) -> (u32, f32) {
        self.first_hit.map_or((u32::MAX, 0.0), |at| (at.pose, at.fraction))
    }

    /// Takes in a place with its clearance.
    fn see(&mut self, at: PathPlace, clearance_m: f32, margin_m: f32) {
        if clearance_m.is_nan() {
            return;
        }
        if self.min_at.is_none() || clearance_m < self.min_clearance_m {
            (self.min_clearance_m, self.min_at) = (clearance_m, Some(at));
        }
        if clearance_m < margin_m && (at.pose, at.fraction) < self.time_of_hit() {
            self.first_hit = Some(at);
        }
    }
}

/// A piece of the way of a sphere from a pose to the next.
#[derive(Debug, Clone, Copy)]
struct Piece {
    part: u32,
    pose: u32,
    sphere: u32,
    /// Its ends, as shares of the way.
    ends: [f32; 2],
    /// Clearances there, m; NaN where unknown.
    clearances: [f32; 2],
    /// What the centre covers at most, m.
    length_m: f32,
    /// The centre is known at both poses.
    is_known: bool,
}

impl Piece {
    fn middle(&self) -> f32 {
        0.5 * (self.ends[0] + self.ends[1])
    }

    /// No clearance on the way is below this, m.
    fn bound_m(&self) -> f32 {
        let [a, b] = self.clearances;
        let fall = STEEPEST * self.length_m;
        match (a.is_nan(), b.is_nan()) {
            (false, false) => 0.5 * (a + b - fall),
            (false, true) => a - fall,
            (true, false) => b - fall,
            // Nobody knows, and it was looked at closely enough.
            (true, true) => f32::INFINITY,
        }
    }

    /// Whether its middle may tell something new.
    fn is_open(&self, verdict: &PathVerdict, settings: &PathSettings) -> bool {
        let ends_are_known = self.clearances.iter().all(|c| !c.is_nan());
        let skips_unknown = settings.unknown_m.is_some_and(|d| d > 0.0);
        if self.length_m > LOOK_M && !(ends_are_known && skips_unknown) {
            return true;
        }
        let bound_m = self.bound_m();
        let may_hit =
            bound_m < settings.margin_m && (self.pose, self.ends[0]) < verdict.time_of_hit();
        let may_be_least = bound_m < verdict.min_clearance_m - TOLERANCE_M;
        self.length_m > FINEST_M && (may_hit || may_be_least)
    }

    fn halves(self, clearance_m: f32) -> [Self; 2] {
        let (middle, length_m) = (self.middle(), 0.5 * self.length_m);
        let [a, b] = self.clearances;
        [
            Self { ends: [self.ends[0], middle], clearances: [a, clearance_m], length_m, ..self },
            Self { ends: [middle, self.ends[1]], clearances: [clearance_m, b], length_m, ..self },
        ]
    }
}

/// A way from a pose to the next: how far the body moves, m, and how far it turns, rad.
#[derive(Debug, Clone, Copy)]
struct Way {
    straight_m: f32,
    turn: f32,
}

impl Way {
    fn new(from: &Waypoint, to: &Waypoint) -> Self {
        /// What the angle may lack by rounding.
        const ROUNDING: f32 = 1e-3;
        let turn = from.rotation().angle_between(to.rotation()) + ROUNDING;
        Self { straight_m: from.position().distance(to.position()), turn }
    }

    /// What the centre of a sphere covers at most, m.
    fn length_m(&self, sphere: &Sphere) -> f32 {
        self.straight_m + self.turn * sphere.center.length()
    }
}

/// How many places of a body are looked at between two poses at least, in search of unknown space.
pub fn looks(body: &[Sphere], from: &Waypoint, to: &Waypoint) -> u64 {
    let way = Way::new(from, to);
    let of_sphere = |sphere: &Sphere| (way.length_m(sphere) / LOOK_M).floor() as u64;
    body.iter().map(of_sphere).fold(0, u64::saturating_add)
}

/// The verdicts on parts of paths; `None` if `is_left` says that nobody waits for them any more.
pub fn check_paths(
    query: &impl PointQuery,
    body: &[Sphere],
    parts: &[PathPart<'_>],
    settings: &PathSettings,
    is_left: &dyn Fn() -> bool,
) -> Option<Vec<PathVerdict>> {
    let mut check = Check {
        query,
        body,
        parts,
        settings,
        verdicts: Vec::new(),
        asked: Vec::new(),
        unknown_ways: FxHashSet::default(),
    };
    let mut pieces = check.poses();
    loop {
        pieces.retain(|piece| piece.is_open(&check.verdicts[piece.part as usize], settings));
        if pieces.is_empty() {
            return Some(check.verdicts);
        }
        if is_left() {
            return None;
        }
        pieces = check.round(&pieces);
    }
}

struct Check<'a, Q> {
    query: &'a Q,
    body: &'a [Sphere],
    parts: &'a [PathPart<'a>],
    settings: &'a PathSettings,
    /// One a part.
    verdicts: Vec<PathVerdict>,
    /// What is asked in a round.
    asked: Vec<Vec3>,
    /// Ways between known poses that met unknown space: part, pose, sphere.
    unknown_ways: FxHashSet<[u32; 3]>,
}

impl<Q: PointQuery> Check<'_, Q> {
    /// Clearances of what is asked, NaN where unknown.
    fn answer(&mut self, spheres: impl Iterator<Item = usize>) -> Vec<f32> {
        let mut distances = (self.query)(&self.asked, Fields::DISTANCE).distance;
        self.asked.clear();
        for (distance, sphere) in distances.iter_mut().zip(spheres) {
            *distance -= self.body[sphere].radius_m;
        }
        distances
    }

    /// Looks at all poses; what lies between them.
    fn poses(&mut self) -> Vec<Piece> {
        let (body, swept) = (self.body, self.settings.swept);
        // The pose after the part, where its last way ends.
        let end = |part: &PathPart<'_>| (part.to + usize::from(swept)).min(part.poses.len());
        for part in self.parts {
            for pose in &part.poses[part.from..end(part)] {
                let (rotation, position) = (pose.rotation(), pose.position());
                self.asked.extend(body.iter().map(|s| rotation * s.center + position));
            }
        }
        let spheres = 0..body.len();
        let clearances = self.answer(spheres.cycle().take(self.asked.len()));
        let mut pieces = Vec::new();
        let mut at = 0;
        for (index, part) in self.parts.iter().enumerate() {
            let mut verdict = PathVerdict::NONE;
            for pose in part.from..end(part) {
                let here = &clearances[at..at + body.len()];
                at += body.len();
                if pose >= part.to {
                    continue;
                }
                for (sphere, &clearance) in here.iter().enumerate() {
                    let place =
                        PathPlace { pose: pose as u32, fraction: 0.0, sphere: sphere as u32 };
                    verdict.unknown_hits += u64::from(clearance.is_nan());
                    verdict.see(place, self.filled(clearance, sphere), self.settings.margin_m);
                }
                if swept && pose + 1 < part.poses.len() {
                    let next = &clearances[at..at + body.len()];
                    let way = Way::new(&part.poses[pose], &part.poses[pose + 1]);
                    pieces.extend((0..body.len()).map(|sphere| Piece {
                        part: index as u32,
                        pose: pose as u32,
                        sphere: sphere as u32,
                        ends: [0.0, 1.0],
                        clearances: [here[sphere], next[sphere]],
                        length_m: way.length_m(&body[sphere]),
                        is_known: !(here[sphere].is_nan() || next[sphere].is_nan()),
                    }));
                }
            }
            self.verdicts.push(verdict);
        }
        pieces
    }

    /// The clearance with what stands for unknown.
    fn filled(&self, clearance_m: f32, sphere: usize) -> f32 {
        match self.settings.unknown_m {
            Some(distance_m) if clearance_m.is_nan() => distance_m - self.body[sphere].radius_m,
            _ => clearance_m,
        }
    }

    /// Looks at the middles; the halves of all pieces.
    fn round(&mut self, pieces: &[Piece]) -> Vec<Piece> {
        for piece in pieces {
            let poses = self.parts[piece.part as usize].poses;
            let (from, to) = (&poses[piece.pose as usize], &poses[piece.pose as usize + 1]);
            let share = piece.middle();
            let rotation = from.rotation().slerp(to.rotation(), share);
            let position = from.position().lerp(to.position(), share);
            self.asked.push(rotation * self.body[piece.sphere as usize].center + position);
        }
        let clearances = self.answer(pieces.iter().map(|piece| piece.sphere as usize));
        let mut halves = Vec::with_capacity(2 * pieces.len());
        for (piece, &clearance) in pieces.iter().zip(&clearances) {
            let at = PathPlace { pose: piece.pose, fraction: piece.middle(), sphere: piece.sphere };
            let filled = self.filled(clearance, piece.sphere as usize);
            self.verdicts[piece.part as usize].see(at, filled, self.settings.margin_m);
            let way = [piece.part, piece.pose, piece.sphere];
            if clearance.is_nan() && piece.is_known && self.unknown_ways.insert(way) {
                self.verdicts[piece.part as usize].unknown_hits += 1;
            }
            halves.extend(piece.halves(clearance));
        }
        halves
    }
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::*;
    use crate::geometry::random::{pcg4d, unit};
    use crate::map::query::PointAnswers;

    const FREELY: PathSettings = PathSettings { margin_m: 0.0, swept: true, unknown_m: None };

    /// The distance from a sheet 4 mm thick at x = 0, unknown where `is_unknown`.
    fn sheet(is_unknown: fn(Vec3) -> bool) -> impl PointQuery {
        let distance = move |p: &Vec3| if is_unknown(*p) { f32::NAN } else { p.x.abs() - 0.002 };
        move |points: &[Vec3], _: Fields| PointAnswers {
            distance: points.iter().map(distance).collect(),
            ..PointAnswers::default()
        }
    }

    fn check(
        query: &impl PointQuery,
        body: &[Sphere],
        poses: &[Waypoint],
        settings: &PathSettings,
    ) -> PathVerdict {
        let whole = PathPart { poses, from: 0, to: poses.len() };
        check_paths(query, body, &[whole], settings, &|| false).expect("not left")[0]
    }

    fn point() -> [Sphere; 1] {
        [Sphere { center: Vec3::ZERO, radius_m: 0.0 }]
    }

    fn along_x(xs: &[f32]) -> Vec<Waypoint> {
        xs.iter().map(|x| Waypoint::at(Vec3::new(*x, 0.0, 0.0))).collect()
    }

    #[test]
    fn a_thin_sheet_between_two_poses_is_met() {
        let known = sheet(|_| false);
        let poses = along_x(&[-2.0, -1.0, 0.73, 1.0]);
        let verdict = check(&known, &point(), &poses, &FREELY);
        let hit = verdict.first_hit.expect("it goes through");
        assert_eq!((hit.pose, hit.sphere), (1, 0));
        let x = -1.0 + 1.73 * hit.fraction;
        assert!((-0.002..0.002).contains(&x), "{x}");
        assert!(verdict.min_clearance_m < 0.0 && verdict.unknown_hits == 0);
        let at_poses = check(&known, &point(), &poses, &PathSettings { swept: false, ..FREELY });
        assert!(at_poses.first_hit.is_none() && (at_poses.min_clearance_m - 0.728).abs() < 1e-6);
        let before = check(&known, &point(), &poses[..2], &FREELY);
        assert!(before.first_hit.is_none() && (before.min_clearance_m - 0.998).abs() < 1e-6);
    }

    #[test]
    fn a_turn_sweeps_what_is_far_out() {
        // A beam's end passes through the sheet while the body turns on the spot.
        let beam = [Sphere { center: Vec3::X, radius_m: 0.05 }];
        let turned = |yaw: f32| Waypoint {
            translation: [0.5, 0.0, 0.0],
            rotation: Quat::from_rotation_z(yaw).to_array(),
        };
        let poses = [turned(0.0), turned(2.5)];
        let verdict = check(&sheet(|_| false), &beam, &poses, &FREELY);
        let hit = verdict.first_hit.expect("it turns through");
        // cos 2.0 is about -0.45: the sphere touches the sheet there.
        let expected = (0.05f32 + 0.002 - 0.5).acos() / 2.5;
        assert!((hit.fraction - expected).abs() < 0.003, "{} {expected}", hit.fraction);
    }

    #[test]
    fn unknown_space_counts_as_asked() {
        let gap = sheet(|p| (0.3..0.4).contains(&p.x));
        let poses = along_x(&[1.0, 0.1]);
        let verdict =
            |unknown_m| check(&gap, &point(), &poses, &PathSettings { unknown_m, ..FREELY });
        let reported = verdict(None);
        assert_eq!((reported.unknown_hits, reported.first_hit), (1, None));
        assert!((reported.min_clearance_m - 0.098).abs() < 1e-6);
        assert_eq!(verdict(Some(2.0)).first_hit, None);
        let occupied = verdict(Some(-2.0));
        let hit = occupied.first_hit.expect("unknown is hit");
        let x = 1.0 - 0.9 * hit.fraction;
        assert!((0.3..0.4).contains(&x) && occupied.min_clearance_m == -2.0, "{x}");
        let nowhere = check(&sheet(|_| true), &point(), &poses, &FREELY);
        assert!(nowhere.min_clearance_m.is_nan() && nowhere.min_at.is_none());
        assert_eq!(nowhere.unknown_hits, 2);
    }

    #[test]
    fn parts_of_a_path_say_what_the_whole_says() {
        let known = sheet(|p| p.y > 0.9);
        let place = |i| {
            let [x, y, _, _] = pcg4d([i, 0, 0, 9]);
            Waypoint::at(Vec3::new(2.0 * unit(x) - 0.5, unit(y), 0.0))
        };
        let poses: Vec<Waypoint> = (0..20).map(place).collect();
        let whole = check(&known, &point(), &poses, &FREELY);
        let part = |from, to| PathPart { poses: &poses, from, to };
        let parts = [part(0, 7), part(7, 8), part(8, 20)];
        let verdicts = check_paths(&known, &point(), &parts, &FREELY, &|| false).expect("all");
        let joined = verdicts.into_iter().fold(PathVerdict::NONE, PathVerdict::then);
        let hit = |v: &PathVerdict| v.first_hit.map(|at| (at.pose, at.sphere));
        assert_eq!((hit(&joined), joined.unknown_hits), (hit(&whole), whole.unknown_hits));
        assert!((joined.min_clearance_m - whole.min_clearance_m).abs() <= TOLERANCE_M);
        assert!(check_paths(&known, &point(), &parts, &FREELY, &|| true).is_none(), "left");
    }
}
