//! What a host may do to its device, and what it gets.

mod common;
#[path = "../examples/own_frame.rs"]
#[allow(dead_code, unreachable_pub, reason = "an example: its `main` is not called")]
mod own_frame;

use common::device;
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

/// Every limit that kernels need, one at a time just below what they need.
#[test]
fn every_limit_is_named_where_it_is_too_small() {
    let _ = gpu_or_skip!();
    macro_rules! too_small {
        ($($limit:ident: $has:expr;)+) => {$(
            let limits = wgpu::Limits { $limit: $has, ..required_limits() };
            let (small, queue) = device(limits).expect("less than the default");
            let error = Gpu::new(&small, &queue).unwrap_err();
            let line = error.to_string();
            assert!(
                matches!(error, GpuError::Limit { limit: stringify!($limit), available, .. } if available == u64::from($has)),
                "{line}"
            );
            assert!(line.contains(stringify!($limit)), "{line}");
        )+};
    }
    too_small! {
        max_storage_buffers_per_shader_stage: 7u32;
        max_storage_textures_per_shader_stage: 1u32;
        max_uniform_buffers_per_shader_stage: 1u32;
        max_bind_groups: 3u32;
        max_compute_workgroup_storage_size: 16_368u32;
        max_compute_invocations_per_workgroup: 255u32;
        max_compute_workgroup_size_x: 255u32;
        max_compute_workgroups_per_dimension: 65_534u32;
        max_storage_buffer_binding_size: (1u64 << 20) - 4;
    }
    // And just what they need will do.
    let limits = wgpu::Limits { max_storage_buffer_binding_size: 1 << 20, ..required_limits() };
    let (device, queue) = device(limits).expect("less than the default");
    assert!(Gpu::new(&device, &queue).is_ok());
    // A buffer that no limit admits is refused by the limit's name.
    let gpu = Gpu::request().unwrap();
    let error = gpu.buffer("large", 1 << 40, wgpu::BufferUsages::empty()).unwrap_err();
    assert!(
        matches!(
            error,
            GpuError::Limit { limit: "max_storage_buffer_binding_size", needed: 0x100_0000_0000, .. }
        ),
        "{error}"
    );
}

/// Set where the test below runs in a process of little memory.
const LITTLE_MEMORY: &str = "LIGHTTREE_TEST_LITTLE_MEMORY";

/// A device whose memory is used up says so, names what it was for, and goes on with what fits.
#[test]
fn memory_that_runs_out_is_an_error_and_no_more() {
    let shared = gpu_or_skip!();
    // A software driver's memory is the process's, which then has to be one of its own with little of it;
    // others are asked to refuse what goes beyond a part of theirs.
    let is_software = shared.device().adapter_info().device_type == wgpu::DeviceType::Cpu;
    if is_software && cfg!(unix) && std::env::var_os(LITTLE_MEMORY).is_none() {
        let this = std::env::current_exe().unwrap();
        let line =
            "ulimit -v 6000000; exec \"$0\" --exact memory_that_runs_out_is_an_error_and_no_more --nocapture";
        let mut child = std::process::Command::new("sh");
        let child = child.args(["-c", line]).arg(this).env(LITTLE_MEMORY, "1").output().unwrap();
        let stderr = String::from_utf8_lossy(&child.stderr);
        assert!(child.status.success(), "{stderr}");
        assert!(stderr.contains("refused after"), "{stderr}");
        return;
    }
    let part = if is_software { None } else { Some(3) };
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        memory_budget_thresholds: wgpu::MemoryBudgetThresholds {
            for_resource_creation: part,
            for_device_loss: None,
        },
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let options = wgpu::RequestAdapterOptions::default();
    let adapter = pollster::block_on(instance.request_adapter(&options)).unwrap();
    let descriptor = wgpu::DeviceDescriptor { required_limits: required_limits(), ..Default::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).unwrap();
    let gpu = Gpu::new(&device, &queue).unwrap();
    let kernels = TreeKernels::new(&gpu).unwrap();
    let mut held = vec![];
    let error = loop {
        match gpu.buffer("lights", 128 << 20, wgpu::BufferUsages::empty()) {
            Ok(lights) => held.push(lights),
            Err(error) => break error,
        }
        if held.len() == 512 {
            return eprintln!("SKIPPED: {} has no end of memory", device.adapter_info().name);
        }
    };
    eprintln!("refused after {} buffers", held.len());
    assert_eq!(error, GpuError::OutOfMemory { what: "`lights`, 134217728 bytes".to_owned() });
    drop(held);
    gpu.wait().unwrap();
    let light = LightRecord { intensity: 1.0, ..LightRecord::default() };
    let lights = gpu.upload("lights", &[light; 100]).unwrap();
    let tree = DeviceTree::new(&gpu, &kernels, &lights, Sort::Radix).unwrap();
    gpu.run("build", |encoder| tree.encode_build(encoder)).unwrap();
    assert_eq!(gpu.read::<TreeHeader>(tree.header(), 1).unwrap()[0].len, 100);
}

/// The device is lost between two frames: what is recorded does not panic, what waits says so, and another
/// device does.
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
