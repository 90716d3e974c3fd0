//! What several tests of samplers share, beside `lighttree::conformance::fixtures`.

use lighttree::{BuildParams, LightBounds, LightTree};

/// A tree of every builder of trees with cones.
pub(crate) fn builders(lights: &[LightBounds]) -> Vec<(&'static str, LightTree)> {
    [
        ("median", BuildParams::median()),
        ("saoh", BuildParams::saoh()),
        ("agglomerative", BuildParams::agglomerative()),
        ("morton", BuildParams::morton()),
    ]
    .map(|(name, params)| (name, LightTree::build(lights, &params).expect("valid lights")))
    .into()
}
