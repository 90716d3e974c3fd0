//! One entry point of a module as a pipeline, with its bindings.

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor,
    BindGroupLayoutEntry, BindingResource, BindingType, Buffer, BufferBindingType, ComputePass,
    ComputePipeline, ShaderModule, ShaderStages, StorageTextureAccess, TextureFormat, TextureViewDimension,
};

use crate::{Gpu, GpuError, source::Source};

/// What a binding of group 0 is; the place in the list is its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Binding {
    /// `var<storage, read>`.
    Read,
    /// `var<storage, read_write>`.
    Write,
    /// `var<uniform>`.
    Uniform,
    /// `texture_storage_2d<rgba32uint, read>`.
    Texels,
}

/// A pipeline and the layout of its bind group.
#[derive(Clone, Debug)]
pub(crate) struct Kernel {
    label: &'static str,
    layout: BindGroupLayout,
    pipeline: ComputePipeline,
}

/// Compiles a module, with `receiver` after it where there is one.
pub(crate) fn module(gpu: &Gpu, source: &Source, receiver: Option<&str>) -> Result<ShaderModule, GpuError> {
    module_of(gpu, source.name, format!("{}\n{}", source.text, receiver.unwrap_or_default()))
}

/// Compiles a module of this text.
pub(crate) fn module_of(gpu: &Gpu, name: &str, text: String) -> Result<ShaderModule, GpuError> {
    gpu.create(
        || format!("the module `{name}`"),
        |device| {
            device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(name),
                source: wgpu::ShaderSource::Wgsl(text.into()),
            })
        },
    )
}

impl Kernel {
    /// The entry point `label` of a module, with these values of its `override` constants.
    pub(crate) fn new(
        gpu: &Gpu,
        module: &ShaderModule,
        label: &'static str,
        bindings: &[Binding],
        constants: &[(&str, f64)],
    ) -> Result<Self, GpuError> {
        Self::with_groups(gpu, module, label, bindings, &[], constants)
    }

    /// The same with groups of others' from 1 on, which whoever dispatches it has to set.
    pub(crate) fn with_groups(
        gpu: &Gpu,
        module: &ShaderModule,
        label: &'static str,
        bindings: &[Binding],
        others: &[&BindGroupLayout],
        constants: &[(&str, f64)],
    ) -> Result<Self, GpuError> {
        let layout = layout_of(gpu, label, bindings)?;
        let layouts: Vec<_> = [&layout].into_iter().chain(others.iter().copied()).map(Some).collect();
        let pipeline = gpu.create(
            || format!("the kernel `{label}`"),
            |device| {
                let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                    label: Some(label),
                    bind_group_layouts: &layouts,
                    immediate_size: 0,
                });
                device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(label),
                    layout: Some(&pipeline_layout),
                    module,
                    entry_point: Some(label),
                    // Kernels write what they read of workgroup memory.
                    compilation_options: wgpu::PipelineCompilationOptions {
                        constants,
                        zero_initialize_workgroup_memory: false,
                    },
                    cache: None,
                })
            },
        )?;
        Ok(Self { label, layout, pipeline })
    }

    /// Binds these buffers, all of each, in the order of the bindings.
    pub(crate) fn bind(&self, gpu: &Gpu, buffers: &[&Buffer]) -> Result<BindGroup, GpuError> {
        bind(gpu, self.label, &self.layout, buffers)
    }

    /// Records so many workgroups; none at all for 0.
    pub(crate) fn dispatch(&self, pass: &mut ComputePass<'_>, group: &BindGroup, workgroups: u32) {
        if workgroups > 0 {
            let [x, y] = grid(workgroups);
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(x, y, 1);
        }
    }
}

impl Kernel {
    /// Records a grid of workgroups, for kernels that know their place in a picture.
    pub(crate) fn dispatch_grid(&self, pass: &mut ComputePass<'_>, group: &BindGroup, [x, y]: [u32; 2]) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.dispatch_workgroups(x, y, 1);
    }
}

/// At least so many workgroups in two dimensions, neither above WebGPU's 65535. Kernels number them row by
/// row (`workgroup_index` in `shaders/lib/grid.wgsl`) and leave alone what is beyond their input.
pub(crate) fn grid(workgroups: u32) -> [u32; 2] {
    let rows = workgroups.div_ceil(65535);
    [workgroups.div_ceil(rows.max(1)), rows]
}

/// The layout of a group with these bindings.
pub(crate) fn layout_of(gpu: &Gpu, label: &str, bindings: &[Binding]) -> Result<BindGroupLayout, GpuError> {
    let entries: Vec<_> = bindings.iter().zip(0..).map(|(kind, binding)| entry(binding, *kind)).collect();
    gpu.create(
        || format!("the layout of `{label}`"),
        |device| {
            device.create_bind_group_layout(&BindGroupLayoutDescriptor {
                label: Some(label),
                entries: &entries,
            })
        },
    )
}

/// Binds these buffers, all of each, in the order of the layout's bindings.
pub(crate) fn bind(
    gpu: &Gpu,
    label: &str,
    layout: &BindGroupLayout,
    buffers: &[&Buffer],
) -> Result<BindGroup, GpuError> {
    bind_all(gpu, label, layout, buffers.iter().map(|buffer| buffer.as_entire_binding()))
}

/// The same where not all are buffers.
pub(crate) fn bind_all<'a>(
    gpu: &Gpu,
    label: &str,
    layout: &BindGroupLayout,
    resources: impl IntoIterator<Item = BindingResource<'a>>,
) -> Result<BindGroup, GpuError> {
    let entries: Vec<_> = resources
        .into_iter()
        .zip(0..)
        .map(|(resource, binding)| BindGroupEntry { binding, resource })
        .collect();
    gpu.create(
        || format!("the bindings of `{label}`"),
        |device| {
            device.create_bind_group(&BindGroupDescriptor { label: Some(label), layout, entries: &entries })
        },
    )
}

fn entry(binding: u32, kind: Binding) -> BindGroupLayoutEntry {
    let buffer = |ty| BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let ty = match kind {
        Binding::Read => buffer(BufferBindingType::Storage { read_only: true }),
        Binding::Write => buffer(BufferBindingType::Storage { read_only: false }),
        Binding::Uniform => buffer(BufferBindingType::Uniform),
        Binding::Texels => BindingType::StorageTexture {
            access: StorageTextureAccess::ReadOnly,
            format: TextureFormat::Rgba32Uint,
            view_dimension: TextureViewDimension::D2,
        },
    };
    BindGroupLayoutEntry { binding, visibility: ShaderStages::COMPUTE, ty, count: None }
}

#[cfg(test)]
mod tests {
    use super::grid;

    #[test]
    fn grids_hold_all_workgroups() {
        for workgroups in [1, 2, 65535, 65536, 131_071, 10_000_019, u32::MAX / 4] {
            let [x, y] = grid(workgroups);
            assert!(x <= 65535 && y <= 65535 && u64::from(x) * u64::from(y) >= workgroups.into());
            assert!(u64::from(x) * u64::from(y - 1) < workgroups.into(), "no row too many");
        }
    }
}
