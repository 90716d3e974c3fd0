//! A box of emitters as it is seen from a receiver.

use glam::{DVec3, Vec3};

/// A box of emitters as it is seen from a receiver: distances, and the directions into the box.
///
/// All in f64, so that neither squares nor differences of f32 coordinates lose anything: scenes of size 1e-20
/// or 1e18, or far from the origin, need no special care.
#[derive(Clone, Copy, Debug)]
pub struct Toward {
    /// Smallest coordinates of the box, relative to the receiver.
    low: DVec3,
    /// Largest coordinates of the box, relative to the receiver.
    high: DVec3,
}

impl Toward {
    /// The box `min..=max` seen from `position`.
    #[inline]
    pub fn new(position: Vec3, min: Vec3, max: Vec3) -> Self {
        let position = position.as_dvec3();
        Self { low: min.as_dvec3() - position, high: max.as_dvec3() - position }
    }

    /// Squared distance to the nearest point of the box; 0 inside it.
    #[inline]
    pub fn min_distance_squared(&self) -> f64 {
        self.low.max(-self.high).max(DVec3::ZERO).length_squared()
    }

    /// Squared distance to the farthest point of the box.
    #[inline]
    pub fn max_distance_squared(&self) -> f64 {
        self.high.max(-self.low).length_squared()
    }

    /// From the receiver to the centre of the box.
    #[inline]
    pub fn center(&self) -> DVec3 {
        0.5 * (self.low + self.high)
    }

    /// Squared distance to the centre of the box.
    #[inline]
    pub fn center_distance_squared(&self) -> f64 {
        self.center().length_squared()
    }

    /// Squared length of the box's diagonal.
    #[inline]
    pub fn diagonal_squared(&self) -> f64 {
        (self.high - self.low).length_squared()
    }

    /// Whether the receiver lies in the box or on its surface.
    #[inline]
    pub fn is_inside(&self) -> bool {
        self.low.cmple(DVec3::ZERO).all() && self.high.cmpge(DVec3::ZERO).all()
    }

    /// Upper bound, in [-1, 1], of the cosine between `axis` and any direction into the box. 1 where the box
    /// holds the receiver, or where `axis` is zero or not finite. `axis` need not be a unit vector.
    ///
    /// Where it is positive it is the largest cosine itself, but for rounding (up); it is not positive if and
    /// only if the whole box is on or below the plane through the receiver across `axis`.
    #[inline]
    pub fn max_cos(&self, axis: Vec3) -> f32 {
        let cos = self.max_cos_f64(axis.as_dvec3());
        let nearest = cos as f32;
        if f64::from(nearest) < cos { nearest.next_up() } else { nearest }
    }

    /// [`max_cos`](Self::max_cos) to full precision, for lobes so narrow that f32 cosines near 1 are too
    /// coarse.
    ///
    /// The point `p` of the box with the largest `n·p/|p|` is the one nearest to `t·n` for `t = |p|²/(n·p)`
    /// (the Karush-Kuhn-Tucker conditions of that maximum). Once it is known in which coordinates `t·n` lies
    /// outside the box, so that `p` is at its faces there, `t` has a closed form; so repeat until it stays
    /// the same, two or three times as a rule. The bound of Walter et al. 2005, from a box around the box in
    /// the frame of `n`, is looser and costs as much; it remains as the way out.
    pub fn max_cos_f64(&self, axis: DVec3) -> f64 {
        let squared = axis.length_squared();
        if !(squared > 0.0 && squared < f64::INFINITY) || self.is_inside() {
            return 1.0;
        }
        let highest = (axis * self.low).max(axis * self.high).element_sum();
        if highest <= 0.0 {
            // At most this high, and at most that far away.
            return (highest / (squared * self.max_distance_squared()).sqrt()).max(-1.0);
        }
        self.largest_cos(axis, squared).unwrap_or_else(|| self.walter_cos(axis, highest)).min(1.0)
    }

    /// Cosine between the unit vector `axis` and the direction to the centre of the box; 0 where that is the
    /// receiver.
    #[inline]
    pub fn center_cos(&self, axis: DVec3) -> f64 {
        axis.dot((self.low + self.high).normalize_or_zero())
    }

    /// About [`max_cos`](Self::max_cos) at a third of its cost: as if the box were as high as its highest
    /// point and as far aside as its nearest point. In [0, 1]; positive if and only if `max_cos` is.
    ///
    /// Not a bound, but good enough to weigh nodes by. So does the code that Lin and Yuksel 2020 published.
    #[inline]
    pub fn rough_max_cos(&self, axis: DVec3) -> f64 {
        let squared = axis.length_squared();
        if !(squared > 0.0 && squared < f64::INFINITY) {
            return 1.0;
        }
        let highest = (axis * self.low).max(axis * self.high).element_sum();
        if highest <= 0.0 {
            return if self.is_inside() { 1.0 } else { 0.0 };
        }
        let nearest = DVec3::ZERO.max(self.low).min(self.high);
        let along = axis.dot(nearest);
        let aside = (squared * nearest.length_squared() - along * along).max(0.0);
        highest / (highest * highest + aside).sqrt()
    }

    /// The largest cosine to `n`, whose squared length is given, of a box that does not lie wholly below the
    /// horizon; `None` if the search has not ended after many rounds.
    #[inline]
    fn largest_cos(&self, n: DVec3, n_squared: f64) -> Option<f64> {
        let center = self.low + self.high;
        let mut t = 0.5 * center.length_squared() / n.dot(center);
        if !(0.0..f64::INFINITY).contains(&t) {
            t = self.beyond(n);
        }
        let (mut too_small, mut too_large) = (0.0, f64::INFINITY);
        for _ in 0..32 {
            let top = n * t;
            let p = top.max(self.low).min(self.high);
            let fixed = DVec3::select(p.cmpne(top), p, DVec3::ZERO);
            let (along, squared) = (n.dot(fixed), fixed.length_squared());

            // The conditions hold for t = squared/along, or for any t where both are 0, as they are where t·n
            // itself is in the box. The cosine grows with t up to there.
            let slope = squared - t * along;
            if slope.abs() <= 1e-14 * squared {
                return Some(n.dot(p) / (n_squared * p.length_squared()).sqrt());
            }
            if slope > 0.0 {
                too_small = t;
            } else {
                too_large = t;
            }
            let next = if along > 0.0 { squared / along } else { f64::INFINITY };
            t = if next > too_small && next < too_large {
                next
            } else if too_large.is_finite() {
                0.5 * (too_small + too_large)
            } else {
                self.beyond(n)
            };
        }
        None
    }

    /// A `t` for which no coordinate of `t·n` that can leave the box is left within it.
    fn beyond(&self, n: DVec3) -> f64 {
        let faces = DVec3::select(n.cmpge(DVec3::ZERO), self.high, self.low);
        let leave = DVec3::select(n.cmpne(DVec3::ZERO), faces / n, DVec3::ZERO);
        2.0 * leave.max_element()
    }

    /// The bound of Walter et al., "Lightcuts", 2005: at most so high, and at least so far from the axis.
    #[cold]
    fn walter_cos(&self, n: DVec3, highest: f64) -> f64 {
        let highest = highest / n.length();
        let (u, v) = n.normalize().any_orthonormal_pair();
        let aside = |d: DVec3| {
            let (a, b) = (d * self.low, d * self.high);
            a.min(b).element_sum().max(-a.max(b).element_sum()).max(0.0)
        };
        highest / (highest * highest + aside(u).powi(2) + aside(v).powi(2)).sqrt()
    }
}
