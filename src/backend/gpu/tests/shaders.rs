//! All shaders compile, and mean the same by what they share with the host.

use super::super::shader::{self, Constant};
use super::super::{layout, radiance, sampling};
use crate::octree::GRADIENT_SHARE;
use crate::surface::RIM_SHARE;
use crate::train::SampleKind;

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
        ("optim/collect_colors", vec![("VERTICES", u(64))]),
        ("optim/colors", vec![]),
        ("optim/decoder", vec![("LANE_QUADS", u(100))]),
        ("optim/rows", vec![]),
        ("optim/trim", vec![]),
        ("train/colors", radiance::compare_constants().to_vec()),
        ("train/distance", distance(64, 64, 7, 1)),
        ("train/distance", distance(32, 0, 4, 0)),
        ("train/field", decoder(16, 64, 64)),
        ("train/locate", vec![("POINTS", u(7))]),
        ("train/march", radiance::march_constants(0).to_vec()),
        ("train/march", radiance::march_constants(1).to_vec()),
        ("train/occupancy", decoder(8, 32, 0)),
        ("train/rays", sampling::label_constants().to_vec()),
        ("train/sample", sampling::constants()),
        ("train/scan", vec![]),
        ("train/sharpen", decoder(16, 32, 0)),
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

fn parsed(name: &str, constants: &[(&str, Constant)]) -> naga::Module {
    let source = shader::source(name, constants).expect("a source");
    naga::front::wgsl::parse_str(&source).expect("parses")
}

/// Numbers that both sides have must be the same numbers.
#[test]
fn constants_are_the_hosts() {
    use crate::backend::cpu::adam;
    use crate::modality::{OCCUPANCY_FEATURES, SDF_FEATURES, losses, occupancy, sdf};
    use naga::{Expression, Literal};

    let modules =
        [parsed("optim/rows", &[]), parsed("train/colors", &radiance::compare_constants())];
    let value = |name: &str| {
        let has = |module: &&naga::Module| {
            module.constants.iter().any(|(_, c)| c.name.as_deref() == Some(name))
        };
        let module = modules.iter().find(has).unwrap_or_else(|| panic!("no constant {name}"));
        let named = |c: &(_, &naga::Constant)| c.1.name.as_deref() == Some(name);
        let (_, constant) = module.constants.iter().find(named).expect("it has it");
        match module.global_expressions[constant.init] {
            Expression::Literal(Literal::U32(x)) => f64::from(x),
            Expression::Literal(Literal::F32(x)) => f64::from(x),
            Expression::Literal(Literal::AbstractFloat(x)) => x,
            ref other => panic!("{name} is {other:?}"),
        }
    };
    let log2 = |beta: f32| f64::from(beta).log2();
    for (name, host) in [
        ("SDF_FEATURES", SDF_FEATURES as f64),
        ("OCCUPANCY_FEATURES", OCCUPANCY_FEATURES as f64),
        ("ROW_QUADS", layout::ROW_QUADS as f64),
        ("OCCUPANCY_QUAD", SDF_FEATURES as f64 / 4.0),
        ("EXPLICIT_QUAD", (SDF_FEATURES + OCCUPANCY_FEATURES) as f64 / 4.0),
        ("NONE", layout::NONE.into()),
        ("LOSSES", layout::LOSSES as f64),
        ("STENCIL_POINTS", losses::Stencil::MAX as f64),
        ("STENCIL_M", losses::STENCIL_M.into()),
        ("GRADIENT_SHARE", GRADIENT_SHARE.into()),
        ("RIM_SHARE", RIM_SHARE.into()),
        ("CONFIDENT_LOGIT", losses::CONFIDENT_LOGIT.into()),
        ("SAFE_NORM", losses::SAFE_NORM.into()),
        ("CONTEXT_LIMIT_M", sdf::CONTEXT_LIMIT_M.into()),
        ("SURFACE_LOGIT", occupancy::SURFACE_LOGIT.into()),
        ("OCCUPANCY_WIDTH_M", occupancy::WIDTH_M.into()),
        ("PRIOR_LIMIT", occupancy::PRIOR_LIMIT.into()),
        ("FREE", f64::from(SampleKind::Free as u8)),
        ("PERTURBED", f64::from(SampleKind::Perturbed as u8)),
        ("SURFACE", f64::from(SampleKind::Surface as u8)),
        ("BETA1", adam::BETA1.into()),
        ("BETA2", adam::BETA2.into()),
        ("EPSILON", adam::EPSILON.into()),
        ("LOG2_BETA1", log2(adam::BETA1)),
        ("LOG2_BETA2", log2(adam::BETA2)),
        ("COLOR_MARGIN", crate::modality::radiance::MARGIN.into()),
        ("LIGHT_REACH", crate::modality::density::REACH.into()),
        ("LOSS_UNITS", radiance::LOSS_UNITS),
    ] {
        let found = value(name);
        assert!((found - host).abs() <= 1e-5 * host.abs(), "{name}: {found}, not {host}");
    }
}

/// A struct's members and their offsets, and its size.
fn layout_of(modules: &[naga::Module], name: &str) -> (Vec<(String, usize)>, usize) {
    let mut types = modules.iter().flat_map(|module| module.types.iter());
    let found = types.find(|(_, ty)| ty.name.as_deref() == Some(name));
    let (_, ty) = found.unwrap_or_else(|| panic!("no struct {name}"));
    let naga::TypeInner::Struct { members, span } = &ty.inner else { panic!("no struct") };
    let member = |m: &naga::StructMember| (m.name.clone().unwrap_or_default(), m.offset as usize);
    (members.iter().map(member).collect(), *span as usize)
}

#[test]
fn structs_lie_as_the_hosts() {
    let modules = [
        parsed("train/sample", &sampling::constants()),
        parsed("train/march", &radiance::march_constants(1)),
    ];
    macro_rules! same {
        ($host:ty, $name:literal, $($member:ident),*) => {
            let expected =
                vec![$((stringify!($member).to_owned(), std::mem::offset_of!($host, $member))),*];
            assert_eq!(layout_of(&modules, $name), (expected, size_of::<$host>()), $name);
        };
    }
    same!(
        layout::Step,
        "Step",
        root_min,
        root_node,
        unit_m,
        root_log2,
        rows,
        samples,
        distance_weights,
        occupancy_weight,
        eikonal_weights,
        consistency_weight,
        rate,
        occupancy_rate,
        decoder_rate,
        gradient_scale
    );
    same!(
        layout::Draw,
        "Draw",
        rays,
        frames,
        seed,
        counter,
        eikonal_share,
        cell_m,
        inverse_cell,
        radius_m,
        stale_m
    );
    same!(layout::Frame, "Frame", origin, first, x_axis, pixels, y_axis, z_axis, camera, gain);
    same!(layout::Sample, "Sample", point, distance, occupancy, kind, eikonal, padding);
    same!(layout::Site, "Site", centre, around, padding);
    same!(layout::Ray, "Ray", origin, z, direction, points, color, first);
    same!(layout::RayPoint, "RayPoint", place, t, f, by_f, ends, voxel);
    same!(
        layout::Radiance,
        "Radiance",
        rays,
        room,
        surface_log2,
        sharpness,
        reach_m,
        weight,
        rate,
        units,
        log2_side,
        vertices_per_m,
        harmonics
    );
}
