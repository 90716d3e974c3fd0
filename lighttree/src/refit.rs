//! New bounds for lights that moved or changed, in the same tree.
//!
//! Bounds come from the same two functions that the builders use, so a refit tree has the very bits that
//! building the same topology anew would give. Clusters that have drifted apart make looser bounds, never
//! wrong ones.

use crate::build::{BuildError, emit, survey};
use crate::{Emitter, LightHierarchy, LightId, LightNode, LightTree, PerfectTree};

/// Why a tree was not refit. It is unchanged then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum RefitError {
    /// A light cannot be used at all.
    Light(BuildError),
    /// Not as many lights as the tree was built from: build it anew.
    Count {
        /// Lights that the tree was built from.
        expected: usize,
        /// Lights given.
        given: usize,
    },
    /// This light shines now and did not when the tree was built, so it has no slot: build it anew.
    NewLight {
        /// Index of the light.
        index: usize,
    },
}

impl core::fmt::Display for RefitError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Light(error) => error.fmt(f),
            Self::Count { expected, given } => {
                write!(f, "the tree was built from {expected} lights, not {given}; build it anew")
            }
            Self::NewLight { index } => {
                write!(f, "light {index} did not shine when the tree was built and does now; build it anew")
            }
        }
    }
}

impl core::error::Error for RefitError {}

impl From<BuildError> for RefitError {
    fn from(error: BuildError) -> Self {
        Self::Light(error)
    }
}

/// Looks at all lights as a builder does; the intensity unit of the tree to come.
fn survey_again<E: Emitter + Sync>(
    lights: &[E],
    expected: usize,
    has_slot: impl Fn(usize) -> bool,
) -> Result<f64, RefitError> {
    if lights.len() != expected {
        return Err(RefitError::Count { expected, given: lights.len() });
    }
    let survey = survey::survey(lights)?;
    let shines_now = |&index: &usize| !has_slot(index) && lights[index].bounds().intensity > 0.0;
    match (0..lights.len()).find(shines_now) {
        Some(index) => Err(RefitError::NewLight { index }),
        None => Ok(survey.intensity_unit()),
    }
}

impl LightTree {
    /// Takes the bounds of all lights anew and keeps the topology; a light that went out stays, with
    /// intensity 0.
    ///
    /// # Errors
    /// See [`RefitError`]; the tree is unchanged then.
    pub fn refit(&mut self, lights: &[impl Emitter + Sync]) -> Result<(), RefitError> {
        self.unit = survey_again(lights, self.slot_of.len(), |light| self.slot_of[light] != u32::MAX)?;
        // Children come after their parents.
        for id in (0..self.nodes.len()).rev() {
            let node = self.nodes[id];
            let bounds = if node.is_leaf() {
                let slots = node.first_item as usize..(node.first_item + node.item_count) as usize;
                let inside = self.slots[slots].iter().map(|light| lights[light.0 as usize].bounds());
                LightNode::new(&emit::leaf_bounds(inside, self.unit))
            } else {
                let first = node.first_child as usize;
                emit::parent(&self.nodes[first], &self.nodes[first + 1])
            };
            let LightNode { first_child, item_count, first_item, .. } = node;
            self.nodes[id] = LightNode { first_child, item_count, first_item, ..bounds };
        }
        Ok(())
    }
}

impl PerfectTree {
    /// Takes the bounds of all lights anew and keeps the topology; a light that went out stays, with
    /// intensity 0.
    ///
    /// # Errors
    /// See [`RefitError`]; the tree is unchanged then.
    pub fn refit(&mut self, lights: &[impl Emitter + Sync]) -> Result<(), RefitError> {
        let expected = self.len() + self.dropped();
        let has_slot = |light: usize| self.slot_of(LightId(light as u32)).is_some();
        let unit = survey_again(lights, expected, has_slot)?;
        self.refit_nodes(unit, |light| lights[light.0 as usize].bounds());
        Ok(())
    }
}
