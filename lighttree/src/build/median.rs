//! Object median on the longest axis.
//!
//! Rehfeld and Dachsbacher, "Lightcut Interpolation", 2016, section 5 (their replacement for bottom-up
//! clustering).

use glam::Vec3;

use super::{emit::Item, emit::Splitter, survey::half_center};
use crate::{Emitter, LightId};

pub(crate) struct Median;

#[derive(Clone, Copy)]
pub(crate) struct Place {
    half_center: Vec3,
    light: LightId,
}

impl Place {
    pub(crate) fn new<E: Emitter>(lights: &[E], light: LightId) -> Self {
        Self { half_center: half_center(&lights[light.0 as usize].bounds()), light }
    }
}

impl Item for Place {
    fn light(&self) -> LightId {
        self.light
    }
    fn half_center(&self) -> Vec3 {
        self.half_center
    }
}

impl Splitter for Median {
    type Item = Place;
    type Node = ();

    fn split(&self, items: &mut [Place], (): ()) -> (usize, (), ()) {
        (split(items), (), ())
    }
}

/// The lights that shine.
pub(crate) fn items<E: Emitter>(lights: &[E]) -> Vec<Place> {
    let places = lights.iter().zip(0..).filter_map(|(light, index)| {
        let bounds = light.bounds();
        (bounds.intensity > 0.0).then(|| Place { half_center: half_center(&bounds), light: LightId(index) })
    });
    places.collect()
}

/// Puts the lower half along the longest axis first; ties to the lower light.
pub(crate) fn split<I: Item>(items: &mut [I]) -> usize {
    let start = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (min, max) = items.iter().fold(start, |(min, max), item| {
        let center = item.half_center();
        (min.min(center), max.max(center))
    });
    let axis = (max - min).max_position();
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| {
        a.half_center()[axis].total_cmp(&b.half_center()[axis]).then(a.light().cmp(&b.light()))
    });
    middle
}
