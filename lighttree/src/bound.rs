//! How much can these emitters send to that receiver? The one question of every cut.

use crate::{LightBounds, Receiver, Toward};

/// Upper bound of a node's unoccluded contribution to a receiver, and nothing that is lower.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bound {
    /// No contribution of these emitters is larger. Not negative; infinite where the receiver lies in their box.
    pub upper: f64,
}

/// The one interface of every cut: how much can these emitters send to that receiver?
pub trait NodeBound<R: ?Sized> {
    /// Bound of the summed unoccluded contribution of all emitters within `emitters` to `receiver`.
    fn bound(&self, emitters: &LightBounds, receiver: &R) -> Bound;
}

/// Intensity × emission cosine × scatter bound ÷ squared distance to the box: needs nothing but a [`Receiver`].
#[derive(Clone, Copy, Debug, Default)]
pub struct GeometricBound;

impl<R: Receiver + ?Sized> NodeBound<R> for GeometricBound {
    fn bound(&self, emitters: &LightBounds, receiver: &R) -> Bound {
        let toward = Toward::new(receiver.position(), emitters.min, emitters.max);
        let scatter = f64::from(receiver.scatter_bound(&toward));
        Bound { upper: f64::from(emitters.intensity) * scatter / toward.min_distance_squared() }
    }
}
