//! What rays meet first in the field, as queries answer it: rays step by the distance, as far as the
//! field's slope allows, side by side, so that their points share the decoder's tiles.

use glam::Vec3;

use super::parallel::PointQuery;
use super::paths::{LOOK_M, STEEPEST};
use super::query::{Fields, PointAnswers};

/// Steps, m. The longest is the size of an evidence cell: what nobody has seen begins anywhere.
pub const LONGEST_M: f32 = 0.1;
const SHORTEST_M: f32 = 0.005;
/// Steps of the search for a zero crossing.
const REFINEMENTS: u8 = 3;

/// A ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// World metres.
    pub origin: Vec3,
    /// Of unit length.
    pub direction: Vec3,
}

/// How unknown space counts for rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unseen {
    /// It ends them.
    Ends,
    /// They pass it.
    Passed,
    /// It is hit.
    Hit,
}

/// How a ray ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum RayState {
    Free = 1,
    Hit = 2,
    Unknown = 3,
}

/// What rays met, column by column.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RayAnswers {
    /// One [`RayState`] a ray, as its byte.
    pub state: Vec<u8>,
    /// Along the ray to where it was hit, m; NaN of others.
    pub distance_m: Vec<f32>,
    /// Of unit length, towards the ray's side; NaN where no surface was hit.
    pub normal: Vec<Vec3>,
    /// Along the ray to where it first left observed space, m; NaN where it did not.
    pub unknown_at_m: Vec<f32>,
}

impl RayAnswers {
    /// The answers to all rays, from those to the chunks that they were cut into.
    pub fn concatenate(parts: Vec<Self>) -> Self {
        let mut all = Self::default();
        for part in parts {
            all.state.extend(part.state);
            all.distance_m.extend(part.distance_m);
            all.normal.extend(part.normal);
            all.unknown_at_m.extend(part.unknown_at_m);
        }
        all
    }
}

/// A ray on its way.
struct Walk {
    /// The place that is asked next, m along the ray.
    t: f32,
    range_m: f32,
    /// The last known place before, and its distance, which is positive.
    last: Option<(f32, f32)>,
    /// The place behind the surface, with its distance, and how often it is still searched between.
    behind: Option<((f32, f32), u8)>,
    /// Where unknown space began that may still turn out to be a corner of a cell.
    unseen_since: Option<f32>,
    unknown_at: Option<f32>,
    end: Option<(RayState, f32)>,
}

impl Walk {
    fn new(range_m: f32) -> Self {
        Self {
            t: 0.0,
            range_m,
            last: None,
            behind: None,
            unseen_since: None,
            unknown_at: None,
            end: None,
        }
    }

    /// Takes in the distance at `t`.
    fn take(&mut self, d: f32, unseen: Unseen) {
        if let Some((behind, left)) = self.behind {
            self.search(behind, left, d);
        } else if d.is_nan() {
            self.last = None;
            self.pass_unknown(unseen);
        } else {
            self.unseen_since = None;
            if d > 0.0 {
                self.last = Some((self.t, d));
                self.go((d / STEEPEST).clamp(SHORTEST_M, LONGEST_M));
            } else if let Some((t, f)) = self.last {
                let behind = (self.t, d);
                self.behind = Some((behind, REFINEMENTS));
                self.t = t + (behind.0 - t) * f / (f - d);
            } else {
                self.end = Some((RayState::Hit, self.t));
            }
        }
    }

    fn pass_unknown(&mut self, unseen: Unseen) {
        let since = *self.unseen_since.get_or_insert(self.t);
        if self.t - since >= 0.99 * LOOK_M {
            self.unknown_at.get_or_insert(since);
            match unseen {
                Unseen::Ends => self.end = Some((RayState::Unknown, since)),
                Unseen::Hit => self.end = Some((RayState::Hit, since)),
                Unseen::Passed => {}
            }
        }
        self.go(LOOK_M);
    }

    fn go(&mut self, step_m: f32) {
        if self.end.is_some() {
            return;
        }
        if self.t >= self.range_m {
            self.end = Some((RayState::Free, self.range_m));
        }
        self.t = (self.t + step_m).min(self.range_m);
    }

    /// False position between the last place before the surface and the one behind it.
    fn search(&mut self, behind: (f32, f32), left: u8, d: f32) {
        let (mut before, mut behind) = (self.last.unwrap_or(behind), behind);
        if d > 0.0 {
            before = (self.t, d);
        } else if d <= 0.0 {
            behind = (self.t, d);
        }
        (self.last, self.behind) = (Some(before), Some((behind, left - 1)));
        let (a, b) = (before, behind);
        self.t = a.0 + (b.0 - a.0) * (a.1 / (a.1 - b.1)).clamp(0.0, 1.0);
        if left <= 1 || d.is_nan() {
            self.end = Some((RayState::Hit, self.t));
        }
    }
}

