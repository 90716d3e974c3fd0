//! How much a record has to say about a point, and which records a point uses.
//!
//! Rehfeld and Dachsbacher, "Lightcut Interpolation", 2016, section 3.2: the weight of Tabellion and
//! Lamorlette, "An Approximate Global Illumination System for Computer Generated Films", 2004; the three best
//! records less the fourth, so that weights are continuous.
//!
//! Differs from the paper:
//! - the limits of a record's radius are multiples of the *side* of a pixel's footprint, not of its area,
//!   because they are lengths;
//! - a record counts as in front of a point only beyond a tolerance: compared with zero, rounding rejects
//!   every second record of one flat wall;
//! - a point on a line between records (or in a regular grid of them) may have four equal weights, whose
//!   differences say nothing: then the weights themselves are used.

use glam::Vec3;

/// A point to be lit, as far as records are concerned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// World-space position.
    pub position: Vec3,
    /// Unit normal on the viewer's side.
    pub normal: Vec3,
    /// Side of the square that has the area of what a pixel (or texel) covers of the surface here, in the
    /// scene's unit of length.
    pub footprint: f32,
    /// Least distance on the surface between the points of neighbouring pixels, at most `footprint`: the
    /// same, without the foreshortening.
    pub spacing: f32,
}

/// Where a record is, and how far its word goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Site {
    /// World-space position.
    pub position: Vec3,
    /// Unit normal on the viewer's side.
    pub normal: Vec3,
    /// Distance at which the weight is zero, from [`WeightParams::radius`].
    pub radius: f32,
}

/// How weights fall with distance and angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeightParams {
    /// Least radius of a record in footprints; 4 in the paper. More: fewer records in corners, more error
    /// there.
    pub r_min: f32,
    /// Largest radius of a record in footprints, at least `r_min`; 15 in the paper.
    pub r_max: f32,
    /// Largest radius of a record in the scene's unit of length; infinite by default. For footprints without
    /// a limit, as through mirrors.
    pub max_radius: f32,
    /// Cosine of the angle between normals at which the weight is zero; cos 15° in the paper.
    pub cos_max_angle: f32,
    /// A record is in front of a point when it is so by more than this part of its radius. Dimensionless,
    /// above 0.
    pub front_tolerance: f32,
    /// A record is of use to a point when its weight is above this. In [0, 1).
    pub epsilon: f32,
}

impl WeightParams {
    /// The parameters of Rehfeld and Dachsbacher 2016; the tolerance is ours.
    pub const fn paper() -> Self {
        Self {
            r_min: 4.0,
            r_max: 15.0,
            max_radius: f32::INFINITY,
            cos_max_angle: 0.965_925_8,
            front_tolerance: 0.1,
            epsilon: 1e-3,
        }
    }

    /// The same with a largest radius of no more than `share` of the picture's shorter side, but never below
    /// the least radius.
    ///
    /// Shadows are as large as the things that cast them, however few pixels the picture has: fifteen pixels
    /// are a fiftieth of the paper's picture and a quarter of a thumbnail, whose balls have no shadows then.
    /// [`PICTURE_SHARE`](Self::PICTURE_SHARE) leaves the paper's radius alone from 500 pixels on.
    #[must_use]
    pub fn in_picture(self, width: u32, height: u32, share: f32) -> Self {
        let largest = (share * width.min(height) as f32).max(self.r_min);
        // `min` takes the number of the two.
        Self { r_max: self.r_max.min(largest), ..self }
    }

    /// The share of a picture's shorter side that a radius may have, see [`in_picture`](Self::in_picture).
    pub const PICTURE_SHARE: f32 = 0.03;

