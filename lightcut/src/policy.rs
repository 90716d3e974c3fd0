//! When a node of a lightcut is split, and what its estimate is.
//!
//! Walter et al. 2005, section 4.1: the error of a cluster is at most its bound, and is tolerated when it is
//! below a share of the receiver's whole estimate as the cut stands.

use glam::Vec3;
use lighttree::{CutPolicy, LightHierarchy, LightId, NodeBound, NodeId, luminance_f64};

use crate::{LightcutParams, Representatives, Transfer};

/// A node's estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// RGB radiance that the node's lights give to the receiver, shadows included, in W·m⁻²·sr⁻¹ divided by
    /// the tree's largest intensity.
    pub(crate) radiance: Vec3,
    /// Luminance of the same without shadows.
    pub(crate) unoccluded: f32,
    /// The representative's, clamped if a clamp is set.
    pub(crate) transfer: Transfer,
    /// Whose transfer it is.
    pub(crate) light: LightId,
    /// What clamps took away of what would have arrived, in the unit of `radiance`.
    pub(crate) clamped: Vec3,
}

impl Estimate {
    /// Luminance that the node's lights give to the receiver, shadows included, in W·m⁻²·sr⁻¹ divided by the
    /// largest intensity of all the tree's lights: to be compared with others of the same tree.
    pub fn luminance(&self) -> f64 {
        luminance_f64(self.radiance.as_dvec3())
    }

    /// Luminance of the same without shadows, in the same unit: 0 where the receiver gets nothing from the
    /// light that speaks for the node, whatever stands between them.
    pub fn unoccluded(&self) -> f32 {
        self.unoccluded
    }

    /// The light that speaks for the node.
    pub fn light(&self) -> LightId {
        self.light
    }

    /// The share of the node's light that arrives, in [0, 1]: 0 or 1 for one shadow ray; 0 where there is no
    /// light.
    pub fn seen(&self) -> f32 {
        if self.unoccluded > 0.0 {
            (luminance_f64(self.radiance.as_dvec3()) / f64::from(self.unoccluded)) as f32
        } else {
            0.0
        }
    }
}

pub(crate) struct Policy<'a, T: ?Sized, R: ?Sized, B, F> {
    pub(crate) tree: &'a T,
    pub(crate) representatives: &'a Representatives,
    pub(crate) params: &'a LightcutParams,
    pub(crate) receiver: &'a R,
    pub(crate) bound: &'a B,
    pub(crate) transfer: F,
    pub(crate) totals: Totals,
}

/// Sums over the cut as it stands, and counts of what it took to get there.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Totals {
    lit: f64,
    unoccluded: f64,
    pub(crate) entered: u32,
    pub(crate) transfers: u32,
    pub(crate) infinite: u32,
}

