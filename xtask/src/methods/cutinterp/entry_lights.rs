//! The lights of merged cuts, side by side as the cuts' entries are, for all points that share them.
//!
//! A triangle far away is its middle here: what a place on it gives varies by a tenth at most, the middle
//! gives nearly the mean, and it goes eight at a time, where places drawn at random go one by one.

use core::f32::consts::FRAC_1_PI;

use cutinterp::{Chosen, MergedCuts, QuickBounds};
use glam::Vec3;
use lighttree::{LambertReceiver, LightBounds, LightId, PhongReceiver, Segment};
use scene::bsdf::{Bsdf, Phong};
use scene::{Counts, Frame, Geometry, ShadingPoint};

use self::lanes::{LANES, Lanes, Power};
use super::lights::{Kind, NodeLight, NodeLights, count_lost};

mod lanes;
#[cfg(test)]
mod tests;

pub(super) use self::lanes::Lit;

/// By entry of merged cuts: looked up once, in the order in which every point goes through them. 45 bytes
/// each, 4 more for lights with an area.
#[derive(Debug, Default)]
pub(super) struct EntryLights {
    /// Places and directions of the virtual ones and of triangles' middles; the others are dark.
    lanes: Vec<Lanes>,
    /// RGB intensity of the cluster.
    intensity: Vec<Vec3>,
    ids: Vec<LightId>,
    kinds: Vec<Kind>,
    /// See [`NodeLight::near_squared`].
    near_squared: Vec<f32>,
    /// Entries whose lights have an area, ascending.
    with_area: Vec<u32>,
    /// Bounds of what entries may send, as luminance; empty if nobody asks. 48 bytes each.
    bounds: QuickBounds,
    plain_scale: bool,
    /// Whether points ask lights with an area themselves, so that what these give need not be known before.
    skips_area: bool,
}

impl EntryLights {
    /// Looks up the lights of all entries of `merged`; replaces those that were here.
    pub(super) fn look_up(&mut self, lights: &NodeLights, merged: &MergedCuts) {
        self.clear(lights.plain_scale());
        self.skips_area = lights.skips_area();
        merged.nodes().for_each(|node| self.push(lights.at(node), lights.bounds(node)));
    }

    /// Takes all entries out. `plain_scale`: whether squares of distances between anything in the scene are
    /// well within f32.
    pub(super) fn clear(&mut self, plain_scale: bool) {
        self.plain_scale = plain_scale;
        self.lanes.clear();
        self.intensity.clear();
        self.ids.clear();
        self.kinds.clear();
        self.near_squared.clear();
        self.with_area.clear();
        self.bounds.clear();
    }

    /// Adds an entry; `bounds` for all or for none.
    pub(super) fn push(&mut self, node: &NodeLight, bounds: Option<&LightBounds>) {
        let at = self.ids.len();
        if at.is_multiple_of(LANES) {
            self.lanes.push(Lanes::default());
        }
        self.lanes[at / LANES].set(at % LANES, node);
        if let Some(bounds) = bounds {
            self.bounds.push(bounds);
        }
        self.intensity.push(node.intensity);
        self.ids.push(node.light);
        self.kinds.push(node.kind);
        self.near_squared.push(node.near_squared);
        if node.kind == Kind::Area {
            self.with_area.push(at as u32);
        }
    }

    /// RGB light that each of the `chosen` entries gives to `point` without shadow; replaces what is in
    /// `out`. Nothing for lights with an area where points ask these themselves. What clamps take away is counted as far as it is seen by interpolated visibility, whatever the
    /// mode. Places among the chosen of lights that are too near for one place on them go into `near`.
    #[expect(clippy::too_many_arguments, reason = "a point, its cut, and the memory of one thread")]
    pub(super) fn unoccluded<Q: Geometry>(
        &self,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        chosen: &[Chosen],
        lit: &mut Vec<Lit>,
        out: &mut Vec<Vec3>,
        near: &mut Vec<u32>,
        counts: &mut Counts,
    ) {
        out.clear();
        near.clear();
        match &point.bsdf {
            Bsdf::Lambert { albedo } if self.plain_scale => {
                lit.clear();
                lit.extend(self.lanes.iter().map(|lanes| lanes.light::<false>(point)));
                let scatter = *albedo * FRAC_1_PI;
                self.gather(frame, point, chosen, (lit, |_| scatter), out, near, counts);
            }
            Bsdf::Phong(phong) if self.plain_scale => {
                let power = Power::of(phong);
                lit.clear();
                lit.extend(self.lanes.iter().map(|lanes| {
                    let mut lit = lanes.light::<true>(point);
                    power.raise(&mut lit.lobes);
                    lit
                }));
                let (diffuse, lobe) = (phong.diffuse * FRAC_1_PI, phong.specular * power.scale);
                self.gather(frame, point, chosen, (lit, |power| diffuse + lobe * power), out, near, counts);
            }
            _ => {
                let one = |(at, chosen)| self.one(frame, point, (at, chosen), near, counts);
                out.extend((0..).zip(chosen).map(one));
            }
        }
    }

