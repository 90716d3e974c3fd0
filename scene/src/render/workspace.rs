//! What threads keep from unit to unit.

use std::sync::{Mutex, PoisonError};

use glam::DVec3;
use lighttree::rng::Random;
use lighttree::{Ray, RayHit};

use super::{DirectLighting, IndirectLighting};
use crate::shading::{Geometry, ShadingPoint};

/// Memory of one thread, reused from unit to unit.
pub(super) struct Workspace<Q: Geometry, D: DirectLighting<Q>, I: IndirectLighting<Q>> {
    pub(super) rays: Q::Scratch,
    pub(super) direct: D::Scratch,
    pub(super) indirect: I::Scratch,
    pub(super) camera_rays: Vec<Ray>,
    pub(super) hits: Vec<Option<RayHit>>,
    pub(super) randoms: Vec<Random>,
    pub(super) points: Vec<ShadingPoint>,
    pub(super) slots: Vec<usize>,
    pub(super) lit: Vec<DVec3>,
    pub(super) radiance: Vec<DVec3>,
    pub(super) sums: Vec<(DVec3, u32)>,
}

impl<Q: Geometry, D: DirectLighting<Q>, I: IndirectLighting<Q>> Default for Workspace<Q, D, I> {
    fn default() -> Self {
        Self {
            rays: Q::Scratch::default(),
            direct: D::Scratch::default(),
            indirect: I::Scratch::default(),
            camera_rays: Vec::new(),
            hits: Vec::new(),
            randoms: Vec::new(),
            points: Vec::new(),
            slots: Vec::new(),
            lit: Vec::new(),
            radiance: Vec::new(),
            sums: Vec::new(),
        }
    }
}

/// Workspaces that no thread has at the moment.
pub(super) struct Pool<T>(Mutex<Vec<T>>);

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self(Mutex::new(Vec::new()))
    }
}

impl<T: Default> Pool<T> {
    pub(super) fn take(&self) -> T {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    pub(super) fn give(&self, value: T) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(value);
    }
}
