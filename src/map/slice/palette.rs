//! Colours: a diverging map whose lightness falls evenly on both sides of zero.

/// 8-bit sRGB.
pub(super) type Rgb = [u8; 3];

pub(super) const PAPER: Rgb = [255, 255, 255];
pub(super) const INK: Rgb = [38, 40, 46];
pub(super) const FAINT_INK: Rgb = [110, 114, 122];
/// Unknown space: stripes on a ground, neither of which the colour map has.
pub(super) const UNKNOWN_GROUND: Rgb = [226, 226, 222];
pub(super) const UNKNOWN_STRIPE: Rgb = [190, 190, 184];

/// Hue angles in OKLCh, rad: blue for free space, red behind surfaces.
const POSITIVE_HUE: f32 = 4.45;
const NEGATIVE_HUE: f32 = 0.50;

/// The colour at `t` in −1..=1 (clamped): 0 is nearly white, 1 a deep blue, −1 a deep red.
pub(super) fn diverging(t: f32) -> Rgb {
    let hue = if t < 0.0 { NEGATIVE_HUE } else { POSITIVE_HUE };
    let t = t.abs().min(1.0);
    let lightness = 0.975 - 0.60 * t;
    // Most colourful where sRGB has the room for it, so that nothing is clipped.
    let chroma = 0.165 * (std::f32::consts::PI * (0.04 + 0.70 * t)).sin() * t.powf(0.35);
    oklch(lightness, chroma, hue)
}

/// OKLCh to sRGB (Ottosson, "A perceptual color space for image processing", 2020).
fn oklch(lightness: f32, chroma: f32, hue: f32) -> Rgb {
    let (a, b) = (chroma * hue.cos(), chroma * hue.sin());
    let l = (lightness + 0.396_337_78 * a + 0.215_803_76 * b).powi(3);
    let m = (lightness - 0.105_561_346 * a - 0.063_854_17 * b).powi(3);
    let s = (lightness - 0.089_484_18 * a - 1.291_485_5 * b).powi(3);
    [
        4.076_741_7 * l - 3.307_711_6 * m + 0.230_969_94 * s,
        -1.268_438 * l + 2.609_757_4 * m - 0.341_319_38 * s,
        -0.004_196_086_3 * l - 0.703_418_6 * m + 1.707_614_7 * s,
    ]
    .map(gamma)
}

fn gamma(linear: f32) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let value =
        if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (value * 255.0).round() as u8
}

/// `over` laid on `under` with `alpha`.
pub(super) fn blend(under: Rgb, over: Rgb, alpha: f32) -> Rgb {
    let mix = |i: usize| {
        let (a, b) = (f32::from(under[i]), f32::from(over[i]));
        (a + (b - a) * alpha).round() as u8
    };
    [mix(0), mix(1), mix(2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rec. 709 luma: good enough to order colours by lightness.
    fn luma([r, g, b]: Rgb) -> f32 {
        0.2126 * f32::from(r) + 0.7152 * f32::from(g) + 0.0722 * f32::from(b)
    }

    #[test]
    fn zero_is_nearly_white_and_both_sides_darken() {
        assert!(diverging(0.0).iter().all(|&c| c > 240));
        for side in [1.0, -1.0] {
            let ramp: Vec<f32> =
                (0..=20).map(|i| luma(diverging(side * i as f32 / 20.0))).collect();
            assert!(ramp.windows(2).all(|w| w[1] < w[0]), "{ramp:?}");
        }
        let ([r, _, b], [pr, _, pb]) = (diverging(-0.7), diverging(0.7));
        assert!(r > b && pb > pr);
        assert_eq!(diverging(5.0), diverging(1.0));
    }

    #[test]
    fn blending_runs_from_one_to_the_other() {
        assert_eq!(blend(PAPER, INK, 0.0), PAPER);
        assert_eq!(blend(PAPER, INK, 1.0), INK);
        assert_eq!(blend([0; 3], [100; 3], 0.5), [50; 3]);
    }
}
