//! What several tests of samplers share, beside `lighttree::conformance::fixtures`.

use lighttree::rng::{Decisions, Random};
use lighttree::{BuildParams, LightBounds, LightTree, MortonBits, PerfectTree};

pub(crate) fn decisions(seed: u32, index: u32) -> Decisions {
    Decisions::new(Random::new(seed, 0, index))
}

pub(crate) fn trees(lights: &[LightBounds]) -> (LightTree, PerfectTree) {
    (
        LightTree::build(lights, &BuildParams::default()).expect("valid lights"),
        PerfectTree::build(lights, MortonBits::default()).expect("valid lights"),
    )
}
