//! A compiled kernel. What it binds is read from its source, so that host and shader cannot
//! disagree about it.

use super::device::Gpu;
use super::shader::{self, Constant};
use crate::error::{Error, Result};

/// A compute pipeline and the names of what it binds, all in group 0.
#[derive(Debug)]
pub(super) struct Kernel {
    /// Its file under `shaders/`.
    pub(super) name: &'static str,
    /// The constants that it was compiled with.
    pub(super) variant: String,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    bindings: Vec<(String, u32)>,
}

/// A kernel with its buffers.
#[derive(Debug)]
pub(super) struct Bound<'k> {
    kernel: &'k Kernel,
    group: wgpu::BindGroup,
}

impl Kernel {
    /// Compiles a kernel with its constants.
    pub(super) fn new(
        gpu: &Gpu,
        name: &'static str,
        constants: &[(&str, Constant)],
    ) -> Result<Self> {
        let source = shader::source(name, constants)?;
        let wrong = |problem: String| Error::Internal(format!("shaders/{name}.wgsl: {problem}"));
        let module = naga::front::wgsl::parse_str(&source)
            .map_err(|e| wrong(e.emit_to_string_with_path(&source, name)))?;
        let mut bindings = Vec::new();
        let mut entries = Vec::new();
        for (_, variable) in module.global_variables.iter() {
            let (Some(binding), Some(name)) = (&variable.binding, &variable.name) else { continue };
            let ty = match variable.space {
                naga::AddressSpace::Uniform => wgpu::BufferBindingType::Uniform,
                naga::AddressSpace::Storage { access } => wgpu::BufferBindingType::Storage {
                    read_only: !access.contains(naga::StorageAccess::STORE),
                },
                space => return Err(wrong(format!("{name} is in {space:?}"))),
            };
            bindings.push((name.clone(), binding.binding));
            entries.push(wgpu::BindGroupLayoutEntry {
                binding: binding.binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer {
                    ty,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            });
        }
        let device = &gpu.device;
        let scope = device.push_error_scope(wgpu::ErrorFilter::Validation);
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(name),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(name),
            entries: &entries,
        });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(name),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(name),
            layout: Some(&pipeline_layout),
            module: &module,
            entry_point: Some("main"),
            compilation_options: wgpu::PipelineCompilationOptions {
                // Every kernel writes workgroup memory before it reads it.
                zero_initialize_workgroup_memory: false,
                ..wgpu::PipelineCompilationOptions::default()
            },
            cache: None,
        });
        match pollster::block_on(scope.pop()) {
            None => Ok(Self { name, variant: variant(constants), pipeline, layout, bindings }),
            Some(error) => Err(wrong(error.to_string())),
        }
    }

    /// Binds buffers by the names that the shader has for them.
    pub(super) fn bind(
        &self,
        gpu: &Gpu,
        buffers: &[(&str, wgpu::BindingResource<'_>)],
    ) -> Result<Bound<'_>> {
        let mut entries = Vec::with_capacity(self.bindings.len());
        for (name, binding) in &self.bindings {
            let Some((_, resource)) = buffers.iter().find(|(n, _)| n == name) else {
                return Err(Error::Internal(format!("{} has no buffer for {name}", self.name)));
            };
            entries.push(wgpu::BindGroupEntry { binding: *binding, resource: resource.clone() });
        }
        let group = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(self.name),
            layout: &self.layout,
            entries: &entries,
        });
        Ok(Bound { kernel: self, group })
    }
}

fn variant(constants: &[(&str, Constant)]) -> String {
    let text = |(name, value): &(&str, Constant)| match value {
        Constant::U32(value) => format!("{name} {value}"),
        Constant::F32(value) => format!("{name} {value}"),
    };
    constants.iter().map(text).collect::<Vec<_>>().join(", ").to_lowercase()
}

impl Bound<'_> {
    /// Adds a pass of `groups` workgroups.
    pub(super) fn dispatch(&self, passes: &mut super::passes::Passes, groups: u32) {
        self.dispatch_plane(passes, [groups, 1]);
    }

    /// Adds a pass of workgroups side by side.
    pub(super) fn dispatch_plane(
        &self,
        passes: &mut super::passes::Passes,
        [columns, rows]: [u32; 2],
    ) {
        if columns > 0 && rows > 0 {
            let mut pass = passes.begin(self.kernel.name);
            pass.set_pipeline(&self.kernel.pipeline);
            pass.set_bind_group(0, &self.group, &[]);
            pass.dispatch_workgroups(columns, rows, 1);
        }
    }
}
