//! What can go wrong between a host and its device.

use core::fmt;

/// Why something was not created or not read back. What is recorded into a host's encoder cannot fail.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum GpuError {
    /// No adapter, hardware or software, was found; with what wgpu says about it.
    NoAdapter(String),
    /// There is an adapter, but it gave no device.
    NoDevice(String),
    /// The device was lost, or destroyed, before the results were there. Buffers and kernels made on it are
    /// gone with it: make them anew on another device.
    DeviceLost,
    /// A limit of the device is below what is needed.
    Limit {
        /// Its name, as wgpu has it.
        limit: &'static str,
        /// The least that will do.
        needed: u64,
        /// What the device has.
        available: u64,
    },
    /// The device has no memory for this.
    OutOfMemory {
        /// What was to be created.
        what: String,
    },
    /// More of something than was planned for when buffers were made.
    TooMany {
        /// Of what.
        what: &'static str,
        /// How many there are.
        count: u64,
        /// How many there may be.
        most: u64,
    },
    /// A number that is asked for is out of its range.
    Range {
        /// Which.
        what: &'static str,
        /// The number.
        count: u32,
        /// The least there may be.
        least: u32,
        /// The most.
        most: u32,
    },
    /// A parameter is out of its range.
    Parameter {
        /// Its name.
        name: &'static str,
        /// Its range, in words.
        range: &'static str,
    },
    /// The device refused something: WGSL of the host's that does not fit, or a fault of this crate; with
    /// what wgpu says about it.
    Refused {
        /// What was to be created or done.
        what: String,
        /// wgpu's own words.
        reason: String,
    },
}

impl fmt::Display for GpuError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoAdapter(reason) => write!(
                f,
                "no Vulkan adapter ({reason}); install a driver (Debian's software one: mesa-vulkan-drivers)"
            ),
            Self::NoDevice(reason) => write!(f, "the adapter gives no device: {reason}"),
            Self::DeviceLost => write!(f, "the device is lost; make kernels and buffers anew on another"),
            Self::Limit { limit, needed, available } => write!(
                f,
                "{limit} is {available} and has to be at least {needed}; ask for the device with that limit"
            ),
            Self::OutOfMemory { what } => write!(f, "no memory on the device for {what}"),
            Self::TooMany { what, count, most } => {
                write!(f, "{count} {what} where at most {most} were planned for; make larger buffers")
            }
            Self::Range { what, count, least, most } => {
                write!(f, "{count} {what}; ask for {least} to {most}")
            }
            Self::Parameter { name, range } => write!(f, "`{name}` is out of range; make it {range}"),
            Self::Refused { what, reason } => write!(f, "the device refuses {what}: {reason}"),
        }
    }
}

impl core::error::Error for GpuError {}
