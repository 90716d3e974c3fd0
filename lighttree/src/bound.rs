//! How much can these emitters send to that receiver? The one question of every cut.

use crate::bounds::Turn;
use crate::{LightBounds, Receiver, Toward};

/// Upper bound of a node's unoccluded contribution to a receiver, and nothing that is lower.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bound {
    /// No contribution of these emitters is larger. Not negative; infinite where the receiver lies in their
    /// box, unless they cannot contribute at all; never NaN.
    pub upper: f64,
}

/// The one interface of every cut: how much can these emitters send to that receiver?
pub trait NodeBound<R: ?Sized> {
    /// Bound of the summed unoccluded contribution of all emitters within `emitters` to `receiver`.
    fn bound(&self, emitters: &LightBounds, receiver: &R) -> Bound;
}

/// Intensity × emission cosine × scatter bound ÷ squared distance to the box: needs nothing but a
/// [`Receiver`].
#[derive(Clone, Copy, Debug, Default)]
pub struct GeometricBound;

impl<R: Receiver + ?Sized> NodeBound<R> for GeometricBound {
    #[inline]
    fn bound(&self, emitters: &LightBounds, receiver: &R) -> Bound {
        let terms = BoundTerms::new(emitters, receiver);
        Bound { upper: terms.at(terms.toward.min_distance_squared()) }
    }
}

/// The factors of a [`GeometricBound`], for those that look at other distances than the smallest.
#[derive(Clone, Copy, Debug)]
pub struct BoundTerms {
    /// Upper bound of intensity × emission cosine × scattering, W·sr⁻²; finite unless the receiver's own
    /// bound is not; 0 if and only if these emitters are known to contribute nothing.
    pub strength: f64,
    /// The emitters' box as the receiver sees it.
    pub toward: Toward,
}

impl BoundTerms {
    /// The factors for these emitters and that receiver.
    #[inline]
    pub fn new<R: Receiver + ?Sized>(emitters: &LightBounds, receiver: &R) -> Self {
        Self::with(emitters, receiver, R::scatter_bound)
    }

    /// The same with the receiver's [`scatter_importance`](Receiver::scatter_importance) in place of its
    /// bound: not to bound with, but cheaper, and 0 for the same emitters.
    #[inline]
    pub fn importance<R: Receiver + ?Sized>(emitters: &LightBounds, receiver: &R) -> Self {
        Self::with(emitters, receiver, R::scatter_importance)
    }

    #[inline]
    fn with<R: Receiver + ?Sized>(
        emitters: &LightBounds,
        receiver: &R,
        scatter: impl Fn(&R, &Toward) -> f32,
    ) -> Self {
        let toward = Toward::new(receiver.position(), emitters.min, emitters.max);
        let mut strength = f64::from(emitters.intensity);
        if strength > 0.0 {
            strength *= emission_bound(emitters, &toward);
        }
        // Scattering comes last: it is the dearest, and may be infinite, which must not meet a 0.
        if strength > 0.0 {
            strength *= f64::from(scatter(receiver, &toward));
        }
        Self { strength, toward }
    }

    /// The bound as if the emitters were at that squared distance; 0 without strength, whatever the distance.
    #[inline]
    pub fn at(&self, distance_squared: f64) -> f64 {
        if self.strength > 0.0 { self.strength / distance_squared } else { 0.0 }
    }
}

/// Upper bound, in [0, 1], of these emitters' intensity towards the receiver relative to their peak.
///
/// Conty Estévez and Kulla 2018: cos max(0, θ - `theta_o` - `theta_u`), 0 beyond `theta_e`. Differs
/// from it: the angle θ - `theta_u` between the axis and the nearest of all directions from the box to the
/// receiver is found itself ([`Toward::max_cos`]) instead of from a bounding sphere.
pub fn emission_bound(emitters: &LightBounds, toward: &Toward) -> f64 {
    if emitters.cos_theta_o <= -1.0 || emitters.two_sided && emitters.cos_theta_o <= 0.0 {
        return 1.0;
    }
    // Light leaves against the direction in which the receiver looks.
    let axis = emitters.axis.as_dvec3();
    let mut cos_theta = toward.max_cos_f64(-axis);
    if emitters.two_sided {
        cos_theta = cos_theta.max(toward.max_cos_f64(axis));
    }
    if cos_theta >= f64::from(emitters.cos_theta_o) {
        return 1.0;
    }
    let (theta, theta_o) = (Turn::from_cos(cos_theta), Turn::from_cos(emitters.cos_theta_o));
    let cos_outside = theta.cos * theta_o.cos + theta.sin * theta_o.sin;
    if cos_outside < f64::from(emitters.cos_theta_e) { 0.0 } else { cos_outside.max(0.0) }
}
