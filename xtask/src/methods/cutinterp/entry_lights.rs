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

use super::lights::{Kind, NodeLight, NodeLights, count_lost};

/// Lights that are shaded at once.
const LANES: usize = 8;

/// By entry of merged cuts: looked up once, in the order in which every point goes through them. 48 bytes
/// each.
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

/// Places and directions of several virtual lights, one axis after the other.
#[derive(Clone, Copy, Debug, Default)]
struct Lanes {
    position: [[f32; LANES]; 3],
    normal: [[f32; LANES]; 3],
}

/// What the lanes give to a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lit {
    /// The geometry term cos·cos/d², not clamped; 0 below either horizon.
    geometry: [f32; LANES],
    /// Cosine between the light and the mirrored viewer; then its power.
    lobes: [f32; LANES],
}

impl Lanes {
    /// What is no virtual light stays dark.
    #[inline]
    fn set(&mut self, lane: usize, node: &NodeLight) {
        for axis in 0..3 {
            self.position[axis][lane] = node.position[axis];
            self.normal[axis][lane] = node.normal[axis];
        }
    }

    fn place(&self, lane: usize) -> Vec3 {
        Vec3::from_array(self.position.map(|axis| axis[lane]))
    }

    /// In f32, for scenes of plain scale. Lanes that were not set are dark.
    #[inline]
    fn light<const GLOSSY: bool>(&self, point: &ShadingPoint) -> Lit {
        let mirror = 2.0 * point.normal.dot(point.wo) * point.normal - point.wo;
        let mut lit = Lit { geometry: [0.0; LANES], lobes: [0.0; LANES] };
        let [x, y, z] = &self.position;
        let [nx, ny, nz] = &self.normal;
        for lane in 0..LANES {
            let to = Vec3::new(x[lane], y[lane], z[lane]) - point.position;
            let at_light = -(nx[lane] * to.x + ny[lane] * to.y + nz[lane] * to.z);
            let (at_point, above) = (point.normal.dot(to), point.geometric_normal.dot(to));
            let inverse_squared = 1.0 / to.length_squared();
            let geometry = at_light * at_point * inverse_squared * inverse_squared;
            let faces = at_light.min(at_point).min(above) > 0.0;
            lit.geometry[lane] = if faces { geometry } else { 0.0 };
            if GLOSSY {
                lit.lobes[lane] = mirror.dot(to) * inverse_squared.sqrt();
            }
        }
        lit
    }
}

/// cosⁿ for several cosines at once.
struct Power<'a> {
    phong: &'a Phong,
    /// The lobe at the mirror direction, sr⁻¹.
    scale: f32,
    /// n where it is a whole number that few multiplications reach, else 0.
    whole: u32,
    /// The cosine whose power is e⁻⁸⁰: what is smaller counts as 0, so that no number is too small for a fast
    /// multiplication.
    least: f32,
}

impl<'a> Power<'a> {
    fn of(phong: &'a Phong) -> Self {
        let n = phong.exponent;
        // Each multiplication may be off by 2⁻²⁴.
        let whole = if n.fract() == 0.0 && (1.0..=512.0).contains(&n) { n as u32 } else { 0 };
        Self { phong, scale: phong.lobe(1.0), whole, least: (-80.0 / n).exp() }
    }

