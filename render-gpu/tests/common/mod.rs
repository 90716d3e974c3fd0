//! The adapter that all tests of one program share.

#![allow(dead_code, unreachable_pub, reason = "each test program uses a part")]

pub mod scenes;

use std::sync::LazyLock;

use render_gpu::{Gpu, GpuError};

/// Set where a missing adapter is a failure, as in CI; elsewhere tests that need one say on stderr that they
/// are skipped.
pub const REQUIRED: &str = "LIGHTTREE_REQUIRE_GPU";

static GPU: LazyLock<Result<Gpu, GpuError>> = LazyLock::new(Gpu::request);

/// The adapter; `None`, said on stderr, where there is none and none is required.
pub fn gpu() -> Option<&'static Gpu> {
    match &*GPU {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os(REQUIRED).is_some() => {
            panic!("{REQUIRED} is set, and there is {error}")
        }
        Err(error) => {
            eprintln!("SKIPPED: {error}");
            None
        }
    }
}

/// A device with these limits, of the adapter that tests share.
pub fn device(limits: wgpu::Limits) -> Option<(wgpu::Device, wgpu::Queue)> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter =
        pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).ok()?;
    let descriptor = wgpu::DeviceDescriptor { required_limits: limits, ..Default::default() };
    pollster::block_on(adapter.request_device(&descriptor)).ok()
}

/// Ends a test that has no adapter.
#[macro_export]
macro_rules! gpu_or_skip {
    () => {
        match common::gpu() {
            Some(gpu) => gpu,
            None => return,
        }
    };
}