impl<T, R, B, F> Policy<'_, T, R, B, F>
where
    T: LightHierarchy + ?Sized,
    R: ?Sized,
    B: NodeBound<R>,
    F: FnMut(LightId) -> Transfer,
{
    /// Asks the host for the transfer of one light, and clamps it.
    fn ask(&mut self, light: LightId) -> Transfer {
        self.totals.transfers += 1;
        let Transfer { unoccluded, arrived, lost } = (self.transfer)(light);
        let largest = unoccluded.max_element();
        if largest <= self.params.clamp || largest.is_nan() {
            return Transfer { unoccluded, arrived, lost };
        }
        if largest == f32::INFINITY {
            return self.keep_finite(unoccluded, arrived, lost);
        }
        let kept = self.params.clamp / largest;
        Transfer {
            unoccluded: unoccluded * kept,
            arrived: arrived * kept,
            lost: lost + arrived * (1.0 - kept),
        }
    }

    /// A light on the very receiver, as far as a clamp leaves a number of it: colours have no ratio there, so
    /// that each channel is clamped by itself. What is lost is beyond all numbers, and is counted instead.
    fn keep_finite(&mut self, unoccluded: Vec3, arrived: Vec3, lost: Vec3) -> Transfer {
        self.totals.infinite += 1;
        let clamp = self.params.clamp;
        // What is no number stays none: that is for the host to find.
        let keep = |x: f32| if x > clamp { clamp } else { x };
        let finite = |x: f32| if x == f32::INFINITY { 0.0 } else { x };
        Transfer {
            unoccluded: unoccluded.map(keep),
            arrived: arrived.map(keep),
            lost: lost.map(finite) + arrived.map(|x| finite(x - keep(x))),
        }
    }

    /// The estimate of one light (or cluster) of this intensity.
    fn estimate(&mut self, intensity: Vec3, light: LightId, parent: Option<&Estimate>) -> Estimate {
        let transfer = match parent {
            Some(p) if p.light == light => p.transfer,
            _ => self.ask(light),
        };
        Estimate {
            radiance: transfer.arrived * intensity,
            unoccluded: luminance_f64((transfer.unoccluded * intensity).as_dvec3()) as f32,
            transfer,
            light,
            clamped: transfer.lost * intensity,
        }
    }

    /// A leaf of several lights is summed up light by light, and so is exact.
    fn leaf_of_several(&mut self, node: NodeId, parent: Option<&Estimate>) -> Estimate {
        let slots = self.tree.items(node);
        let representatives = self.representatives;
        let each =
            slots.map(|slot| self.estimate(representatives.in_slot(slot), self.tree.light_at(slot), parent));
        each.reduce(|sum, next| Estimate {
            radiance: sum.radiance + next.radiance,
            unoccluded: sum.unoccluded + next.unoccluded,
            clamped: sum.clamped + next.clamped,
            ..sum
        })
        .expect("a node has items")
    }
}

impl<T, R, B, F> CutPolicy for Policy<'_, T, R, B, F>
where
    T: LightHierarchy + ?Sized,
    R: ?Sized,
    B: NodeBound<R>,
    F: FnMut(LightId) -> Transfer,
{
    type Value = Estimate;

    fn enter(&mut self, node: NodeId, parent: Option<&Estimate>) -> (Estimate, f64) {
        self.totals.entered += 1;
        let representative = self.representatives.at(self.tree.node_index(node));
        let leaf = self.tree.is_leaf(node);
        let estimate = if leaf && self.tree.items(node).len() > 1 {
            self.leaf_of_several(node, parent)
        } else {
            self.estimate(representative.intensity, representative.light, parent)
        };
        self.totals.lit += luminance_f64(estimate.radiance.as_dvec3());
        self.totals.unoccluded += f64::from(estimate.unoccluded);
        (estimate, if leaf { 0.0 } else { self.error(node, representative.intensity) })
    }

    fn leave(&mut self, _: NodeId, estimate: &Estimate) {
        self.totals.lit -= luminance_f64(estimate.radiance.as_dvec3());
        self.totals.unoccluded -= f64::from(estimate.unoccluded);
    }

    fn tolerance(&self) -> f64 {
        let p = self.params;
        let floor = f64::from(p.floor) / f64::from(self.representatives.scale());
        let shadow_floor = f64::from(p.shadow_floor) * self.totals.unoccluded;
        f64::from(p.threshold) * self.totals.lit.max(floor).max(shadow_floor)
    }
}

impl<T, R, B, F> Policy<'_, T, R, B, F>
where
    T: LightHierarchy + ?Sized,
    R: ?Sized,
    B: NodeBound<R>,
{
    /// Bound of the luminance that a node of this RGB intensity can give, and so of the error of any estimate
    /// of it.
    fn error(&self, node: NodeId, intensity: Vec3) -> f64 {
        let (bounds, luminance) = (self.tree.bounds(node), luminance_f64(intensity.as_dvec3()));
        if bounds.intensity == 0.0 || luminance == 0.0 {
            return 0.0;
        }
        let per_unit = self.bound.bound(&bounds, self.receiver).upper / f64::from(bounds.intensity);
        per_unit.min(f64::from(self.params.clamp)) * luminance
    }
}