    /// Replaces cosines by their powers; what is no number by 0.
    #[inline]
    fn raise(&self, cosines: &mut [f32; LANES]) {
        let Self { phong, scale, whole, least } = *self;
        if whole == 0 {
            *cosines = cosines.map(|cos| if cos >= least { phong.lobe(cos) / scale } else { 0.0 });
            return;
        }
        let mut square = cosines.map(|cos| if cos >= least { cos.min(1.0) } else { 0.0 });
        let mut power = [1.0; LANES];
        let mut left = whole;
        loop {
            if left & 1 != 0 {
                (0..LANES).for_each(|lane| power[lane] *= square[lane]);
            }
            left >>= 1;
            if left == 0 {
                break;
            }
            (0..LANES).for_each(|lane| square[lane] *= square[lane]);
        }
        *cosines = power;
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use lighttree::rng::Random;
    use lighttree::{GeometricBound, LightBounds, LightId, NodeBound};
    use scene::bsdf::{Bsdf, Phong};
    use scene::{Counts, Frame, Light, SceneRays, ShadingPoint, builtin};

    use super::super::super::lightcut::peak_intensity;
    use super::super::lights::one;
    use super::{Chosen, EntryLights, Kind, LANES, Lanes, NodeLight, QuickBounds};

    /// Several lights at once are what each of them is by itself: below horizons, clamped, at the point
    /// itself, in and out of the lobe, whose exponent may be a whole number or none.
    #[test]
    fn lanes_are_single_lights() {
        let scene = builtin("cornell").unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        let mut random = Random::new(3, 0, 0);
        let mut unit = || {
            let mut any = || 2.0 * random.f32() - 1.0;
            Vec3::new(any(), any(), any()).try_normalize().unwrap_or(Vec3::Y)
        };
        let (mut lit, mut clamped, mut glossy) = (0, 0, 0);
        for i in 0..8000u32 {
            let normal = unit();
            let wo = unit();
            let albedo = Vec3::new(0.5, 0.6, 0.7);
            let bsdf = match i % 4 {
                0 => Bsdf::Lambert { albedo },
                1 => Bsdf::Phong(Phong::over(albedo, 20.5)),
                2 => Bsdf::Phong(Phong::over(albedo, 150.0)),
                _ => Bsdf::Phong(Phong::over(albedo, 20.0)),
            };
            let point = ShadingPoint {
                position: unit(),
                geometric_normal: normal,
                normal,
                wo: if wo.dot(normal) < 0.0 { -wo } else { wo },
                bsdf,
                throughput: Vec3::ONE,
                pixel: 0,
                sample: 0,
                offset: 0.0,
            };
            let (at, intensity) = (i as usize % 11, Vec3::new(3.0, 2.0, 1.0));
            let mirrored = 2.0 * normal.dot(point.wo) * normal - point.wo;
            let position = match i % 50 {
                0 => point.position,
                1..10 => point.position + mirrored + 0.1 * unit(),
                _ => unit(),
            };
            let normal = unit();
            let lights = [Light::Vpl { position, normal, intensity }];
            let frame = Frame { vpl_clamp: 1.0, ..Frame::new(&scene, &rays, &lights, 1) };
            let (light, kind) = (LightId(0), Kind::Virtual);
            let node = NodeLight { position, light, normal, kind, intensity, near_squared: 0.0 };
            let mut entries = EntryLights {
                lanes: vec![Lanes::default(); 2],
                intensity: vec![intensity; 11],
                ids: vec![LightId(0); 11],
                kinds: vec![Kind::Virtual; 11],
                near_squared: vec![0.0; 11],
                with_area: vec![],
                bounds: QuickBounds::default(),
                plain_scale: true,
                skips_area: false,
            };
            entries.lanes[at / LANES].set(at % LANES, &node);
            let chosen: Vec<Chosen> = (0..11).map(|entry| Chosen { entry, visibility: 1.0 }).collect();
            let (mut out, mut counts, mut alone) = (vec![], Counts::default(), Counts::default());
            entries.unoccluded(&frame, &point, &chosen, &mut vec![], &mut out, &mut vec![], &mut counts);
            let (expected, _) = one(&frame, &point, (LightId(0), intensity), 1.0, &mut alone);
            let error = (out[at] - expected).abs().max_element();
            assert!(error <= 1e-4 * expected.max_element() + 1e-6, "{i}: {} is not {expected}", out[at]);
            let off = (counts.clamped_luminance - alone.clamped_luminance).abs();
            assert!(off <= 1e-3 * alone.clamped_luminance + 1e-4, "{i}: {counts:?} is not {alone:?}");
            assert!(counts.clamped == alone.clamped || (off < 1e-4 && error < 1e-4));
            out.remove(at);
            assert!(out.iter().all(|&other| other == Vec3::ZERO), "what was not set is dark");
            lit += u32::from(expected != Vec3::ZERO);
            clamped += counts.clamped;
            let in_lobe = mirrored.dot((position - point.position).normalize_or_zero()) > 0.95;
            glossy += u32::from(in_lobe && i % 4 > 0 && expected != Vec3::ZERO);
        }
        assert!(lit > 1000 && clamped > 50 && glossy > 100, "{lit} lit, {clamped} clamped, {glossy} glossy");
    }

    /// No entry that may break the bound goes unnoticed, and most others do.
    #[test]
    fn what_is_not_above_is_below_its_bound() {
        let mut random = Random::new(4, 0, 0);
        let (mut above, mut missed, mut noticed) = (vec![], 0, 0);
        for i in 0..500u32 {
            let mut any = || Vec3::new(random.f32(), random.f32(), random.f32()) * 2.0 - 1.0;
            let nodes: Vec<LightBounds> = (0..21)
                .map(|_| {
                    let (at, size) = (3.0 * any(), 0.1 * any().abs());
                    LightBounds::surface(
                        at - size,
                        at + size,
                        any().normalize_or(Vec3::Y),
                        false,
                        any().x.abs(),
                    )
                })
                .collect();
            let (normal, wo, albedo) = (any().normalize_or(Vec3::Y), any(), Vec3::new(0.2, 0.8, 0.5));
            let wo = if wo.dot(normal) < 0.0 { -wo } else { wo }.normalize_or(normal);
            let glossy = Bsdf::Phong(Phong::over(albedo, 150.0));
            let point = ShadingPoint {
                position: 0.1 * any(),
                geometric_normal: normal,
                normal,
                wo,
                bsdf: if i % 2 == 0 { Bsdf::Lambert { albedo } } else { glossy },
                throughput: Vec3::ONE,
                pixel: 0,
                sample: 0,
                offset: 0.0,
            };
            let mut entries = EntryLights { plain_scale: true, ..EntryLights::default() };
            nodes.iter().for_each(|node| entries.bounds.push(node));
            let exact: Vec<f64> = nodes.iter().map(|node| GeometricBound.bound(node, &point).upper).collect();
            let mut in_order = exact.clone();
            in_order.sort_by(f64::total_cmp);
            let limit = in_order[15];
            entries.above(&point, limit, &mut above);
            for (j, exact) in exact.iter().enumerate() {
                let suspected = above[j / 8] >> (j % 8) & 1 != 0;
                assert!(suspected || *exact <= limit, "{i}: {exact} is above {limit}");
                noticed += u32::from(!suspected);
                missed += u32::from(suspected && *exact < limit);
            }
            entries.plain_scale = false;
            entries.above(&point, limit, &mut above);
            assert!(above.is_empty(), "nobody can say");
        }
        assert!(noticed > 4 * missed, "{missed} asked for nothing, {noticed} not asked");
    }

    /// The middle of a triangle far away gives what the mean of many places on it does; near by, and from
    /// both sides, nobody takes it.
    #[test]
    fn a_far_triangle_is_its_middle() {
        let scene = builtin("cornell").unwrap();
        let rays = SceneRays::build(&scene).unwrap();
        let mut random = Random::new(5, 0, 0);
        let (mut far, mut near) = (0, 0);
        for i in 0..600u32 {
            let mut any = || Vec3::new(random.f32(), random.f32(), random.f32()) * 2.0 - 1.0;
            let (middle, size) = (4.0 * any(), [0.02, 0.5][i as usize % 2]);
            let vertices = [(); 3].map(|()| middle + size * any());
            let two_sided = i % 5 == 4;
            let radiance = Vec3::new(3.0, 2.0, 1.0);
            let light = Light::Triangle { vertices, radiance, two_sided, instance: u32::MAX, triangle: 0 };
            let lights = [light];
            let frame = Frame { vpl_clamp: 1e-6, ..Frame::new(&scene, &rays, &lights, 1) };
            let normal = any().normalize_or(Vec3::Y);
            let bsdf = Bsdf::Lambert { albedo: Vec3::new(0.5, 0.6, 0.7) };
            let point = ShadingPoint {
                position: Vec3::ZERO,
                geometric_normal: normal,
                normal,
                wo: normal,
                bsdf,
                throughput: Vec3::ONE,
                pixel: 0,
                sample: 0,
                offset: 0.0,
            };
            let intensity = peak_intensity(&lights[0]);
            let node = NodeLight::of_light(&lights[0], LightId(0), intensity);
            let mut entries = EntryLights { plain_scale: true, ..EntryLights::default() };
            entries.push(&node, None);
            let chosen = [Chosen { entry: 0, visibility: 1.0 }];
            let (mut out, mut asked, mut counts) = (vec![], vec![], Counts::default());
            entries.unoccluded(&frame, &point, &chosen, &mut vec![], &mut out, &mut asked, &mut counts);
            assert_eq!(counts.clamped, 0, "lamps are not clamped");
            let is_near = lights[0].is_near(point.position, 0.0);
            assert_eq!(entries.is_near(0, &point), is_near || two_sided, "{i}");
            if is_near || two_sided {
                near += 1;
                continue;
            }
            let mut sum = Vec3::ZERO;
            for place in 0..256 {
                let u = [(place as f32 + 0.5) / 256.0, (place as f32 * 0.618_034).fract()];
                sum += point.contribution(&lights[0].point_by_area(&scene, u));
            }
            let mean = sum / 256.0;
            // What the light's horizon or the point's cuts through varies without a bound.
            let peak = intensity / middle.length_squared() * 0.7 / core::f32::consts::PI;
            let off = (out[0] - mean).abs().max_element();
            assert!(off <= 0.01 * mean.max_element() + 0.02 * peak.max_element(), "{i}: {} {mean}", out[0]);
            far += u32::from(mean != Vec3::ZERO);
        }
        assert!(far > 40 && near > 100, "{far} far, {near} near");
    }

    #[test]
    fn lights_with_an_area_are_found_among_the_chosen() {
        let entries = EntryLights {
            intensity: (0..9).map(|i| Vec3::splat(i as f32)).collect(),
            ids: (10..19).map(LightId).collect(),
            with_area: vec![0, 3, 4, 8],
            ..EntryLights::default()
        };
        let chosen = [0, 1, 4, 5, 7].map(|entry| Chosen { entry, visibility: 1.0 });
        let mut found = vec![7];
        entries.chosen_with_area(&chosen, &mut found);
        assert_eq!(found, [0, 2]);
        assert_eq!(entries.light(4), (LightId(14), Vec3::splat(4.0)));
        entries.chosen_with_area(&[], &mut found);
        assert!(found.is_empty());
    }
}
