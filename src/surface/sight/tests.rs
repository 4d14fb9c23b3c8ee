//! Places in front of, at and behind what one frame sees.

use super::*;
use crate::surface::test_frame::frame;

/// A place `z` in front of the camera, in the middle of its image.
fn ahead(z: f32) -> Vec3 {
    Vec3::new(1.0 + z, 2.0, 3.0)
}

fn judge(frame: &Frame) -> impl Fn(f32) -> Option<bool> {
    let noise = DepthNoise::estimate(&frame.depth);
    move |z| Sight::new(frame, &noise).through(ahead(z), 0.05)
}

#[test]
fn a_wall_is_seen_through_before_it_hit_at_it_and_silent_behind_it() {
    let wall = frame(150.0, |_, _| 2.0);
    let through = judge(&wall);
    assert_eq!(through(0.5), Some(true));
    assert_eq!(through(1.94), Some(true), "more than the margin in front");
    for z in [1.96, 2.0, 2.04] {
        assert_eq!(through(z), Some(false), "{z} is within the margin");
    }
    assert_eq!(through(2.06), None, "behind it anything may be");
    assert_eq!(through(-1.0), None, "behind the camera");
}

#[test]
fn one_near_return_beside_the_pixel_speaks_against_seeing_through() {
    let clear = frame(150.0, |_, _| 3.0);
    assert_eq!(judge(&clear)(1.0), Some(true));
    // The pixel of the place is (79, 59) or (80, 60), as rounding goes: all around is near.
    let post =
        frame(
            150.0,
            |u, _| if (77..=78).contains(&u) || (81..=82).contains(&u) { 1.0 } else { 3.0 },
        );
    assert_eq!(judge(&post)(1.0), Some(false), "an edge says nothing about what is beside it");
    let hole =
        frame(150.0, |u, v| if (70..90).contains(&u) && (50..70).contains(&v) { 0.0 } else { 3.0 });
    assert_eq!(judge(&hole)(1.0), None, "no return, no verdict");
}

#[test]
fn noise_widens_the_margin() {
    // ± 5 cm in a checkerboard of pixel pairs, which the estimate takes for noise.
    let noisy = frame(150.0, |u, v| if (u / 2 + v / 2) % 2 == 0 { 2.05 } else { 1.95 });
    let through = judge(&noisy);
    assert_eq!(through(1.8), Some(false), "within three deviations of the depth");
    assert_eq!(through(1.2), Some(true));
}
