//! One receiver's light from its interpolated cut, and which of its nodes need a shadow ray.

use glam::{DVec3, Vec3};

use crate::Chosen;

/// Where the visibility of a node comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Visibility {
    /// A shadow ray for every node that gives light. Nothing is blurred.
    Full,
    /// A shadow ray where the records disagree, and the node matters: where it may be wrong by more than this share of the receiver's light,
    /// half of the node's light at worst. 0: wherever they disagree. The authors name this as future work.
    Adaptive {
        /// Dimensionless, at least 0.
        share: f32,
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
    let tolerated = match visibility {
        Visibility::Full => 0.0,
        Visibility::Adaptive { share } => f64::from(share) * lit.radiance.element_sum(),
        Visibility::Interpolated => return lit,
    };
    for (i, (node, light)) in chosen.iter().zip(unoccluded).enumerate() {
        let (light, assumed) = (light.as_dvec3(), f64::from(node.visibility));
        let (assumed, wanted) = if visibility == Visibility::Full {
            (0.0, light != DVec3::ZERO)
        } else {
            let wrong = light.element_sum() * assumed.min(1.0 - assumed);
            (assumed, wrong > tolerated)
        };
        if wanted {
            lit.rays += 1;
            let seen = if occluded(i) { 0.0 } else { 1.0 };
            lit.radiance += (seen - assumed) * light;
        }
    }
    lit
}
