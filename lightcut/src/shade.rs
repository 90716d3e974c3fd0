//! One receiver at a time: the radiance, and what it cost.

use glam::{DVec3, Vec3};
use lighttree::{Cut, CutSelector, LightHierarchy, LightId, NodeBound};

use crate::{
    Estimate, LightcutParams, Representatives,
    policy::{Policy, Totals},
};

/// What one light of intensity 1 in every channel does to the receiver: all that a lightcut asks of a host.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transfer {
    /// RGB radiance towards the viewer without shadows: scattering × cosine × emission profile ÷ squared
    /// distance, in sr⁻¹ times the inverse square of the scene's length unit. Not negative.
    pub unoccluded: Vec3,
    /// The part of it that arrives, shadows included, in the same unit: all or nothing for one shadow ray.
    /// Need not be asked for where `unoccluded` is zero.
    pub arrived: Vec3,
    /// What a clamp of the host's own took away before, of light that would have arrived; in the same unit.
    /// In neither of the others. It is only added up, in [`Lit::clamped`].
    pub lost: Vec3,
}

impl Transfer {
    /// A light that gives nothing to this receiver.
    pub const NONE: Self = Self { unoccluded: Vec3::ZERO, arrived: Vec3::ZERO, lost: Vec3::ZERO };

    /// The transfer of a light of which the share `visibility`, in [0, 1], is seen.
    pub fn new(unoccluded: Vec3, visibility: f32) -> Self {
        Self { unoccluded, arrived: unoccluded * visibility, lost: Vec3::ZERO }
    }
}

/// What a lightcut found for one receiver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lit {
    /// RGB radiance towards the viewer, W·m⁻²·sr⁻¹.
    pub radiance: Vec3,
    /// RGB radiance that clamps took away, [`LightcutParams::clamp`] and the host's own ([`Transfer::lost`]),
    /// W·m⁻²·sr⁻¹. The same cut without a clamp would have found `radiance + clamped`.
    pub clamped: Vec3,
    /// Bound of the error of the worst node that was left, as luminance, W·m⁻²·sr⁻¹. 0: every node is exact.
    pub worst_error: f32,
    /// Nodes in the cut.
    pub nodes: u32,
    /// Nodes that were looked at on the way.
    pub visited: u32,
    /// Lights whose transfer was asked for, and so shadow rays at most.
    pub transfers: u32,
    /// Transfers that were infinite and were clamped all the same ([`LightcutParams::clamp`]), channel by
    /// channel: their lights are on the very receiver. What the clamp took of them is not in `clamped`.
    pub infinite: u32,
    /// The node limit stopped the refinement before the threshold did.
    pub capped: bool,
}

/// A tree made ready for lightcuts, and the dials.
#[derive(Clone, Copy, Debug)]
pub struct Lightcut<'a, T> {
    /// The lights.
    pub tree: T,
    /// Chosen for this very tree.
    pub representatives: &'a Representatives,
    /// How fine the cuts are.
    pub params: LightcutParams,
}

/// Memory of one thread, reused from receiver to receiver: nothing is allocated once it has grown.
#[derive(Debug, Default)]
pub struct Scratch(CutSelector<Estimate>);

impl<T: LightHierarchy> Lightcut<'_, T> {
    /// Radiance of `receiver` by all lights of the tree.
    ///
    /// `transfer` is the host's: it shades, and it traces the shadow ray. It is asked once per light that
    /// comes to speak for a node. `bound` must hold for it, or the error is not bounded;
    /// [`GeometricBound`](lighttree::GeometricBound) does for any [`Receiver`](lighttree::Receiver). Values
    /// that are not finite come out in the radiance, where they belong to the host to find.
    pub fn shade<R: ?Sized, B: NodeBound<R>>(
        &self,
        receiver: &R,
        bound: &B,
        transfer: impl FnMut(LightId) -> Transfer,
        scratch: &mut Scratch,
    ) -> Lit {
        let (totals, tolerance) = self.refine(receiver, bound, transfer, &mut scratch.0);
        let (mut radiance, mut clamped, mut worst) = (DVec3::ZERO, DVec3::ZERO, 0.0f64);
        for (_, estimate, error) in scratch.0.unordered() {
            radiance += estimate.radiance.as_dvec3();
            clamped += estimate.clamped.as_dvec3();
            worst = worst.max(error);
        }
        let scale = f64::from(self.representatives.scale());
        Lit {
            radiance: (radiance * scale).as_vec3(),
            clamped: (clamped * scale).as_vec3(),
            worst_error: (worst * scale) as f32,
            nodes: scratch.0.unordered().len() as u32,
            visited: totals.entered,
            transfers: totals.transfers,
            infinite: totals.infinite,
            capped: worst > tolerance,
        }
    }

    /// The cut itself, left to right, for methods that go on from it; [`shade`](Self::shade) without the sum.
    /// Returns how many transfers were infinite and were clamped, see [`Lit::infinite`].
    pub fn cut<R: ?Sized, B: NodeBound<R>>(
        &self,
        receiver: &R,
        bound: &B,
        transfer: impl FnMut(LightId) -> Transfer,
        scratch: &mut Scratch,
        cut: &mut Cut<Estimate>,
    ) -> u32 {
        let (totals, _) = self.refine(receiver, bound, transfer, &mut scratch.0);
        scratch.0.drain_into(&self.tree, cut);
        totals.infinite
    }

    fn refine<R: ?Sized, B: NodeBound<R>>(
        &self,
        receiver: &R,
        bound: &B,
        transfer: impl FnMut(LightId) -> Transfer,
        selector: &mut CutSelector<Estimate>,
    ) -> (Totals, f64) {
        let mut policy = Policy {
            tree: &self.tree,
            representatives: self.representatives,
            params: &self.params,
            receiver,
            bound,
            transfer,
            totals: Totals::default(),
        };
        selector.refine(&self.tree, &mut policy, self.params.max_nodes as usize);
        let tolerance = lighttree::CutPolicy::tolerance(&policy);
        (policy.totals, tolerance)
    }
}
