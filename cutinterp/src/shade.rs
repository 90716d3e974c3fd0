//! One receiver's light from its interpolated cut, and which of its nodes need a shadow ray.

use glam::{DVec3, Vec3};

use crate::Chosen;

/// Where the visibility of a node comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Visibility {
    /// A shadow ray for every node that gives light. Nothing is blurred.
    Full,
    /// A shadow ray where the records disagree, which the authors name as future work, and where a node gives so much that not even their
    /// agreement is taken for granted.
    Adaptive {
        /// Where records disagree: the share of the receiver's light by which a node may be wrong without a ray, half of the node's light at
        /// worst. At least 0; 0 asks wherever they disagree.
        share: f32,
        /// Where they agree: the share of the receiver's light that a node may give without a ray. At least 0; infinite trusts them.
        trust: f32,
    },
    /// That of the records, and no ray.
    Interpolated,
}

/// What a receiver got, and for how much.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lit {
    /// RGB radiance towards the viewer, in whatever unit the nodes' light has.
    pub radiance: DVec3,
    /// Shadow rays that were asked for.
    pub rays: u32,
}

/// Sums up a receiver's light.
///
/// `unoccluded[i]` is the RGB light of `chosen[i]` without shadow. `occluded` is the host's: whether the shadow ray to the light that speaks for
/// `chosen[i]` is blocked; asked at most once for each, in order.
///
/// # Panics
/// If the slices differ in length.
pub fn sum_up(
    visibility: Visibility,
    chosen: &[Chosen],
    unoccluded: &[Vec3],
    mut occluded: impl FnMut(usize) -> bool,
) -> Lit {
    assert_eq!(chosen.len(), unoccluded.len(), "one light per node");
    let mut lit = Lit::default();
    if visibility != Visibility::Full {
        for (node, light) in chosen.iter().zip(unoccluded) {
            lit.radiance += f64::from(node.visibility) * light.as_dvec3();
        }
    }
    let total = lit.radiance.element_sum();
    let (tolerated, trusted) = match visibility {
        Visibility::Full => (-1.0, 0.0),
        Visibility::Adaptive { share, trust } => (f64::from(share) * total, f64::from(trust) * total),
        Visibility::Interpolated => return lit,
    };
    for (i, (node, light)) in chosen.iter().zip(unoccluded).enumerate() {
        let light = light.as_dvec3();
        let assumed = if visibility == Visibility::Full { 0.0 } else { f64::from(node.visibility) };
        let brightness = light.element_sum();
        // No share of no light at all is no number, and asks for nothing.
        let wanted = brightness * assumed.min(1.0 - assumed) > tolerated || brightness > trusted;
        if wanted && brightness > 0.0 {
            lit.rays += 1;
            let seen = if occluded(i) { 0.0 } else { 1.0 };
            lit.radiance += (seen - assumed) * light;
        }
    }
    lit
}
