//! All shaders compile, and mean the same by what they share with the host.

use super::super::sampling;
use super::super::shader::{self, Constant};

/// Every kernel, with constants that it can be compiled with.
fn kernels() -> Vec<(&'static str, Vec<(&'static str, Constant)>)> {
    let u = Constant::U32;
    let decoder = |inputs, first, second| {
        vec![
            ("INPUTS", u(inputs)),
            ("FIRST", u(first)),
            ("SECOND", u(second)),
            ("SCALE", Constant::F32(0.1)),
        ]
    };
    let distance = |first, second, points, occupancy| {
        let mut constants = decoder(16, first, second);
        constants.extend([("POINTS", u(points)), ("OCCUPANCY", u(occupancy))]);
        constants
    };
    vec![
        ("mirror/clear", vec![]),
        ("mirror/write", vec![("WORDS", u(4))]),
        ("optim/collect", vec![]),
        ("optim/decoder", vec![("LANE_QUADS", u(100))]),
        ("optim/rows", vec![]),
        ("optim/trim", vec![]),
        ("train/distance", distance(64, 64, 7, 1)),
        ("train/distance", distance(32, 0, 4, 0)),
        ("train/locate", vec![("POINTS", u(7))]),
        ("train/occupancy", decoder(8, 32, 0)),
        ("train/sample", sampling::constants().to_vec()),
    ]
}

#[test]
fn every_kernel_is_valid() {
    for (name, constants) in kernels() {
        let source = shader::source(name, &constants).expect("a source");
        let module = naga::front::wgsl::parse_str(&source)
            .map_err(|e| panic!("{}", e.emit_to_string_with_path(&source, name)))
            .expect("parses");
        let mut validator = naga::valid::Validator::new(
            naga::valid::ValidationFlags::all(),
            naga::valid::Capabilities::empty(),
        );
        validator
            .validate(&module)
            .map_err(|e| panic!("{name}: {}", e.emit_to_string(&source)))
            .expect("valid");
    }
}
