//! Shaders of images compile, and mean the same by what they share with the host. What they draw is
//! compared with their twin, the CPU's tile renderer, in `map/render`.

use super::layout;
use crate::backend::gpu::shader;

const RULES: super::Rules = super::Rules {
    half_diagonal: 0.9,
    learned_m: 0.02,
    nearest_m: 1e-3,
    slack: 0.02,
    touch: 1e-4,
    least_direction: 1e-9,
    least_weight: 2e-3,
    refinements: 2,
    rim: 1e-4,
    beside_m: 0.1,
    beside_weight: 0.2,
    block: 4,
    shortest_m: 0.05,
    step_m: 0.1,
};

fn parsed(name: &str) -> naga::Module {
    let source = shader::source(name, &RULES.constants(name)).expect("a source");
    naga::front::wgsl::parse_str(&source)
        .map_err(|e| panic!("{}", e.emit_to_string_with_path(&source, name)))
        .expect("parses")
}

#[test]
fn every_kernel_is_valid() {
    for name in super::KERNELS {
        let module = parsed(name);
        let mut validator = naga::valid::Validator::new(
            naga::valid::ValidationFlags::all(),
            naga::valid::Capabilities::empty(),
        );
        validator.validate(&module).map_err(|e| panic!("{name}: {e:?}")).expect("valid");
    }
}

/// A struct's members and their offsets, and its size.
#[test]
fn structs_lie_as_the_hosts() {
    let layout_of = |kernel: &str, name: &str| {
        let module = parsed(kernel);
        let found = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some(name));
        let (_, ty) = found.unwrap_or_else(|| panic!("no struct {name}"));
        let naga::TypeInner::Struct { members, span } = &ty.inner else { panic!("no struct") };
        let member =
            |m: &naga::StructMember| (m.name.clone().unwrap_or_default(), m.offset as usize);
        (members.iter().map(member).collect::<Vec<_>>(), *span as usize)
    };
    macro_rules! same {
        ($host:ident, $kernel:literal, $($member:ident),*) => {
            let expected = vec![
                $((stringify!($member).to_owned(), std::mem::offset_of!(layout::$host, $member))),*
            ];
            let found = layout_of($kernel, stringify!($host));
            assert_eq!(found, (expected, size_of::<layout::$host>()), stringify!($host));
        };
    }
    same!(
        Scene,
        "render/list",
        nodes,
        rows,
        room,
        surface_log2,
        light_m,
        cell_m,
        band_scale,
        band_log2,
        inputs,
        first,
        second,
        scale,
        cube_room,
        fine_log2,
        largest_log2,
        cell_log2,
        harmonics
    );
    same!(Node, "render/list", low, size, brick, block, padding);
    same!(Cube, "render/list", low, log2_size, host_low, host_log2, block, leaf, padding);
    same!(
        View,
        "render/draw",
        eye,
        sharpness,
        x_axis,
        width,
        y_axis,
        height,
        z_axis,
        columns,
        camera,
        eye_cell,
        tiles,
        cubes,
        room,
        midpoint,
        color_at,
        normal_at,
        depth_at,
        opacity_at,
        unit_m
    );
}

/// What shaders have as numbers of their own.
#[test]
fn constants_are_the_hosts() {
    use crate::modality::radiance::{HARMONIC_SCALE, Texel};
    use naga::{Expression, Literal};

    let module = parsed("render/draw");
    let value = |name: &str| {
        let constant = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name));
        let (_, constant) = constant.unwrap_or_else(|| panic!("no constant {name}"));
        match module.global_expressions[constant.init] {
            Expression::Literal(Literal::U32(x)) => f64::from(x),
            Expression::Literal(Literal::F32(x)) => f64::from(x),
            ref other => panic!("{name} is {other:?}"),
        }
    };
    assert_eq!(value("PIXELS"), f64::from(super::PIXELS));
    assert_eq!(value("HARMONIC_STEPS"), f64::from(HARMONIC_SCALE));
    // One unit of a logit.
    let words: [u32; 2] = bytemuck::cast(Texel::new(Some(glam::Vec3::ONE), None));
    assert_eq!(value("LOGIT_STEPS"), f64::from(words[0] & 0xffff));
}
