//! Which robots have contributed to a map.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Robots that are told apart; what others saw is marked as theirs together.
const MAX_ROBOTS: usize = 1024;

/// Robots in the order of their first frames. A robot's place is its number in the surfels that it
/// saw first, for as long as the map lives.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Robots(Vec<String>);

impl Robots {
    /// The number of a robot, new ones included; [`MAX_ROBOTS`] for one too many.
    pub(super) fn number(&mut self, robot_id: &str) -> u32 {
        if let Some(number) = self.0.iter().position(|id| id == robot_id) {
            return number as u32;
        }
        let next = self.0.len();
        if next < MAX_ROBOTS {
            self.0.push(robot_id.to_owned());
        }
        next as u32
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
    fn a_robot_keeps_its_number_and_those_beyond_the_bound_share_one() {
        let mut robots = Robots::default();
        assert_eq!(["a", "b", "a", "c"].map(|id| robots.number(id)), [0, 1, 0, 2]);
        for i in 0..2 * MAX_ROBOTS {
            robots.number(&format!("robot {i}"));
        }
        assert_eq!(["b", "late", "later"].map(|id| robots.number(id)), [1, 1024, 1024]);
        assert_eq!(robots.clone().checked().expect("within the bound"), robots);
        robots.0.push("one more".into());
        assert!(robots.checked().is_err());
    }
}
