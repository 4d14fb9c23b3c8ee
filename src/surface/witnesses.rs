//! Who saw what: sets of robots, so that what only one of them saw can be taken back.
//!
//! Surfels, cells of evidence and vertices hold the number of a set, two bytes each. Sets are made as
//! they are needed, in a fixed order, and never change.

use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// The set of nobody.
pub(super) const NOBODY: u16 = 0;
/// Robots that are not told apart: too many, or of a file from before they were. Nobody's part of it
/// can be taken back.
pub(super) const MANY: u16 = 1;

/// At most this many sets, and robots of a set; beyond, it is [`MANY`].
const MAX_SETS: usize = 1 << 14;
const MAX_MEMBERS: usize = 16;
/// What a set becomes has not been asked yet.
const UNASKED: u16 = u16::MAX;

/// The sets of a map, and the robot whose frame is taken in.
#[derive(Debug)]
pub(super) struct Witnesses {
    /// The robots of each set, ascending.
    sets: Vec<Vec<u16>>,
    index: FxHashMap<Vec<u16>, u16>,
    /// Who looks; `None` for one of those that are not told apart.
    robot: Option<u16>,
    /// What each set becomes with that robot in it.
    joined: Vec<u16>,
}

/// Sets as a checkpoint holds them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WitnessSets(Vec<Vec<u16>>);

impl Default for Witnesses {
    fn default() -> Self {
        Self {
            sets: vec![Vec::new(); 2],
            index: FxHashMap::from_iter([(Vec::new(), NOBODY)]),
            robot: None,
            joined: vec![UNASKED; 2],
        }
    }
}

impl Witnesses {
    /// A robot looks, from now on.
    pub(super) fn look(&mut self, robot: Option<u16>) {
        self.robot = robot;
        self.joined.fill(UNASKED);
        self.joined[MANY as usize] = MANY;
    }

    /// The set that `set` becomes with the robot that looks in it.
    #[inline]
    pub(super) fn join(&mut self, set: u16) -> u16 {
        match self.joined[set as usize] {
            UNASKED => self.ask(set),
            joined => joined,
        }
    }

    #[cold]
    fn ask(&mut self, set: u16) -> u16 {
        let joined = match self.robot {
            None => MANY,
            Some(robot) => {
                let mut members = self.sets[set as usize].clone();
                if let Err(place) = members.binary_search(&robot) {
                    members.insert(place, robot);
                }
                self.number(members)
            }
        };
        self.joined[set as usize] = joined;
        joined
    }

    /// What is left of every set without a robot.
    pub(super) fn without(&mut self, robot: u16) -> Vec<u16> {
        let mut left: Vec<u16> = (0..self.sets.len() as u16).collect();
        for set in &mut left {
            let members = &self.sets[*set as usize];
            if members.binary_search(&robot).is_ok() {
                *set = self.number(members.iter().copied().filter(|m| *m != robot).collect());
            }
        }
        left
    }

    /// Nothing is left of any set.
    pub(super) fn nobody(&self) -> Vec<u16> {
        vec![NOBODY; self.sets.len()]
    }

    fn number(&mut self, members: Vec<u16>) -> u16 {
        if let Some(&set) = self.index.get(&members) {
            return set;
        }
        if self.sets.len() >= MAX_SETS || members.len() > MAX_MEMBERS {
            return MANY;
        }
        let set = self.sets.len() as u16;
        self.index.insert(members.clone(), set);
        self.sets.push(members);
        self.joined.push(UNASKED);
        set
    }

    /// Everything that [`Witnesses::with_state`] needs.
    pub(super) fn state(&self) -> WitnessSets {
        WitnessSets(self.sets.clone())
    }

    /// Takes up stored sets, which the numbers of `columns` must name.
    pub(super) fn with_state(
        state: WitnessSets,
        columns: impl IntoIterator<Item = u16>,
    ) -> Result<Self> {
        let damaged = || Error::corrupt("witnesses", "sets and columns do not fit together");
        let WitnessSets(sets) = state;
        let is_set = |set: &Vec<u16>| set.len() <= MAX_MEMBERS && set.is_sorted_by(|a, b| a < b);
        if !(2..=MAX_SETS).contains(&sets.len()) || !sets.iter().all(is_set) {
            return Err(damaged());
        }
        let named = sets.iter().enumerate().filter(|(number, _)| *number as u16 != MANY);
        let index: FxHashMap<_, _> = named.map(|(n, set)| (set.clone(), n as u16)).collect();
        if index.len() + 1 != sets.len() || index.get(&[][..]) != Some(&NOBODY) {
            return Err(damaged());
        }
        if columns.into_iter().any(|set| set as usize >= sets.len()) {
            return Err(damaged());
        }
        Ok(Self { joined: vec![UNASKED; sets.len()], sets, index, robot: None })
    }
}

impl WitnessSets {
    /// The sets of a file from before there were any, and the number of the one that saw everything:
    /// the only robot, if there was no other.
    pub fn of_old_file(has_one_robot: bool) -> (Self, u16) {
        let (nobody, many, first) = (Vec::new(), Vec::new(), vec![0]);
        (Self(vec![nobody, many, first]), if has_one_robot { 2 } else { MANY })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen_by(witnesses: &mut Witnesses, robots: &[u16]) -> u16 {
        robots.iter().fold(NOBODY, |set, robot| {
            witnesses.look(Some(*robot));
            witnesses.join(set)
        })
    }

    #[test]
    fn sets_grow_by_who_looks_and_shrink_by_who_is_taken_back() {
        let mut witnesses = Witnesses::default();
        let (a, ab, b) = (
            seen_by(&mut witnesses, &[7]),
            seen_by(&mut witnesses, &[7, 3]),
            seen_by(&mut witnesses, &[3]),
        );
        assert_eq!(seen_by(&mut witnesses, &[3, 7, 3]), ab, "whoever came first");
        assert!(a != b && b != ab);
        let left = witnesses.without(7);
        let after = [NOBODY, MANY, a, ab, b].map(|set| left[set as usize]);
        assert_eq!(after, [NOBODY, MANY, NOBODY, b, b]);
    }

    #[test]
    fn too_many_are_not_told_apart() {
        let mut witnesses = Witnesses::default();
        let robots: Vec<u16> = (0..MAX_MEMBERS as u16 + 1).collect();
        let most = seen_by(&mut witnesses, &robots[1..]);
        assert_ne!(most, MANY);
        assert_eq!(seen_by(&mut witnesses, &robots), MANY);
        witnesses.look(None);
        assert_eq!((witnesses.join(NOBODY), witnesses.join(most)), (MANY, MANY));
        for robot in 0..u16::MAX / 2 {
            seen_by(&mut witnesses, &[robot]);
        }
        assert!(witnesses.sets.len() <= MAX_SETS);
    }

    #[test]
    fn sets_come_back_from_a_file_and_damage_is_noticed() {
        let mut witnesses = Witnesses::default();
        let ab = seen_by(&mut witnesses, &[0, 1]);
        let mut again = Witnesses::with_state(witnesses.state(), [ab, MANY]).expect("whole");
        assert_eq!(seen_by(&mut again, &[1, 0]), ab);
        assert!(Witnesses::with_state(witnesses.state(), [99]).is_err());
        for sets in [vec![], vec![vec![]; 3], vec![vec![], vec![], vec![2, 1]]] {
            assert!(Witnesses::with_state(WitnessSets(sets), []).is_err());
        }
    }
}
