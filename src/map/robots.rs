//! Which robots have contributed to a map.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Robots that are told apart; what others saw is marked as theirs together.
const MAX_ROBOTS: usize = 1024;

/// Robots in the order of their first frames. A robot's place is its number in what it saw, for as long
/// as the map lives. Geometry that was given has a robot too: who gave it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Robots(Vec<String>);

impl Robots {
    /// How many are told apart.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The number of a robot, new ones included; `None` for one too many.
    pub(super) fn number(&mut self, robot_id: &str) -> Option<u16> {
        if let Some(number) = self.position(robot_id) {
            return Some(number);
        }
        let next = self.0.len();
        (next < MAX_ROBOTS).then(|| {
            self.0.push(robot_id.to_owned());
            next as u16
        })
    }

    /// The number of a robot that has contributed.
    pub(super) fn find(&self, robot_id: &str) -> Result<u16> {
        self.position(robot_id).ok_or_else(|| {
            let shown: String = robot_id.chars().take(64).collect();
            Error::NotFound { what: format!("robot_id: robot '{shown}' among those of the map") }
        })
    }

    fn position(&self, robot_id: &str) -> Option<u16> {
        self.0.iter().position(|id| id == robot_id).map(|number| number as u16)
    }

    /// Refuses a stored list that is longer than any that was written.
    pub(super) fn checked(self) -> Result<Self> {
        if self.0.len() > MAX_ROBOTS {
            return Err(Error::corrupt(
                "robots",
                format!("{} are more than {MAX_ROBOTS}", self.0.len()),
            ));
        }
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_robot_keeps_its_number_and_those_beyond_the_bound_have_none() {
        let mut robots = Robots::default();
        let numbers = ["a", "b", "a", "c"].map(|id| robots.number(id));
        assert_eq!(numbers, [0, 1, 0, 2].map(Some));
        for i in 0..2 * MAX_ROBOTS {
            robots.number(&format!("robot {i}"));
        }
        assert_eq!(["b", "late", "later"].map(|id| robots.number(id)), [Some(1), None, None]);
        assert_eq!(robots.find("c").expect("it was there"), 2);
        assert!(robots.find("late").is_err());
        assert_eq!(robots.clone().checked().expect("within the bound"), robots);
        robots.0.push("one more".into());
        assert!(robots.checked().is_err());
    }
}
