//! The dials of a lightcut, and what each trades.

/// How fine a cut has to be. Every field may be set freely; [`check`](Self::check) says what makes no sense.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightcutParams {
    /// A node is split while the bound of its error is larger than this share of the receiver's whole
    /// estimate. Dimensionless, at least 0; 0.02 is Weber's law as in the paper. Halving it about doubles the
    /// cut. 0: refine down to every light that can contribute.
    pub threshold: f32,
    /// Most nodes in a cut; 1000 in the paper. Bounds the time in dark or cluttered places; where it stops
    /// the refinement, [`Lit::capped`](crate::Lit::capped) says so.
    pub max_nodes: u32,
    /// The estimate is taken to be at least this luminance, in W·m⁻²·sr⁻¹, when errors are compared with it.
    /// 0: off. Something like a thousandth of the picture's mean keeps black places from being refined for
    /// nothing.
    pub floor: f32,
    /// The estimate is taken to be at least this share of what it would be without any shadow. Dimensionless,
    /// in [0, 1]; 0 as in the paper. Scale free, where `floor` is not: with 0.05, what is in full shadow may
    /// be wrong by `threshold` times a twentieth of what the unblocked lights would give.
    pub shadow_floor: f32,
    /// Virtual point lights have no near limit: their transfer goes with 1/d². This is the most that a light
    /// of intensity 1 may transfer, in sr⁻¹ times the inverse square of the scene's length unit; infinite
    /// (the default): no clamp. A clamp is a bias: light is lost near walls and in corners.
    /// [`Lit::clamped`](crate::Lit::clamped) counts it, [`Lit::infinite`](crate::Lit::infinite) what has no
    /// number.
    pub clamp: f32,
}

impl LightcutParams {
    /// The parameters of Walter et al. 2005: 2 %, at most 1000 nodes, no floor, no clamp.
    pub const fn paper() -> Self {
        Self { threshold: 0.02, max_nodes: 1000, floor: 0.0, shadow_floor: 0.0, clamp: f32::INFINITY }
    }

    /// As [`paper`](Self::paper), with another threshold.
    pub const fn with_threshold(threshold: f32) -> Self {
        Self { threshold, ..Self::paper() }
    }

    /// Names the first field whose value is out of its range.
    ///
    /// # Errors
    /// The sentence to show to whoever set it.
    pub fn check(&self) -> Result<(), &'static str> {
        let not_negative = |x: f32| x >= 0.0;
        if !not_negative(self.threshold) {
            Err("the threshold must be at least 0")
        } else if !not_negative(self.floor) {
            Err("the floor must be at least 0")
        } else if !(0.0..=1.0).contains(&self.shadow_floor) {
            Err("the shadow floor must be from 0 to 1")
        } else if !not_negative(self.clamp) {
            Err("the clamp must be at least 0; infinite is off")
        } else {
            Ok(())
        }
    }
}

impl Default for LightcutParams {
    /// As [`paper`](Self::paper).
    fn default() -> Self {
        Self::paper()
    }
}
