//! Small things to read: frames of a few pixels, and a map of them.

use orenx::config::{BackendChoice, MapConfig, MapSettings};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::frame::{Contract, FeatureImage, Frame};
use orenx::map::Mapper;

/// The encoder of the features.
pub(super) const ENCODER: &str = "two";

/// A frame of a room, eight pixels wide, with colours and features of two numbers.
pub(super) fn frame(index: usize) -> Frame {
    let mut frame = Synthetic::room(100).with_width(8).load(index, true).unwrap();
    frame.seq = index as u64 + 1;
    frame.features = Some(FeatureImage {
        contract: Contract { encoder_id: ENCODER.into(), dimension: 2 },
        width: 2,
        height: 1,
        index: None,
        features: vec![1.0, 0.0, 0.6, 0.8],
    });
    frame
}

/// Settings of a map that is small in every respect.
pub(super) fn settings() -> MapSettings {
    MapSettings {
        r0_m: 1.0,
        steps: Some(1),
        backend: BackendChoice::Cpu,
        memory_mib: 64,
        color_spacing_m: 1.0,
        code_spacing_m: 1.0,
        dictionary_atoms: 2,
        ..MapSettings::default()
    }
}

/// A map of these settings and frames.
pub(super) fn map(settings: &MapSettings, frames: &[Frame]) -> Mapper {
    let mut mapper = Mapper::new(MapConfig::from_settings(settings).unwrap()).unwrap();
    for frame in frames {
        mapper.integrate(frame).unwrap();
    }
    mapper.publish_all().unwrap();
    mapper
}