    /// Picks the `chosen` ones out of all entries' light; `scatter` is the surface's, given the lobe.
    #[expect(clippy::too_many_arguments, reason = "a point, its cut, and the memory of one thread")]
    fn gather<Q: Geometry>(
        &self,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        chosen: &[Chosen],
        (lit, scatter): (&[Lit], impl Fn(f32) -> Vec3),
        out: &mut Vec<Vec3>,
        near: &mut Vec<u32>,
        counts: &mut Counts,
    ) {
        let clamp = frame.vpl_clamp;
        out.extend((0..).zip(chosen).map(|(index, chosen)| {
            let at = chosen.entry as usize;
            if self.skips_area && self.kinds[at] == Kind::Area {
                return Vec3::ZERO;
            }
            if self.kinds[at] == Kind::Point || self.is_near(at, point) {
                return self.one(frame, point, (index, chosen), near, counts);
            }
            let (block, lane) = (&lit[at / LANES], at % LANES);
            let unclamped = self.intensity[at] * scatter(block.lobes[lane]);
            let geometry = block.geometry[lane];
            if self.kinds[at] == Kind::Area {
                return unclamped * geometry;
            }
            if geometry > clamp {
                counts.clamped += 1;
                count_lost(point, unclamped * (geometry - clamp), chosen.visibility, counts);
            }
            unclamped * geometry.min(clamp)
        }));
    }

    /// Whether the middle of an entry's light says too little to this point.
    fn is_near(&self, at: usize, point: &ShadingPoint) -> bool {
        let near = self.near_squared[at];
        let place = || self.lanes[at / LANES].place(at % LANES);
        near > 0.0 && (near == f32::INFINITY || place().distance_squared(point.position) <= near)
    }

    /// RGB light that the chosen entry at `index` gives to `point` without shadow, for any light and any
    /// surface.
    fn one<Q: Geometry>(
        &self,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        (index, chosen): (u32, &Chosen),
        near: &mut Vec<u32>,
        counts: &mut Counts,
    ) -> Vec3 {
        let at = chosen.entry as usize;
        if self.skips_area && self.kinds[at] == Kind::Area {
            return Vec3::ZERO;
        }
        let light = (self.ids[at], self.intensity[at]);
        let (light, is_near) = super::lights::one(frame, point, light, chosen.visibility, counts);
        if is_near {
            near.push(index);
        }
        light
    }

    /// The light that speaks for an entry, and the RGB intensity of the cluster.
    pub(super) fn light(&self, entry: u32) -> (LightId, Vec3) {
        (self.ids[entry as usize], self.intensity[entry as usize])
    }

    /// Places among the `chosen` of those whose lights have an area.
    pub(super) fn chosen_with_area(&self, chosen: &[Chosen], places: &mut Vec<u32>) {
        places.clear();
        // Both ascend.
        let mut from = 0;
        places.extend(self.with_area.iter().filter_map(|&entry| {
            from += chosen[from..].partition_point(|chosen| chosen.entry < entry);
            chosen.get(from).is_some_and(|chosen| chosen.entry == entry).then_some(from as u32)
        }));
    }

    /// Whether an entry's bound may be above `limit` at `point`, as luminance, as bits of bytes; no byte
    /// where nobody can say quickly.
    pub(super) fn above(&self, point: &ShadingPoint, limit: f64, above: &mut Vec<u8>) {
        let ShadingPoint { position, normal, wo: view, .. } = *point;
        // Downwards.
        let limit = (limit as f32).next_down();
        match &point.bsdf {
            Bsdf::Lambert { albedo } if self.plain_scale => {
                let albedo = albedo.max_element();
                self.bounds.above(&(&LambertReceiver { position, normal, albedo }).into(), limit, above);
            }
            &Bsdf::Phong(Phong { diffuse, specular, exponent }) if self.plain_scale => {
                let (diffuse, specular) = (diffuse.max_element(), specular.max_element());
                let receiver = PhongReceiver { position, normal, view, diffuse, specular, exponent };
                self.bounds.above(&(&receiver).into(), limit, above);
            }
            _ => above.clear(),
        }
    }

    /// The light that speaks for an entry and its place, if it is the same for all points.
    pub(super) fn at_one_place(&self, entry: u32) -> Option<(LightId, Vec3)> {
        let at = entry as usize;
        let place = || self.lanes[at / LANES].place(at % LANES);
        (self.kinds[at] == Kind::Virtual).then(|| (self.ids[at], place()))
    }

    /// The shadow ray from `point` to the light that speaks for an entry, and that light.
    pub(super) fn segment<Q: Geometry>(
        &self,
        frame: &Frame<'_, Q>,
        point: &ShadingPoint,
        entry: u32,
    ) -> (Segment, LightId) {
        let light = self.ids[entry as usize];
        let segment = match self.at_one_place(entry) {
            Some((_, place)) => Segment { from: point.origin(), to: place },
            None => point.segment(&super::lights::placed(frame, point, light).0),
        };
        (segment, light)
    }
}
