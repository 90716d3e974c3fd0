//! What changes in the baked light.

use crate::VirtualLight;

/// One state of the geometry: which objects there are and where. Counts up with every edit that moves, adds or removes an object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(transparent)]
pub struct GeometryVersion(pub u32);

/// A light as it is in the baked light: with the shadows and receivers of one version.
#[derive(Clone, Debug, PartialEq)]
pub struct Contribution {
    /// What shines.
    pub light: VirtualLight,
    /// What casts shadows on what.
    pub version: GeometryVersion,
}

/// Contributions that leave the baked light and others that take their place, one unit for whoever reads it.
///
/// Every contribution in `subtract` was in `add` of an earlier update, as the same record, and in no `subtract` since.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Update {
    /// What leaves.
    pub subtract: Vec<Contribution>,
    /// What comes, always under the version that was current when the update was made.
    pub add: Vec<Contribution>,
}

impl Update {
    /// Whether nothing changes.
    pub const fn is_empty(&self) -> bool {
        self.subtract.is_empty() && self.add.is_empty()
    }

    /// Lights that have to be accumulated, added or subtracted: what an update costs.
    pub const fn accumulations(&self) -> usize {
        self.subtract.len() + self.add.len()
    }
}
