//! Peak memory of building a perfect tree over ten million lights. Alone in its program, so that nobody else
//! allocates.

use glam::Vec3;
use lighttree::rng::pcg4d;
use lighttree::{Emitter, LightBounds, MortonBits, PerfectTree};

/// A light that is nothing but its index: the builder's memory is all there is.
struct Computed(u32);

impl Emitter for Computed {
    fn bounds(&self) -> LightBounds {
        let [x, y, z, _] = pcg4d([self.0, 0, 0, 0]).map(|word| (word >> 8) as f32);
        LightBounds::point(Vec3::new(x, y, z), 1.0)
    }
}

/// Kilobytes from the kernel's account of this process.
fn account(key: &str) -> Option<usize> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with(key))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

#[test]
fn ten_million_lights_take_at_most_1_3_gb() {
    let count = 10_000_000;
    let lights: Vec<_> = (0..count).map(Computed).collect();
    let tree = PerfectTree::build(&lights, MortonBits::Thirty).unwrap();
    let count = count as usize;
    assert_eq!(tree.len(), count);
    assert!(tree.bytes() <= 64 * count + 4096, "{} bytes a light", tree.bytes() / count);
    let Some(peak) = account("VmHWM:") else {
        eprintln!("skipped: no /proc/self/status here to read the peak from");
        return;
    };
    eprintln!("peak {} MB, tree {} MB", peak / 1000, tree.bytes() / 1_000_000);
    assert!(peak * 1024 <= 1_300_000_000, "peak of {peak} kB");
}
