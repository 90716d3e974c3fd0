//! One receiver's light from its interpolated cut, and which of its nodes need a shadow ray.

use glam::{DVec3, Vec3};

use crate::Chosen;

/// Where the visibility of a node comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Visibility {
    /// A shadow ray for every node that gives light. Nothing is blurred.
    Full,
    /// A shadow ray where the records disagree, which the authors name as future work, and where a node gives
    /// so much that not even their agreement is taken for granted.
    Adaptive {
        /// Where records disagree: the share of the receiver's light by which a node may be wrong without a
        /// ray, half of the node's light at worst. At least 0; 0 asks wherever they disagree.
        share: f32,
        /// Where they agree: the share of the receiver's light that a node may give without a ray. At least
        /// 0; infinite trusts them.
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

/// A node whose shadow ray has to be asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// Its place in the cut.
    pub at: u32,
    /// What of its light is in the sum already, in [0, 1]. The answer adds 1 - `assumed` times the light if
    /// it is seen, and takes `assumed` times the light away if it is not.
    pub assumed: f32,
}

impl Wanted {
    /// What the answer adds to the sum, for the node's unoccluded `light`.
    #[inline]
    pub fn correction(&self, light: Vec3, occluded: bool) -> DVec3 {
        let seen = if occluded { 0.0 } else { 1.0 };
        (seen - f64::from(self.assumed)) * light.as_dvec3()
    }
}

/// A receiver's light as far as it is known without shadow rays, and the nodes that need one: for hosts that
/// ask for many at once. [`sum_up`] asks for them one after the other.
///
/// `unoccluded[i]` is the RGB light of `chosen[i]` without shadow. Replaces what is in `wanted`.
///
/// # Panics
/// If the slices differ in length.
pub fn assume(
    visibility: Visibility,
    chosen: &[Chosen],
    unoccluded: &[Vec3],
    wanted: &mut Vec<Wanted>,
) -> DVec3 {
    assert_eq!(chosen.len(), unoccluded.len(), "one light per node");
    wanted.clear();
    if visibility == Visibility::Full {
        let lit = (0..).zip(unoccluded).filter(|(_, light)| light.element_sum() != 0.0);
        wanted.extend(lit.map(|(at, _)| Wanted { at, assumed: 0.0 }));
        return DVec3::ZERO;
    }
    let nodes = || chosen.iter().zip(unoccluded);
    let sum = nodes().fold(DVec3::ZERO, |sum, (node, &light)| sum + (node.visibility * light).as_dvec3());
    if let Visibility::Adaptive { share, trust } = visibility {
        let total = sum.element_sum();
        let (tolerated, trusted) = (f64::from(share) * total, f64::from(trust) * total);
        for (at, (node, light)) in (0..).zip(nodes()) {
            let (assumed, brightness) = (node.visibility, f64::from(light.element_sum()));
            let doubtful = brightness * f64::from(assumed.min(1.0 - assumed)) > tolerated;
            // No share of no light at all is no number, and asks for nothing.
            if (doubtful || brightness > trusted) && brightness > 0.0 {
                wanted.push(Wanted { at, assumed });
            }
        }
    }
    sum
}

/// Sums up a receiver's light.
///
/// `unoccluded[i]` is the RGB light of `chosen[i]` without shadow. `occluded` is the host's: whether the
/// shadow ray to the light that speaks for `chosen[i]` is blocked; asked at most once for each, in order.
///
/// # Panics
/// If the slices differ in length.
pub fn sum_up(
    visibility: Visibility,
    chosen: &[Chosen],
    unoccluded: &[Vec3],
    mut occluded: impl FnMut(usize) -> bool,
) -> Lit {
    let mut wanted = Vec::new();
    let mut radiance = assume(visibility, chosen, unoccluded, &mut wanted);
    for wanted in &wanted {
        let at = wanted.at as usize;
        radiance += wanted.correction(unoccluded[at], occluded(at));
    }
    Lit { radiance, rays: wanted.len() as u32 }
}
