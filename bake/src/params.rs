//! Dials of the bake, and what is wrong with them.

use core::fmt;

use glam::Vec3;

use crate::{GroupDirections, LightError, LightKey};

/// An axis-aligned box in world space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub min: Vec3,
    /// Upper corner, nowhere below `min`.
    pub max: Vec3,
}

/// What is brought up to date first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UpdateOrder {
    /// Clusters with the most invalid flux for each light that their update takes, as it would arrive at what
    /// is [watched](crate::Baker::watch). (The paper neither counts lights nor knows of a viewer.)
    #[default]
    InvalidFlux,
    /// In the order in which clusters became invalid: for comparison.
    FirstInFirstOut,
}

/// Dials of a bake. All but `skip_unaffected`, `order` and `patience` are part of what a saved state has to
/// agree with.
#[derive(Clone, Copy, Debug)]
pub struct BakeParams {
    /// Everything that light may meet, now and after edits. What lies outside goes into the nearest cluster
    /// at its border, and is counted.
    pub world: Bounds,
    /// Power of a path, W, mean of the channels: the unit of invalid flux. Lights may have more or fewer
    /// paths than this says.
    pub path_power: f64,
    /// Surfaces that a path may meet: bounces of indirect light, 1 to 16.
    pub bounces: u32,
    /// N: selected clusters; up to 6 more may be.
    pub clusters: usize,
    /// K: virtual lights of a cell of the octree, from 1.
    pub lights_per_cell: usize,
    /// `p_min`: members of a polygon, from 3.
    pub plane_members: usize,
    /// `σ_n`, radians: how far normals of one plane may differ.
    pub plane_angle: f32,
    /// `σ_d` over the side of a cell: how far members of one plane may be apart.
    pub plane_offset: f32,
    /// A cell with more members is parted, from 1.
    pub leaf_members: u32,
    /// t of Equation 2, between 0 and 1: the share of invalid flux at which validation and balancing take
    /// turns.
    pub interleave_at: f64,
    /// The least share of accumulated lights that validate while both wait, from 0.5 (the paper's, of
    /// updates) to 1. Balancing shows less.
    pub least_validation: f64,
    /// How long updates wait where somebody looks ([`Baker::watch`](crate::Baker::watch)) until all that will
    /// change is known, and can come in the best order: so many times all paths and virtual point lights may
    /// be looked at meanwhile. From 0, which is not at all. Where edits keep coming, updates wait so long
    /// once, and then follow.
    pub patience: f64,
    /// What is brought up to date first.
    pub order: UpdateOrder,
    /// Trace a path again only from the first segment on that crosses the box of something that changed, or
    /// that starts or ends on it. The result is the same; turn it off where boxes of edits may be too small.
    pub skip_unaffected: bool,
    /// Seed of paths.
    pub seed: u32,
    /// Groups what no plane takes by orientation.
    pub group: GroupDirections,
}

impl BakeParams {
    /// The paper's settings: 3 bounces, 3000 clusters, K = 4, `p_min` = 10, `σ_n` = 1°, `σ_d` = 0.01, t =
    /// 0.1, half of all lights at least for validation.
    pub const fn new(world: Bounds, path_power: f64, group: GroupDirections) -> Self {
        Self {
            world,
            path_power,
            bounces: 3,
            clusters: 3000,
            lights_per_cell: 4,
            plane_members: 10,
            plane_angle: 0.017_453_292,
            plane_offset: 0.01,
            leaf_members: 64,
            interleave_at: 0.1,
            least_validation: 0.5,
            patience: 1.5,
            order: UpdateOrder::InvalidFlux,
            skip_unaffected: true,
            seed: 0,
            group,
        }
    }

    pub(crate) fn check(&self) -> Result<(), BakeError> {
        let Bounds { min, max } = self.world;
        // The largest side's cube has to be finite, too.
        let sides = max - min;
        if !(min.is_finite() && max.is_finite() && (4.0 * sides).is_finite() && sides.min_element() >= 0.0)
            || sides.max_element() <= 0.0
        {
            return Err(BakeError::World);
        }
        let dial =
            |name, range, sound: bool| if sound { Ok(()) } else { Err(BakeError::Dial { name, range }) };
        dial(
            "path_power",
            "a finite number of W above 0",
            self.path_power.is_finite() && self.path_power > 0.0,
        )?;
        dial("bounces", "1 to 16", (1..=16).contains(&self.bounces))?;
        dial("clusters", "1 or more", self.clusters >= 1)?;
        dial("lights_per_cell", "1 or more", self.lights_per_cell >= 1)?;
        dial("plane_members", "3 or more", self.plane_members >= 3)?;
        let right = core::f32::consts::FRAC_PI_2;
        dial("plane_angle", "above 0, up to π/2", self.plane_angle > 0.0 && self.plane_angle <= right)?;
        dial("plane_offset", "finite and above 0", self.plane_offset > 0.0 && self.plane_offset.is_finite())?;
        dial("leaf_members", "1 or more", self.leaf_members >= 1)?;
        dial("interleave_at", "between 0 and 1", self.interleave_at > 0.0 && self.interleave_at < 1.0)?;
        dial("patience", "0 or more", self.patience >= 0.0)?;
        dial("least_validation", "0.5 to 1", (0.5..=1.0).contains(&self.least_validation))
    }
}

/// Why something cannot be baked.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum BakeError {
    /// The world is no box, or not finite, or has no extent.
    World,
    /// This dial is out of its range.
    Dial {
        /// Its name.
        name: &'static str,
        /// What it may be.
        range: &'static str,
    },
    /// This light is none.
    Light {
        /// Its name.
        key: LightKey,
        /// What is wrong with it.
        error: LightError,
    },
    /// There is a light of this name already.
    SameKey {
        /// The name.
        key: LightKey,
    },
    /// There is no light of this name.
    NoLight {
        /// The name.
        key: LightKey,
    },
    /// All lights together have more than 2²⁸ paths.
    TooManyPaths,
    /// This point that is looked at is not finite, or its normal not of unit length.
    Watched {
        /// Index of the point.
        index: usize,
    },
    /// A box of this change is no box.
    Bounds {
        /// Index of the change.
        index: usize,
    },
}

impl fmt::Display for BakeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::World => write!(f, "the world must be a finite box with an extent"),
            Self::Dial { name, range } => write!(f, "`{name}` is out of its range: {range}"),
            Self::Light { key, error } => write!(f, "light {}: {error}", key.0),
            Self::SameKey { key } => {
                write!(f, "there is a light {} already; set it, or take another name", key.0)
            }
            Self::NoLight { key } => write!(f, "there is no light {}; add it first", key.0),
            Self::TooManyPaths => write!(f, "more than 268435456 paths; give lights fewer"),
            Self::Watched { index } => {
                write!(f, "point {index} to look at must be finite, with a normal of unit length")
            }
            Self::Bounds { index } => {
                write!(f, "the boxes of change {index} must be finite, min nowhere above max")
            }
        }
    }
}

impl core::error::Error for BakeError {}
