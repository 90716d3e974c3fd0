//! What a host may do to its device, and what it gets.

mod common;
#[path = "../examples/own_frame.rs"]
#[allow(dead_code, unreachable_pub, reason = "an example: its `main` is not called")]
mod own_frame;

use lighttree::WeightedLight;
use render_gpu::draw::{DrawKernels, Draws, Method};
use render_gpu::records::{LightRecord, TreeHeader};
use render_gpu::tree::{DeviceTree, Sort, TreeKernels};
use render_gpu::{Gpu, GpuError, ReceiverRecord, required_limits};

#[test]
fn a_host_with_its_own_frame_sees_all_lights() {
    let gpu = gpu_or_skip!();
    let (mean, truth) = own_frame::run(gpu.device(), gpu.queue(), 6).unwrap();
    assert!((mean - truth).abs() < 0.02 * truth, "{mean}, not {truth}");
}

/// A device with these limits, of the adapter that tests share.
fn device(limits: wgpu::Limits) -> Option<(wgpu::Device, wgpu::Queue)> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter =
        pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).ok()?;
    let descriptor = wgpu::DeviceDescriptor { required_limits: limits, ..Default::default() };
    pollster::block_on(adapter.request_device(&descriptor)).ok()
}

#[test]
fn limits_that_are_too_small_are_named() {
    let _ = gpu_or_skip!();
    let small = [
        (
            "max_compute_workgroup_storage_size",
            wgpu::Limits { max_compute_workgroup_storage_size: 8192, ..required_limits() },
            8192,
        ),
        (
            "max_compute_invocations_per_workgroup",
            wgpu::Limits { max_compute_invocations_per_workgroup: 128, ..required_limits() },
            128,
        ),
        (
            "max_storage_buffers_per_shader_stage",
            wgpu::Limits { max_storage_buffers_per_shader_stage: 4, ..required_limits() },
            4,
        ),
    ];
    for (name, limits, has) in small {
        let (device, queue) = device(limits).expect("less than the default");
        let error = Gpu::new(&device, &queue).unwrap_err();
        assert!(
            matches!(error, GpuError::Limit { limit, available, .. } if limit == name && available == has),
            "{error}"
        );
    }
    // Where a binding holds little, so does a tree.
    let limits = wgpu::Limits { max_storage_buffer_binding_size: 1 << 20, ..required_limits() };
    let (device, queue) = device(limits).expect("less than the default");
    let gpu = Gpu::new(&device, &queue).unwrap();
    let kernels = TreeKernels::new(&gpu).unwrap();
    let tree = |lights: u64| {
        let buffer = gpu.buffer("lights", 32 * lights, wgpu::BufferUsages::empty()).unwrap();
        DeviceTree::new(&gpu, &kernels, &buffer, Sort::Radix)
    };
    assert!(tree(16_000).is_ok());
    let error = tree(17_000).unwrap_err();
    assert!(matches!(error, GpuError::Limit { limit: "max_storage_buffer_binding_size", .. }), "{error}");
    assert!(tree(16_000).is_ok(), "a refusal leaves the device as good as it was");
}

/// The device is lost between two frames: what is recorded does not panic, what waits says so, and another device does.
#[test]
fn a_lost_device_is_said_to_be_lost() {
    let _ = gpu_or_skip!();
    let frame = |gpu: &Gpu, lose: bool| -> Result<TreeHeader, GpuError> {
        let lights: Vec<_> = (0..100)
            .map(|i| LightRecord { min: [i as f32; 3], intensity: 1.0, max: [i as f32; 3], user: 0 })
            .collect();
        let buffer = gpu.upload("lights", &lights)?;
        let kernels = TreeKernels::new(gpu)?;
        let tree = DeviceTree::new(gpu, &kernels, &buffer, Sort::Radix)?;
        let receivers = gpu.upload("receivers", &[ReceiverRecord::NONE; 10])?;
        let drawn = gpu.upload("drawn", &[WeightedLight::NONE; 10])?;
        let draws = DrawKernels::new(gpu)?;
        let draws = Draws::new(gpu, &draws, &tree, Method::Tree { lights: 1 }, &receivers, 48, &drawn)?;
        if lose {
            gpu.device().destroy();
        }
        gpu.run("frame", |encoder| {
            tree.encode_build(encoder);
            draws.encode(encoder);
        })?;
        Ok(gpu.read(tree.header(), 1)?[0])
    };
    let gpu = Gpu::request().unwrap();
    assert_eq!(frame(&gpu, true).unwrap_err(), GpuError::DeviceLost);
    assert_eq!(frame(&gpu, false).unwrap_err(), GpuError::DeviceLost, "and stays lost");
    let other = Gpu::request().unwrap();
    assert_eq!(frame(&other, false).map(|header| header.len), Ok(100));
}