/// What rays of `range_m` meet; `None` if `is_left` says that nobody waits for them any more.
pub fn cast_rays(
    query: &impl PointQuery,
    rays: &[Ray],
    range_m: f32,
    unseen: Unseen,
    is_left: &dyn Fn() -> bool,
) -> Option<RayAnswers> {
    let mut walks: Vec<Walk> = rays.iter().map(|_| Walk::new(range_m)).collect();
    let mut active: Vec<usize> = (0..rays.len()).collect();
    let mut points = Vec::with_capacity(rays.len());
    while !active.is_empty() {
        if is_left() {
            return None;
        }
        points.clear();
        let place = |i: &usize| rays[*i].origin + rays[*i].direction * walks[*i].t;
        points.extend(active.iter().map(place));
        let distances = query(&points, Fields::DISTANCE).distance;
        for (&i, d) in active.iter().zip(distances) {
            walks[i].take(d, unseen);
        }
        active.retain(|&i| walks[i].end.is_none());
    }
    Some(answers(query, rays, &walks))
}

fn answers(query: &impl PointQuery, rays: &[Ray], walks: &[Walk]) -> RayAnswers {
    let mut answers = RayAnswers::default();
    let mut hits = Vec::new();
    for (i, walk) in walks.iter().enumerate() {
        let (state, t) = walk.end.unwrap_or((RayState::Free, walk.range_m));
        let is_hit = state == RayState::Hit;
        answers.state.push(state as u8);
        answers.distance_m.push(if is_hit { t } else { f32::NAN });
        answers.unknown_at_m.push(walk.unknown_at.unwrap_or(f32::NAN));
        answers.normal.push(Vec3::NAN);
        if is_hit {
            hits.push((i, rays[i].origin + rays[i].direction * t));
        }
    }
    let points: Vec<Vec3> = hits.iter().map(|(_, point)| *point).collect();
    let fields = Fields { gradient: true, ..Fields::NONE };
    let PointAnswers { gradient, .. } = query(&points, fields);
    for ((i, _), gradient) in hits.iter().zip(gradient) {
        if let Some(normal) = gradient.try_normalize() {
            let towards = normal.dot(rays[*i].direction) <= 0.0;
            answers.normal[*i] = if towards { normal } else { -normal };
        }
    }
    answers
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball of radius 1 around the origin; nobody saw anything beyond x = 3.
    fn ball(points: &[Vec3], fields: Fields) -> PointAnswers {
        let known = |p: &Vec3, d: f32| if p.x > 3.0 { f32::NAN } else { d };
        let of = |on: bool| if on { points } else { &[] };
        PointAnswers {
            distance: of(fields.distance).iter().map(|p| known(p, p.length() - 1.0)).collect(),
            gradient: of(fields.gradient).iter().map(|p| p.normalize()).collect(),
            ..PointAnswers::default()
        }
    }

    fn cast(origin: [f32; 3], direction: [f32; 3], unseen: Unseen) -> (u8, f32, f32, Vec3) {
        let ray = Ray { origin: Vec3::from(origin), direction: Vec3::from(direction).normalize() };
        let a = cast_rays(&ball, &[ray], 10.0, unseen, &|| false).expect("not left");
        (a.state[0], a.distance_m[0], a.unknown_at_m[0], a.normal[0])
    }

    #[test]
    fn rays_end_at_surfaces_at_their_range_and_where_nobody_looked() {
        let (state, distance, unknown, normal) =
            cast([-4.0, 0.0, 0.0], [2.0, 0.0, 0.0], Unseen::Ends);
        assert_eq!((state, unknown.is_nan()), (RayState::Hit as u8, true));
        assert!((distance - 3.0).abs() < 1e-4 && (normal + Vec3::X).length() < 1e-3, "{distance}");
        let (state, distance, ..) = cast([-4.0, 1.2, 0.0], [-1.0, 0.0, 0.0], Unseen::Ends);
        assert_eq!((state, distance.is_nan()), (RayState::Free as u8, true));
        let (state, _, unknown, _) = cast([0.0, 2.0, 0.0], [1.0, 0.0, 0.0], Unseen::Ends);
        assert!(state == RayState::Unknown as u8 && (3.0..3.11).contains(&unknown), "{unknown}");
        let (state, _, unknown, _) = cast([0.0, 2.0, 0.0], [1.0, 0.0, 0.0], Unseen::Passed);
        assert!(state == RayState::Free as u8 && (3.0..3.11).contains(&unknown), "{unknown}");
        let (state, distance, ..) = cast([4.0, 0.0, 0.0], [-1.0, 0.0, 0.0], Unseen::Passed);
        assert!(state == RayState::Hit as u8 && (distance - 3.0).abs() < 1e-4, "{distance}");
        let (state, distance, ..) = cast([4.0, 0.0, 0.0], [-1.0, 0.0, 0.0], Unseen::Hit);
        assert_eq!((state, distance), (RayState::Hit as u8, 0.0));
        let (state, distance, ..) = cast([0.2, 0.0, 0.0], [1.0, 0.0, 0.0], Unseen::Ends);
        assert_eq!((state, distance), (RayState::Hit as u8, 0.0), "it begins inside");
        // A grazing ray passes the ball by 3 mm, and one that cuts it by 3 mm does not.
        assert_eq!(
            cast([-4.0, 1.003, 0.0], [1.0, 0.0, 0.0], Unseen::Passed).0,
            RayState::Free as u8
        );
        assert_eq!(cast([-4.0, 0.997, 0.0], [1.0, 0.0, 0.0], Unseen::Ends).0, RayState::Hit as u8);
    }
}
