//! The tree of frames that TF tells, over the last seconds: where a camera was at a moment.

use std::collections::{BTreeMap, VecDeque};

use crate::geometry::Pose;
use crate::wire::ros2::Stamped;

/// Frames that are remembered at a time.
const MAX_FRAMES: usize = 1024;
/// Moments of one frame: ten seconds at 400 Hz.
const MAX_MOMENTS: usize = 4096;
/// How long moments are remembered, ns.
const MEMORY_NS: i64 = 10_000_000_000;
/// How deep a tree may be; a longer way is a circle.
const MAX_DEPTH: usize = 64;

/// Why there is no pose.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum NoPose {
    /// Time will tell: a transform as new as the question is still to come, or the first one is.
    Yet(String),
    /// Never: it is older than what is remembered.
    Gone(String),
}

impl NoPose {
    pub(super) fn problem(&self) -> &str {
        match self {
            Self::Yet(problem) | Self::Gone(problem) => problem,
        }
    }
}

/// How a frame stands in its parent.
struct Edge {
    parent: String,
    motion: Motion,
}

enum Motion {
    Still(Pose),
    /// By time, Unix ns; never empty.
    Moving(VecDeque<(i64, Pose)>),
}

/// The edges by their child.
#[derive(Default)]
pub(super) struct Tree {
    edges: BTreeMap<String, Edge>,
}

impl Tree {
    /// Takes a transform; false if there is no room for one more frame. One of another parent than
    /// before begins anew, and so does one that lies further back than is remembered.
    pub(super) fn take(&mut self, stamped: Stamped, is_still: bool) -> bool {
        let Stamped { parent, child, stamp_ns, pose } = stamped;
        if self.edges.len() >= MAX_FRAMES && !self.edges.contains_key(&child) {
            return false;
        }
        if is_still {
            self.edges.insert(child, Edge { parent, motion: Motion::Still(pose) });
            return true;
        }
        let moments = match self.edges.get_mut(&child) {
            Some(Edge { parent: same, motion: Motion::Moving(moments) }) if *same == parent => {
                moments
            }
            _ => {
                let motion = Motion::Moving(VecDeque::from([(stamp_ns, pose)]));
                self.edges.insert(child, Edge { parent, motion });
                return true;
            }
        };
        let mut newest = moments.back().map_or(stamp_ns, |last| last.0);
        if newest.saturating_sub(stamp_ns) > MEMORY_NS {
            moments.clear();
            newest = stamp_ns;
        }
        let at = moments.partition_point(|moment| moment.0 < stamp_ns);
        match moments.get_mut(at) {
            Some(moment) if moment.0 == stamp_ns => moment.1 = pose,
            _ => moments.insert(at, (stamp_ns, pose)),
        }
        let newest = newest.max(stamp_ns);
        while moments.len() > MAX_MOMENTS
            || moments.front().is_some_and(|first| newest.saturating_sub(first.0) > MEMORY_NS)
        {
            moments.pop_front();
        }
        true
    }

    /// Forgets everything that moves.
    pub(super) fn restart(&mut self) {
        self.edges.retain(|_, edge| matches!(edge.motion, Motion::Still(_)));
    }

    /// p_target = pose · p_source at a moment. What moves is interpolated between the moments around
    /// it, never beyond them.
    pub(super) fn pose(&self, target: &str, source: &str, stamp_ns: i64) -> Result<Pose, NoPose> {
        let (up, down) = (self.way(source)?, self.way(target)?);
        // The nearest frame that both stand in.
        let meeting = up
            .iter()
            .find_map(|frame| down.iter().position(|other| other == frame).map(|at| (*frame, at)));
        let Some((meeting, at)) = meeting else {
            return Err(NoPose::Yet(format!("nothing connects '{source}' with '{target}'")));
        };
        let above_source = self.chain(up.iter().take_while(|f| **f != meeting), stamp_ns)?;
        let above_target = self.chain(down[..at].iter(), stamp_ns)?;
        Ok(match (above_target, above_source) {
            (None, None) => Pose::IDENTITY,
            (None, Some(pose)) => pose,
            (Some(pose), None) => pose.inverse(),
            (Some(target), Some(source)) => after(&target.inverse(), &source),
        })
    }

