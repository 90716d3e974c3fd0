//! What changes in the baked light.

use crate::VirtualLight;

/// One state of the geometry: which objects there are and where. Counts up with every edit that moves, adds
/// or removes an object.
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

impl Contribution {
    /// Whether one of the two is accumulated along with the other: the same points under the same name.
    pub(crate) fn is_in_place_of(&self, other: &Self) -> bool {
        self.light.seed == other.light.seed && self.light.shape == other.light.shape
    }
}

/// Contributions that leave the baked light and others that take their place, one unit for whoever reads it.
///
/// Every contribution in `subtract` was in `add` of an earlier update, as the same record, and in no
/// `subtract` since.
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

    /// Lights that have to be accumulated: passes over all receivers, which is what an update costs.
    pub fn accumulations(&self) -> usize {
        let replaced = |old: &&Contribution| self.add.iter().any(|new| old.is_in_place_of(new));
        self.subtract.len() + self.add.len() - self.subtract.iter().filter(replaced).count()
    }

    /// The passes that make up the update: what is subtracted and added in the same place goes in one.
    pub fn passes(&self) -> Vec<Pass<'_>> {
        let mut passes: Vec<Pass<'_>> =
            self.subtract.iter().map(|old| Pass { subtract: Some(old), add: None }).collect();
        for new in &self.add {
            let same = passes
                .iter_mut()
                .find(|pass| pass.add.is_none() && pass.subtract.is_some_and(|old| old.is_in_place_of(new)));
            match same {
                Some(pass) => pass.add = Some(new),
                None => passes.push(Pass { subtract: None, add: Some(new) }),
            }
        }
        passes
    }
}

/// A light that comes, goes, or is replaced by one of the same shape and seed: then its points, and so its
/// shadow rays, are the same ones, and only its flux or the geometry around it differs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pass<'a> {
    /// What leaves.
    pub subtract: Option<&'a Contribution>,
    /// What comes.
    pub add: Option<&'a Contribution>,
}