    /// Names the first field whose value is out of its range.
    ///
    /// # Errors
    /// The sentence to show to whoever set it.
    pub fn check(&self) -> Result<(), &'static str> {
        let positive = |x: f32| x > 0.0;
        let in_order = self.r_min <= self.r_max;
        if !(positive(self.r_min) && self.r_min.is_finite()) {
            Err("the least radius must be a positive number of footprints")
        } else if !in_order {
            Err("the largest radius must not be below the least")
        } else if !positive(self.max_radius) {
            Err("the largest radius in units of length must be positive; infinite is off")
        } else if !(-1.0..1.0).contains(&self.cos_max_angle) {
            Err("the cosine of the largest angle between normals must be in [-1, 1)")
        } else if !positive(self.front_tolerance) {
            Err("the tolerance of records in front must be above 0")
        } else if !(0.0..1.0).contains(&self.epsilon) {
            Err("the least weight must be in [0, 1)")
        } else {
            Ok(())
        }
    }

    /// Radius of a record whose harmonic mean distance to the geometry around is `harmonic_mean` (infinite
    /// where nothing is around; what is no number counts as that), where a pixel's footprint is `footprint`.
    pub fn radius(&self, harmonic_mean: f32, footprint: f32) -> f32 {
        // `min` takes the number of the two.
        let largest = (self.r_max * footprint).min(self.max_radius);
        let least = (self.r_min * footprint).min(self.max_radius);
        (0.5 * harmonic_mean).min(largest).max(least)
    }

    /// Weight of the record at `site` for a point; at most 1. A record whose weight is not above
    /// [`epsilon`](Self::epsilon) is of no use.
    #[inline]
    pub fn weight(&self, position: Vec3, normal: Vec3, site: &Site) -> f32 {
        // In radii, so that no square leaves the range of f32 in any unit of length.
        let from_record = (position - site.position) / site.radius;
        let both = normal + site.normal;
        let front = from_record.dot(both);
        if front < 0.0 && front * front > self.front_tolerance * self.front_tolerance * both.length_squared()
        {
            return 0.0;
        }
        let d_p = from_record.length();
        // Rounding takes the cosine of equal normals above one.
        let d_n = ((1.0 - normal.dot(site.normal)).max(0.0) / (1.0 - self.cos_max_angle)).sqrt();
        1.0 - d_p.max(d_n)
    }
}

impl Default for WeightParams {
    /// As [`paper`](Self::paper).
    fn default() -> Self {
        Self::paper()
    }
}

/// The records that a point interpolates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Selection {
    /// Their ids, ascending; the first [`len`](Self::len) are used.
    records: [u32; 3],
    /// Their weights, positive and summing to one but for rounding.
    weights: [f32; 3],
    len: u8,
}

/// A difference of weights below this share of the largest weight is rounding.
const ROUNDING: f32 = 1e-6;

impl Selection {
    /// Selects among `candidates`, pairs of id and weight in any order without repetition. `None` where no
    /// weight is above `epsilon`: the point has to find its light in another way.
    #[inline]
    pub fn best(candidates: impl Iterator<Item = (u32, f32)>, epsilon: f32) -> Option<Self> {
        // The four best, best first; ties to the lower id.
        let mut best = [(u32::MAX, 0.0f32); 4];
        for (id, weight) in candidates {
            let (last_id, last) = best[3];
            // Not for what is no number.
            if weight > epsilon && (weight > last || (weight == last && id < last_id)) {
                best[3] = (id, weight);
                for i in (1..4).rev() {
                    let ((above_id, above), (id, weight)) = (best[i - 1], best[i]);
                    if weight > above || (weight == above && id < above_id) {
                        best.swap(i - 1, i);
                    }
                }
            }
        }
        let [(_, first), .., (_, fourth)] = best;
        if first == 0.0 {
            return None;
        }

        // Less the fourth, which makes the weights continuous where records change places.
        let differences = best.map(|(_, weight)| weight - fourth);
        let sum: f32 = differences[..3].iter().sum();
        let weights = if sum > ROUNDING * first { differences } else { best.map(|(_, weight)| weight) };
        let sum: f32 = weights[..3].iter().sum();
        let mut selection = Self { records: [u32::MAX; 3], weights: [0.0; 3], len: 0 };
        for (&(id, _), weight) in best[..3].iter().zip(weights) {
            if weight > 0.0 {
                selection.insert(id, weight / sum);
            }
        }
        Some(selection)
    }

    fn insert(&mut self, id: u32, weight: f32) {
        let mut at = usize::from(self.len);
        while at > 0 && self.records[at - 1] > id {
            self.records[at] = self.records[at - 1];
            self.weights[at] = self.weights[at - 1];
            at -= 1;
        }
        self.records[at] = id;
        self.weights[at] = weight;
        self.len += 1;
    }

    /// How many records: one to three.
    #[expect(clippy::len_without_is_empty, reason = "there is always one")]
    pub fn len(&self) -> usize {
        self.len.into()
    }

    /// Ids of the records, ascending, whatever their weights: neighbouring points often have the same.
    pub fn records(&self) -> &[u32] {
        &self.records[..self.len()]
    }

    /// Their weights, each above 0, summing to one.
    pub fn weights(&self) -> &[f32] {
        &self.weights[..self.len()]
    }
}