    /// A frame and all that it stands in, up to the root.
    fn way<'a>(&'a self, frame: &'a str) -> Result<Vec<&'a str>, NoPose> {
        let mut way = vec![frame];
        let mut at = frame;
        while let Some(edge) = self.edges.get(at) {
            at = &edge.parent;
            if way.len() > MAX_DEPTH || way.contains(&at) {
                return Err(NoPose::Yet(format!("the frames above '{frame}' are no tree")));
            }
            way.push(at);
        }
        Ok(way)
    }

    /// The product of the edges above `frames`, each of which stands in the next; `None` for none of
    /// them, so that one edge alone keeps every bit.
    fn chain<'a>(
        &self,
        frames: impl Iterator<Item = &'a &'a str>,
        stamp_ns: i64,
    ) -> Result<Option<Pose>, NoPose> {
        let mut product = None;
        for child in frames {
            let Some(edge) = self.edges.get(*child) else { continue };
            let pose = edge.motion.at(stamp_ns).map_err(|no| no.named(child, &edge.parent))?;
            product = Some(product.map_or(pose, |below| after(&pose, &below)));
        }
        Ok(product)
    }
}

impl NoPose {
    fn named(self, child: &str, parent: &str) -> Self {
        let named = |problem: String| format!("'{child}' in '{parent}': {problem}");
        match self {
            Self::Yet(problem) => Self::Yet(named(problem)),
            Self::Gone(problem) => Self::Gone(named(problem)),
        }
    }
}

impl Motion {
    fn at(&self, stamp_ns: i64) -> Result<Pose, NoPose> {
        let moments = match self {
            Self::Still(pose) => return Ok(*pose),
            Self::Moving(moments) => moments,
        };
        let seconds = |ns: i64| ns as f64 * 1e-9;
        let after = moments.partition_point(|moment| moment.0 < stamp_ns);
        let Some((late_ns, late)) = moments.get(after) else {
            let behind = moments.back().map_or(0, |last| stamp_ns.saturating_sub(last.0));
            return Err(NoPose::Yet(format!(
                "the newest transform is {:.3} s older than the image",
                seconds(behind)
            )));
        };
        if *late_ns == stamp_ns {
            return Ok(*late);
        }
        let Some((early_ns, early)) = after.checked_sub(1).and_then(|at| moments.get(at)) else {
            return Err(NoPose::Gone(format!(
                "the oldest transform is {:.3} s newer than the image",
                seconds(late_ns.saturating_sub(stamp_ns))
            )));
        };
        let share = (stamp_ns - early_ns) as f64 / (late_ns - early_ns) as f64;
        Ok(Pose {
            rotation: early.rotation.slerp(late.rotation, share).normalize(),
            translation: early.translation.lerp(late.translation, share),
        })
    }
}

