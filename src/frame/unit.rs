//! Depth in the wrong unit: millimetres taken for metres, or the other way round.

use super::MAX_DEPTH_M;
use crate::error::{Error, Fault, Result};

/// Half of the returns beyond this say that depth is too large, m: no depth camera looks so far.
const FAR_M: f32 = 100.0;
/// Half of the returns below this say that depth is too small, m: no depth camera sees so close.
const CLOSE_M: f32 = 0.01;
/// A room in thousandths of its size lies below this, m.
const SHRUNK_M: f32 = 0.02;
/// One return in so many may be an outlier.
const OUTLIERS: usize = 100;
/// Fewer returns say nothing, nor does a smaller part of the image than one in so many.
const MIN_RETURNS: usize = 100;
const MIN_SHARE: usize = 100;

/// Refuses depth that is off by about a thousand. `metres` are all pixels of an image, as they came:
/// before what lies beyond [`MAX_DEPTH_M`] is taken out. `field` says what is to be mended.
///
/// The whole image decides, and only where it leaves no doubt: a plausible scene is never refused.
/// Too large means that half of the returns lie beyond 100 m *and* next to none within the range
/// that a map believes, so that nothing is lost; too small, that half lie within a centimetre and
/// next to none beyond two.
pub fn check_unit(field: &str, metres: impl ExactSizeIterator<Item = f32>) -> Result<()> {
    let pixels = metres.len();
    let (mut returns, mut usable, mut far, mut close, mut visible) = (0u32, 0u32, 0u32, 0u32, 0u32);
    // Without branches, which let the compiler count several pixels at a time: this is done for every
    // frame. What is not a number fails every comparison.
    for z in metres {
        let (some, finite) = (z > 0.0, z < f32::INFINITY);
        returns += u32::from(some & finite);
        usable += u32::from(some & (z <= MAX_DEPTH_M));
        far += u32::from((z > FAR_M) & finite);
        close += u32::from(some & (z < CLOSE_M));
        visible += u32::from((z > SHRUNK_M) & finite);
    }
    let [returns, usable, far, close, visible] =
        [returns, usable, far, close, visible].map(|count| count as usize);
    let is_rare = |count: usize| count * OUTLIERS < returns;
    if returns < MIN_RETURNS || returns * MIN_SHARE < pixels {
        return Ok(());
    }
    if far * 2 > returns && is_rare(usable) {
        return Err(Error::frame(
            Fault::DepthUnit,
            field,
            format!(
                "{far} of {returns} returns lie beyond {FAR_M} m and {usable} within {MAX_DEPTH_M} \
                 m: is depth in thousandths of what is said?"
            ),
        ));
    }
    if close * 2 > returns && is_rare(visible) {
        return Err(Error::frame(
            Fault::DepthUnit,
            field,
            format!(
                "{close} of {returns} returns lie within {CLOSE_M} m and {visible} beyond \
                 {SHRUNK_M} m: is depth a thousand times of what is said?"
            ),
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn check(metres: &[f32], scale: f32) -> Result<()> {
        check_unit("depth.units_per_metre", metres.iter().map(|z| z * scale))
    }

    /// A scene with depths between two bounds, some pixels without a return and some that are wild.
    fn scenes() -> impl Strategy<Value = Vec<f32>> {
        (0.15f32..2.0, 1.2f32..6.0).prop_flat_map(|(near, ratio)| {
            let pixel = prop_oneof![
                5 => near..near * ratio,
                1 => Just(0.0f32),
                1 => Just(f32::NAN),
            ];
            let wild = prop::collection::vec(0.001f32..500.0, 0..5);
            (prop::collection::vec(pixel, 1500), wild)
                .prop_map(|(scene, wild)| [wild, scene].concat())
        })
    }

    proptest! {
        #[test]
        fn a_thousand_is_noticed_in_both_directions_and_a_good_scene_passes(scene in scenes()) {
            prop_assert!(check(&scene, 1.0).is_ok());
            for scale in [1000.0, 0.001] {
                let error = check(&scene, scale).expect_err("off by a thousand");
                prop_assert_eq!(error.field(), Some("depth.units_per_metre"));
            }
        }
    }

    #[test]
    fn strange_but_plausible_scenes_pass() {
        for (name, scene) in [
            ("nothing at all", vec![0.0; 1000]),
            ("the sky, and a pole", [vec![f32::INFINITY; 900], vec![2.0; 100]].concat()),
            ("a landscape with some ground", [vec![400.0; 900], vec![5.0; 100]].concat()),
            ("a few wild pixels", [vec![0.0; 1000], vec![900.0; 99]].concat()),
            ("something on the lens, and a room", [vec![0.005; 900], vec![2.0; 100]].concat()),
            ("an object in the gripper", vec![0.04; 1000]),
            ("a corridor", (0..1000u16).map(|i| 0.5 + f32::from(i) * 0.06).collect()),
        ] {
            check(&scene, 1.0).expect(name);
        }
        check_unit("depth.data", std::iter::empty()).expect("no image");
    }
}
