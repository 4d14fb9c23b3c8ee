//! Numbers in one argument, with commas between them.

use glam::Vec3;

use crate::geometry::Aabb;

/// As many numbers as `names` names, as in `x,y,z`; all finite.
pub(super) fn numbers<const N: usize>(text: &str, names: &str) -> Result<[f32; N], String> {
    let numbers: Vec<f32> = text
        .split(',')
        .map(|part| part.trim().parse().map_err(|_| format!("'{part}' is not a number")))
        .collect::<Result<_, _>>()?;
    let given = numbers.len();
    let numbers: [f32; N] =
        numbers.try_into().map_err(|_| format!("needs {N} numbers {names}; {given} given"))?;
    match numbers.iter().all(|n| n.is_finite()) {
        true => Ok(numbers),
        false => Err("must be finite".to_owned()),
    }
}

/// A point, m.
pub(super) fn parse_point(text: &str) -> Result<Vec3, String> {
    numbers(text, "x,y,z").map(Vec3::from_array)
}

/// A box by two opposite corners, m.
pub(super) fn parse_box(text: &str) -> Result<Aabb, String> {
    let [a, b, c, d, e, f] = numbers(text, "x,y,z,x,y,z")?;
    let (one, other) = (Vec3::new(a, b, c), Vec3::new(d, e, f));
    Ok(Aabb { min: one.min(other), max: one.max(other) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_parsed_or_refused_with_the_reason() {
        assert_eq!(parse_point("1,-2.5, 3e-1"), Ok(Vec3::new(1.0, -2.5, 0.3)));
        for (text, reason) in [
            ("1,2", "needs 3 numbers x,y,z; 2"),
            ("1,2,x", "'x'"),
            ("1,2,nan", "finite"),
            ("", "''"),
        ] {
            let error = parse_point(text).expect_err(text);
            assert!(error.contains(reason), "{error}");
        }
    }

    #[test]
    fn boxes_are_parsed_or_refused_with_the_reason() {
        let region = parse_box("1,-1,0, 0,2,1").expect("a box");
        assert_eq!((region.min, region.max), (Vec3::new(0.0, -1.0, 0.0), Vec3::new(1.0, 2.0, 1.0)));
        for (text, reason) in [("1,2,3", "6 numbers"), ("a,0,0,1,1,1", "'a'")] {
            let error = parse_box(text).expect_err(text);
            assert!(error.contains(reason), "{error}");
        }
    }
}
