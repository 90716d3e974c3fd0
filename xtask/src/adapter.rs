//! The Vulkan adapter that tests of kernels need: found, installed, or said to be missing.

use std::process::Command;

use render_gpu::{Gpu, GpuError};

use crate::failure::Failure;

/// Set where a missing adapter is a failure, as in CI. The tests themselves look at it, too.
const REQUIRED: &str = "LIGHTTREE_REQUIRE_GPU";

/// Mesa's software driver and the loader, as Debian calls them.
const PACKAGES: [&str; 2] = ["mesa-vulkan-drivers", "libvulkan1"];

/// What tests of kernels will run on.
pub(crate) enum Adapter {
    /// They run on this one.
    Found(String),
    /// They skip, for this reason.
    Missing(String),
}

/// Looks for an adapter, and installs Mesa's software driver where there is none and this may be done: as
/// root on a machine with apt.
///
/// # Errors
/// Where an adapter is required and there is none.
pub(crate) fn find() -> Result<Adapter, Failure> {
    let name = || Gpu::request().map(|gpu| gpu.device().adapter_info().name);
    let found = match name() {
        Err(GpuError::NoAdapter(_)) if install() => name(),
        found => found,
    };
    match found {
        Ok(name) => Ok(Adapter::Found(name)),
        Err(error) if std::env::var_os(REQUIRED).is_some() => {
            Err(Failure::failed(format!("{REQUIRED} is set, and there is {error}")))
        }
        Err(error) => Ok(Adapter::Missing(error.to_string())),
    }
}

/// Whether the driver was installed just now.
fn install() -> bool {
    let is_root = Command::new("id").arg("-u").output().is_ok_and(|id| id.stdout.trim_ascii() == b"0");
    if !is_root {
        return false;
    }
    eprintln!("no Vulkan adapter: installing {}", PACKAGES.join(" and "));
    let apt = |args: &[&str]| {
        let status = Command::new("apt-get").args(args).env("DEBIAN_FRONTEND", "noninteractive").status();
        status.is_ok_and(|status| status.success())
    };
    let install = ["install", "-qy", "--no-install-recommends", PACKAGES[0], PACKAGES[1]];
    apt(&install) || apt(&["update", "-q"]) && apt(&install)
}

impl Adapter {
    /// A line for people, told before the tests and after them.
    pub(crate) fn for_people(&self) -> String {
        match self {
            Self::Found(name) => format!("kernels: tested on {name}"),
            Self::Missing(why) => {
                format!(
                    "kernels: SKIPPED, nothing of them was tested: {why} ({REQUIRED}=1 makes this a failure)"
                )
            }
        }
    }
}
