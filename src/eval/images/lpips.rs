//! LPIPS: the perceptual distance of Zhang et al. (2018), by a network that the user brings.

use std::path::Path;

use super::pixels::Pair;
use crate::encoder::{Network, Tensor};
use crate::error::{Error, Result};

/// A network of two images, 1 × 3 × height × width in RGB within -1..1, ours first, whose first output
/// is one number: what `lpips.LPIPS` of the package of that name becomes when it is exported.
pub struct Lpips {
    name: String,
    network: Network,
}

impl Lpips {
    /// Reads an ONNX file.
    pub fn load(path: &Path) -> Result<Self> {
        let (name, network) = (path.display().to_string(), Network::load(path)?);
        if network.inputs() != 2 {
            let problem = format!("LPIPS takes 2 images, this network {}", network.inputs());
            return Err(Error::invalid(name, problem));
        }
        Ok(Self { name, network })
    }

    pub(super) fn distance(&self, pair: &Pair<'_>) -> Result<f64> {
        let image = |rgb: &[u8]| {
            let plane = |c| rgb.iter().skip(c).step_by(3).map(|&v| f32::from(v) / 127.5 - 1.0);
            let values = (0..3).flat_map(plane).collect();
            Tensor { shape: vec![1, 3, pair.height, pair.width], values }
        };
        let output = self.network.run(vec![image(pair.ours), image(pair.truth)])?;
        match output.values[..] {
            [distance] => Ok(f64::from(distance)),
            _ => {
                let problem = format!("gives an array {:?} where one number is", output.shape);
                Err(Error::invalid(self.name.as_str(), problem))
            }
        }
    }
}

#[cfg(feature = "onnx")]
#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoder::onnx_bytes::mean_difference;

    #[test]
    fn images_reach_the_network_plane_by_plane_within_their_range() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), mean_difference()).expect("written");
        let lpips = Lpips::load(file.path()).expect("a network");
        let z = [0.0; 2];
        let (black, white) = ([0; 6], [255; 6]);
        let distance = |ours: &[u8], truth: &[u8]| {
            let pair = Pair { width: 2, height: 1, ours, depth_m: &z, truth, truth_depth_m: &z };
            lpips.distance(&pair).expect("it runs")
        };
        assert_eq!(distance(&white, &white), 0.0);
        assert!((distance(&black, &white) - 2.0).abs() < 1e-6, "from -1 to 1");
        let mut one = black;
        one[4] = 255;
        assert!((distance(&one, &black) - 2.0 / 6.0).abs() < 1e-6);
    }
}
