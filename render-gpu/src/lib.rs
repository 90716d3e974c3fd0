//! Light trees and many-light sampling on a GPU, for a renderer that has its own.
//!
//! Lin and Yuksel, "Real-Time Stochastic Lightcuts", 2020, sections 3 and 4, as wgpu compute kernels: the device, the encoder, the
//! buffers of lights and of points to be lit are the host's. The references are `lighttree` and `stochastic`, on the CPU: the same tree to the
//! bit, and the same random numbers.
//!
//! # Conventions
//! Those of [`lighttree`], and:
//! - **Limits.** WebGPU's defaults are enough ([`required_limits`]), and no feature is needed. Workgroups have at most 256 threads.
//! - **A frame** is recorded into the host's encoder. Nothing is submitted, nothing read back, nothing allocated, and nothing can fail.
//! - **Creating** kernels and buffers can: [`GpuError`] says what was refused, and the device stays as good as it was.
//! - **WGSL** is plain files, one after the other ([`source`]); records are the same bytes on both sides ([`records`]).
//! - **Numbers.** WGSL has no f64 and may assume that there is no NaN. Where the CPU asks f64 a kernel takes what is safe: a light that might contribute is
//!   never impossible. So a walk on a device differs from one on the CPU now and then, where two probabilities differ in the last bits; both are right.

pub mod cdf;
pub mod draw;
mod error;
pub mod filter;
mod gpu;
mod kernel;
pub mod rays;
mod receiver;
pub mod records;
pub mod shade;
pub mod source;
mod stages;
mod transfer;
pub mod tree;
pub mod two_level;

pub use error::GpuError;
pub use gpu::{Gpu, required_limits};
pub use receiver::{DEFAULT_RECEIVER, ReceiverRecord};
pub use stages::StageTimes;