/// First `inner`, then `outer`.
fn after(outer: &Pose, inner: &Pose) -> Pose {
    Pose {
        rotation: (outer.rotation * inner.rotation).normalize(),
        translation: outer.transform(inner.translation),
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;

    const S: i64 = 1_000_000_000;

    fn edge(parent: &str, child: &str, stamp_ns: i64, pose: Pose) -> Stamped {
        Stamped { parent: parent.into(), child: child.into(), stamp_ns, pose }
    }

    /// A turn by 0.5 rad/s and a drive by 1 m/s.
    fn drive(stamp_ns: i64) -> Pose {
        let t = stamp_ns as f64 * 1e-9;
        Pose { rotation: DQuat::from_rotation_z(0.5 * t), translation: DVec3::new(t, 2.0, 0.0) }
    }

    fn mount() -> Pose {
        let rotation = DQuat::from_euler(glam::EulerRot::ZYX, -1.5, 0.0, -1.5);
        Pose { rotation, translation: DVec3::new(0.2, 0.0, 1.1) }
    }

    fn close(a: &Pose, b: &Pose) -> bool {
        a.translation.distance(b.translation) < 1e-9 && a.rotation.angle_between(b.rotation) < 1e-6
    }

    #[test]
    fn motion_is_interpolated_along_the_arc() {
        let mut tree = Tree::default();
        // Out of order, and one of them twice.
        for stamp in [0, 200, 100, 300, 300] {
            let stamp = stamp * S / 1000;
            assert!(tree.take(edge("map", "base", stamp, drive(stamp)), false));
        }
        assert!(tree.take(edge("base", "camera", 0, mount()), true));
        for stamp in [0, 1, 50, 149, 200, 300] {
            let stamp = stamp * S / 1000;
            let pose = tree.pose("map", "camera", stamp).expect("known");
            assert!(close(&pose, &after(&drive(stamp), &mount())), "{stamp}");
            let back = tree.pose("camera", "map", stamp).expect("known");
            assert!(close(&back, &pose.inverse()), "{stamp}");
        }
        // One edge alone keeps every bit.
        assert_eq!(tree.pose("map", "base", 0).expect("known"), drive(0));
        assert_eq!(tree.pose("map", "map", 5 * S).expect("itself"), Pose::IDENTITY);
    }

    #[test]
    fn nothing_is_guessed() {
        let mut tree = Tree::default();
        let yet = |no: NoPose| matches!(no, NoPose::Yet(_));
        assert!(yet(tree.pose("map", "camera", 0).expect_err("empty")));
        tree.take(edge("map", "base", S, drive(S)), false);
        tree.take(edge("map", "base", 2 * S, drive(2 * S)), false);
        let late = tree.pose("map", "base", 2 * S + S / 4).expect_err("not yet");
        assert!(late.problem().contains("0.250 s older than the image"), "{late:?}");
        assert!(yet(late));
        let early = tree.pose("map", "base", S / 2).expect_err("gone");
        assert!(early.problem().contains("0.500 s newer than the image"), "{early:?}");
        assert!(!yet(early));
        assert!(yet(tree.pose("map", "camera", S).expect_err("not connected")));
    }

    #[test]
    fn siblings_meet_in_their_parent_and_circles_end() {
        let mut tree = Tree::default();
        tree.take(edge("base", "left", 0, mount()), true);
        tree.take(edge("base", "right", 0, drive(S)), true);
        let pose = tree.pose("left", "right", 0).expect("siblings");
        assert!(close(&after(&mount(), &pose), &drive(S)));
        tree.take(edge("right", "base", 0, mount()), true);
        let circle = tree.pose("map", "left", 0).expect_err("a circle");
        assert!(circle.problem().contains("no tree"), "{circle:?}");
    }

    #[test]
    fn memory_is_bounded_in_time_moments_and_frames() {
        let mut tree = Tree::default();
        for i in 0..2 * MAX_MOMENTS as i64 {
            tree.take(edge("map", "base", i * 1000, drive(i)), false);
        }
        let moments = |tree: &Tree| match &tree.edges["base"].motion {
            Motion::Moving(moments) => moments.len(),
            Motion::Still(_) => 0,
        };
        assert_eq!(moments(&tree), MAX_MOMENTS);
        tree.take(edge("map", "base", 60 * S, drive(0)), false);
        assert_eq!(moments(&tree), 1);
        // A clock that went back.
        tree.take(edge("map", "base", S, drive(0)), false);
        assert_eq!(moments(&tree), 1);
        for i in 0..MAX_FRAMES {
            tree.take(edge("map", &format!("frame {i}"), 0, drive(0)), false);
        }
        assert_eq!(tree.edges.len(), MAX_FRAMES);
        assert!(!tree.take(edge("map", "one more", 0, drive(0)), true));
        tree.restart();
        assert!(tree.edges.is_empty());
    }
}
