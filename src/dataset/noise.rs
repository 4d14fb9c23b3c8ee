//! Depth noise for experiments: the paper's two models (tab:noise_robustness) and a Kinect's.
//!
//! A pure function of (seed, frame, pixel), so that a noisy run can be repeated.

use std::fmt;
use std::str::FromStr;

use crate::error::{Error, Result};
use crate::frame::DepthImage;
use crate::geometry::random::{normal, pcg4d};

/// Keeps this stream of random numbers apart from the mapper's ("noise" in ASCII, four bytes).
const STREAM: u32 = 0x6e6f_6973;

/// The standard deviation of the noise that is added to a z-depth of z metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Noise {
    /// S, metres, whatever the depth: N(0, S²).
    Gaussian(f32),
    /// S·z: N(0, (S z)²), as the paper writes it.
    Axial(f32),
    /// S·(0.0012 + 0.0019 (z − 0.4)²) metres: the axial noise of a Kinect (Nguyen, Izadi and
    /// Lovell, 3DIMPVT 2012) times S, without its term for grazing angles.
    Kinect(f32),
}

impl Noise {
    /// The standard deviation at z-depth `z`, m.
    pub fn sigma_m(self, z: f32) -> f32 {
        match self {
            Self::Gaussian(s) => s,
            Self::Axial(s) => s * z,
            Self::Kinect(s) => s * (0.0012 + 0.0019 * (z - 0.4) * (z - 0.4)),
        }
    }

    /// Adds noise to every valid pixel. A depth that would leave the valid range becomes invalid.
    pub fn apply(self, depth: &mut DepthImage, seed: u32, frame: u32) {
        for (pixel, z) in depth.metres.iter_mut().enumerate() {
            if *z > 0.0 {
                let words = pcg4d([seed, frame, STREAM, pixel as u32]);
                *z += self.sigma_m(*z) * normal(words[0], words[1]);
            }
        }
        let metres = std::mem::take(&mut depth.metres);
        *depth = DepthImage::from_metres(depth.width, depth.height, metres);
    }
}

/// As it is parsed.
impl fmt::Display for Noise {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (model, scale) = match self {
            Self::Gaussian(scale) => ("gaussian", scale),
            Self::Axial(scale) => ("axial", scale),
            Self::Kinect(scale) => ("kinect", scale),
        };
        write!(f, "{model}:{scale}")
    }
}

impl FromStr for Noise {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let wrong = || {
            Error::invalid(
                "noise",
                format!("'{text}' must be gaussian:S (metres), axial:S (S·z) or kinect:S, S ≥ 0"),
            )
        };
        let (model, scale) = text.split_once(':').ok_or_else(wrong)?;
        let scale: f32 = scale.parse().map_err(|_| wrong())?;
        if !(0.0..=1e3).contains(&scale) {
            return Err(wrong());
        }
        match model {
            "gaussian" => Ok(Self::Gaussian(scale)),
            "axial" => Ok(Self::Axial(scale)),
            "kinect" => Ok(Self::Kinect(scale)),
            _ => Err(wrong()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noisy(noise: Noise, z: f32, seed: u32, frame: u32) -> DepthImage {
        let mut depth = DepthImage { width: 200, height: 100, metres: vec![z; 20_000] };
        depth.metres[7] = 0.0;
        noise.apply(&mut depth, seed, frame);
        depth
    }

    fn deviation(depth: &DepthImage, z: f32) -> f64 {
        let sum: f64 =
            depth.metres.iter().filter(|&&d| d > 0.0).map(|&d| f64::from(d - z).powi(2)).sum();
        (sum / depth.valid_pixels() as f64).sqrt()
    }

    #[test]
    fn deviations_follow_the_models() {
        for (noise, z, sigma) in [
            (Noise::Gaussian(0.02), 3.0, 0.02),
            (Noise::Axial(0.0057), 2.0, 0.0114),
            (Noise::Kinect(2.0), 2.4, 2.0 * (0.0012 + 0.0019 * 4.0)),
        ] {
            let measured = deviation(&noisy(noise, z, 3, 9), z);
            assert!((measured / sigma - 1.0).abs() < 0.03, "{noise:?}: {measured} for {sigma}");
        }
    }

    #[test]
    fn seed_and_frame_decide_and_invalid_pixels_stay() {
        let noise = Noise::Gaussian(0.01);
        assert_eq!(noisy(noise, 2.0, 1, 2), noisy(noise, 2.0, 1, 2));
        assert_ne!(noisy(noise, 2.0, 1, 2), noisy(noise, 2.0, 1, 3));
        assert_ne!(noisy(noise, 2.0, 1, 2), noisy(noise, 2.0, 2, 2));
        assert_eq!(noisy(noise, 2.0, 1, 2).metres[7], 0.0);
        assert!(
            noisy(Noise::Gaussian(5.0), 0.1, 1, 1)
                .metres
                .iter()
                .all(|&z| (0.0..=10.0).contains(&z))
        );
    }

    #[test]
    fn models_are_parsed() {
        assert_eq!("axial:0.0011".parse::<Noise>().expect("a model"), Noise::Axial(0.0011));
        for text in ["gaussian:0.05", "axial:0.0011", "kinect:2"] {
            assert_eq!(text.parse::<Noise>().expect(text).to_string(), text);
        }
        for text in ["axial", "gaussian:", "gaussian:-1", "gaussian:nan", "salt:1"] {
            assert!(text.parse::<Noise>().is_err(), "{text}");
        }
    }
}
