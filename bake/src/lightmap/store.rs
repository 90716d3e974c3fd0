//! The lightmap itself: texels, their sums of light, and the updates that change them.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{Affine3A, Vec3};

use super::coverage::{CoverageReport, Site, cover, sample_positions};
use super::fixed_point::{FixedPoint, FixedPointCounts};
use super::gather::{Gather, Scratch};
use super::layout::{Layout, LayoutError, LayoutParams, MeshView, ObjectView, Placement};
use super::parallel;
use super::receivers::{LightmapRays, ReceiverReport, Sample, Standing};
use crate::{Contribution, GeometryVersion, Update};

/// Texels that are worked on together, neighbours on one object.
pub(super) const CHUNK: usize = 64;
/// Chunks between two looks at the clock.
const BATCH: usize = 64;

/// How a lightmap is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightmapParams {
    /// Charts and pages.
    pub layout: LayoutParams,
    /// Samples of each texel, 1 to 16: points of its area at which light is gathered, and their mean taken. More smooth the edges of shadows, at
    /// so many times the rays and 28 bytes a texel each.
    pub samples: u32,
    /// Whether to keep four coefficients of spherical harmonics of the arriving radiance in place of the irradiance alone, for normal maps.
    pub directional: bool,
    /// The largest irradiance to be expected, W·m⁻²: sets the quantum (see [`FixedPoint::for_peak`]).
    pub peak: f64,
}

impl Default for LightmapParams {
    fn default() -> Self {
        Self { layout: LayoutParams::default(), samples: 1, directional: false, peak: 1e6 }
    }
}

/// A lightmap that is changed by [`Update`]s and comes back to the same bits when they are undone. `R` answers rays, one for each version of
/// the geometry.
///
/// # Memory
/// A covered texel takes 12 bytes of place (4, and 8 a sample), 20 a sample in the world, 24 of sums and 12 of the values that readers see: 68 with one sample,
/// plus 2 for the chunks it is in. Each further sample takes 28, directional maps 108 more. A version of the geometry that is kept shares the
/// chunks that it has in common with the next.
pub struct Lightmap<R> {
    pub(super) layout: Layout,
    meshes: Vec<HostMesh>,
    host_mesh: Vec<u32>,
    samples: u32,
    directional: bool,
    pub(super) chunks: Vec<ChunkPlace>,
    pub(super) pixels: Vec<[u16; 2]>,
    sites: Vec<Site>,
    coverage: CoverageReport,
    fixed: FixedPoint,
    sums: Vec<Box<[i64]>>,
    counts: FixedPointCounts,
    versions: BTreeMap<GeometryVersion, Version<R>>,
    current: Option<GeometryVersion>,
    job: Option<Job>,
    front: Arc<Published>,
    updates: u64,
    accumulations: u64,
}

/// Vertices that stay as the host had them.
struct HostMesh {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    min: Vec3,
    max: Vec3,
}

/// Where a chunk's texels are.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChunkPlace {
    pub(super) object: u32,
    /// First texel, of all.
    pub(super) first: u32,
    pub(super) count: u32,
}

impl ChunkPlace {
    pub(super) fn texels(&self) -> core::ops::Range<usize> {
        self.first as usize..(self.first + self.count) as usize
    }
}

/// A chunk in the world under some versions.
pub(super) struct Chunk {
    min: Vec3,
    max: Vec3,
    pub(super) samples: Box<[Sample]>,
}

/// One state of the geometry, for as long as something in the map was lit under it.
pub(super) struct Version<R> {
    pub(super) rays: R,
    objects: Vec<Option<Affine3A>>,
    pub(super) chunks: Vec<Option<Arc<Chunk>>>,
    /// Longer than any way out of the scene.
    pub(super) far: f32,
    /// Contributions in the map that name this version.
    live: u64,
    report: ReceiverReport,
}

/// An update under way: it is in the sums of the first chunks.
struct Job {
    update: Update,
    next: usize,
    touched: Vec<bool>,
}

/// What readers see: the light of every texel after a whole number of updates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Published {
    /// Updates that it holds.
    pub updates: u64,
    /// Values by texel: three of irradiance, W·m⁻², or twelve of radiance in spherical harmonics (coefficient by coefficient, RGB each, W·m⁻²·sr⁻¹).
    pub values: Vec<f32>,
}

/// Why an update or a geometry cannot be taken.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum LightmapError {
    /// A contribution names a version that isn't held.
    Version {
        /// The version.
        version: GeometryVersion,
    },
    /// An update is under way; finish it first.
    Busy,
    /// As many transforms as the lightmap has objects are needed.
    Objects {
        /// Objects of the lightmap.
        expected: usize,
        /// Transforms given.
        given: usize,
    },
    /// A version that is held already.
    Again {
        /// The version.
        version: GeometryVersion,
    },
    /// Saved sums of another lightmap.
    Saved {
        /// What differs.
        why: &'static str,
    },
}

impl core::fmt::Display for LightmapError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Version { version } => {
                write!(f, "geometry version {} is not held: give it with set_geometry first", version.0)
            }
            Self::Busy => f.write_str("an update is under way: call work until it is done"),
            Self::Objects { expected, given } => {
                write!(
                    f,
                    "{given} transforms for {expected} objects: give one for each, or none for an absent one"
                )
            }
            Self::Again { version } => write!(f, "geometry version {} is held already", version.0),
            Self::Saved { why } => write!(f, "the saved sums are of another lightmap: {why}"),
        }
    }
}

impl core::error::Error for LightmapError {}

/// Whether there is more to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// Nothing is under way; readers see every update.
    Done,
    /// An update is in the sums in part; readers see none of it.
    UnderWay,
}

impl<R: LightmapRays> Lightmap<R> {
    /// A black lightmap for `objects`, and charts for them.
    ///
    /// # Errors
    /// [`LayoutError`]: what cannot be unwrapped, parameters out of their range.
    pub fn new(
        meshes: &[MeshView<'_>],
        objects: &[ObjectView],
        params: &LightmapParams,
    ) -> Result<Self, LayoutError> {
        if !(1..=16).contains(&params.samples) {
            return Err(LayoutError::Params {
                why: format!("{} samples a texel: from 1 to 16", params.samples),
            });
        }
        let layout = Layout::build(meshes, objects, &params.layout)?;
        let positions = sample_positions(params.samples);
        let mut coverage = CoverageReport::default();
        let (mut chunks, mut pixels, mut sites) = (Vec::new(), Vec::new(), Vec::new());
        for object in 0..objects.len() {
            let texels = cover(&layout, object, &positions, &mut coverage);
            for part in (0..texels.pixels.len()).step_by(CHUNK) {
                let count = CHUNK.min(texels.pixels.len() - part) as u32;
                chunks.push(ChunkPlace { object: object as u32, first: (pixels.len() + part) as u32, count });
            }
            pixels.extend(texels.pixels);
            sites.extend(texels.sites);
        }
        pixels.shrink_to_fit();
        sites.shrink_to_fit();
        let channels = if params.directional { 12 } else { 3 };
        let sums = chunks.iter().map(|chunk| vec![0; channels * chunk.count as usize].into()).collect();
        let host = meshes.iter().map(|mesh| {
            let (min, max) = bounds(mesh.positions.iter().copied());
            HostMesh { positions: mesh.positions.to_vec(), normals: mesh.normals.to_vec(), min, max }
        });
        let values = vec![0.0; channels * pixels.len()];
        Ok(Self {
            meshes: host.collect(),
            host_mesh: objects.iter().map(|object| object.mesh).collect(),
            samples: params.samples,
            directional: params.directional,
            chunks,
            pixels,
            sites,
            coverage,
            fixed: FixedPoint::for_peak(params.peak),
            sums,
            counts: FixedPointCounts::default(),
            versions: BTreeMap::new(),
            current: None,
            job: None,
            front: Arc::new(Published { updates: 0, values }),
            updates: 0,
            accumulations: 0,
            layout,
        })
    }

    /// Takes a new state of the geometry, under which light is added from now on: rays, and where objects stand (`None`: absent). Receivers are made
    /// anew for objects that moved and for what the boxes of these touch, before or after; all others are shared with the last version.
    ///
    /// A version is let go of at the end of an update once nothing in the map was lit under it and another one is current.
    ///
    /// # Errors
    /// A wrong number of objects, a version that is there already, an update under way.
    pub fn set_geometry(
        &mut self,
        version: GeometryVersion,
        rays: R,
        objects: &[Option<Affine3A>],
    ) -> Result<(), LightmapError> {
        if self.job.is_some() {
            return Err(LightmapError::Busy);
        }
        if objects.len() != self.host_mesh.len() {
            return Err(LightmapError::Objects { expected: self.host_mesh.len(), given: objects.len() });
        }
        if self.versions.contains_key(&version) {
            return Err(LightmapError::Again { version });
        }
        let last = self.current.and_then(|current| self.versions.get(&current));

        // What changed, as boxes.
        let mut changed = Vec::new();
        for (object, now) in objects.iter().enumerate() {
            let before = last.and_then(|last| last.objects[object]);
            if before != *now {
                changed.extend([before, *now].into_iter().flatten().map(|at| self.world_box(object, at)));
            }
        }
        let all = objects.iter().enumerate().filter_map(|(o, at)| at.map(|at| self.world_box(o, at)));
        let (min, max) =
            all.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), (c, d)| (a.min(c), b.max(d)));
        let far = if min.cmple(max).all() { 2.0 * (max - min).length() + f32::MIN_POSITIVE } else { 1.0 };

        let made = parallel::map(&self.chunks, R::Scratch::default, |index, place, scratch| {
            let at = objects[place.object as usize]?;
            let mut report = ReceiverReport::default();
            if let Some(last) = last
                && last.objects[place.object as usize] == Some(at)
                && let Some(chunk) = &last.chunks[index]
                && !changed
                    .iter()
                    .any(|(min, max)| chunk.min.cmple(*max).all() && chunk.max.cmpge(*min).all())
            {
                return Some((Arc::clone(chunk), report));
            }
            let chunk = self.chunk(place, at, &rays, scratch, &mut report);
            Some((Arc::new(chunk), report))
        });
        let mut report = ReceiverReport::default();
        let chunks = made.into_iter().map(|made| {
            made.map(|(chunk, part)| {
                report += part;
                chunk
            })
        });
        let chunks = chunks.collect();
        let objects = objects.to_vec();
        self.versions.insert(version, Version { rays, objects, chunks, far, live: 0, report });
        self.current = Some(version);
        Ok(())
    }

    fn world_box(&self, object: usize, at: Affine3A) -> (Vec3, Vec3) {
        let mesh = &self.meshes[self.host_mesh[object] as usize];
        let corner = |i: u32| {
            let pick = |bit: u32, low: f32, high: f32| if i & bit == 0 { low } else { high };
            let (min, max) = (mesh.min, mesh.max);
            at.transform_point3(Vec3::new(
                pick(1, min.x, max.x),
                pick(2, min.y, max.y),
                pick(4, min.z, max.z),
            ))
        };
        bounds((0..8).map(corner))
    }

    /// A chunk's samples where its object stands now.
    fn chunk(
        &self,
        place: &ChunkPlace,
        to_world: Affine3A,
        rays: &R,
        scratch: &mut R::Scratch,
        report: &mut ReceiverReport,
    ) -> Chunk {
        let placement = self.layout.objects[place.object as usize].as_ref().expect("a chunk has texels");
        let mesh = &self.meshes[self.host_mesh[place.object as usize] as usize];
        let standing = Standing {
            mesh: &self.layout.meshes[placement.charted as usize],
            positions: &mesh.positions,
            normals: &mesh.normals,
            placement,
            to_world,
        };
        let texels = place.texels();
        let sites = &self.sites[texels.start * self.samples as usize..texels.end * self.samples as usize];
        let samples: Box<[Sample]> =
            sites.iter().map(|&site| standing.sample(site, rays, scratch, report)).collect();
        let (min, max) = bounds(samples.iter().map(|sample| sample.position));
        // What comes within a texel of a sample may push it.
        let reach = sites.iter().map(|&site| standing.texel_length(site)).fold(f32::MIN_POSITIVE, f32::max);
        let reach = Vec3::splat(reach);
        Chunk { min: min - reach, max: max + reach, samples }
    }

    /// Begins an update. [`work`](Self::work) carries it out.
    ///
    /// # Errors
    /// An update under way, or a version that isn't held.
    pub fn begin(&mut self, update: Update) -> Result<(), LightmapError> {
        self.check(&update)?;
        let touched = vec![false; self.chunks.len()];
        self.job = Some(Job { update, next: 0, touched });
        Ok(())
    }

    fn check(&self, update: &Update) -> Result<(), LightmapError> {
        if self.job.is_some() {
            return Err(LightmapError::Busy);
        }
        let all = update.subtract.iter().chain(&update.add);
        match all.map(|c| c.version).find(|version| !self.versions.contains_key(version)) {
            Some(version) => Err(LightmapError::Version { version }),
            None => Ok(()),
        }
    }

    /// Works on the update under way for as long as `keep_going` says so, asked every few thousand texels; at least that much is done. Readers see the
    /// update when all of it is done, and nothing of it before.
    pub fn work(&mut self, mut keep_going: impl FnMut() -> bool) -> Work {
        let Some(mut job) = self.job.take() else { return Work::Done };
        while job.next < self.chunks.len() {
            let batch = job.next..(job.next + BATCH).min(self.chunks.len());
            self.accumulate(&mut job, batch.clone());
            job.next = batch.end;
            if job.next < self.chunks.len() && !keep_going() {
                self.job = Some(job);
                return Work::UnderWay;
            }
        }
        self.note(&job.update);
        self.publish(&job.touched);
        Work::Done
    }

    /// [`begin`](Self::begin) and [`work`](Self::work) to the end.
    ///
    /// # Errors
    /// As [`begin`](Self::begin).
    pub fn apply(&mut self, update: &Update) -> Result<(), LightmapError> {
        self.begin(update.clone())?;
        self.work(|| true);
        Ok(())
    }

    /// Counts contributions, and lets versions go that none names any more.
    fn note(&mut self, update: &Update) {
        for contribution in &update.add {
            if let Some(version) = self.versions.get_mut(&contribution.version) {
                version.live += 1;
            }
        }
        for contribution in &update.subtract {
            if let Some(version) = self.versions.get_mut(&contribution.version) {
                version.live = version.live.saturating_sub(1);
            }
        }
        self.updates += 1;
        self.accumulations += update.accumulations() as u64;
        self.let_go();
    }

    fn let_go(&mut self) {
        let current = self.current;
        self.versions.retain(|&version, state| state.live > 0 || Some(version) == current);
    }

    /// All contributions of the job into a range of chunks.
    fn accumulate(&mut self, job: &mut Job, batch: core::ops::Range<usize>) {
        let gather = Gather {
            versions: &self.versions,
            samples: self.samples as usize,
            fixed: self.fixed,
            directional: self.directional,
        };
        let sums = &mut self.sums[batch.clone()];
        let places = &self.chunks[batch.clone()];
        let done = parallel::map_mut(sums, Scratch::<R>::default, |i, sums, scratch| {
            let (index, place) = (batch.start + i, places[i]);
            let mut counts = FixedPointCounts::default();
            let mut touched = false;
            for contribution in &job.update.subtract {
                touched |= gather.contribution(contribution, -1, index, place, sums, scratch, &mut counts);
            }
            for contribution in &job.update.add {
                touched |= gather.contribution(contribution, 1, index, place, sums, scratch, &mut counts);
            }
            (touched, counts)
        });
        for (index, (touched, counts)) in batch.zip(done) {
            job.touched[index] = touched;
            self.counts += counts;
        }
    }

    /// Shows readers the sums of the chunks that changed.
    fn publish(&mut self, touched: &[bool]) {
        // In place where nobody looks; a reader that still does keeps what it has.
        if Arc::get_mut(&mut self.front).is_none() {
            self.front = Arc::new(Published::clone(&self.front));
        }
        let channels = self.channels();
        let (fixed, updates) = (self.fixed, self.updates);
        let Some(front) = Arc::get_mut(&mut self.front) else { unreachable!("nobody else has it yet") };
        front.updates = updates;
        for ((place, sums), _) in
            self.chunks.iter().zip(&self.sums).zip(touched).filter(|(_, touched)| **touched)
        {
            let texels = place.texels();
            let values = &mut front.values[texels.start * channels..texels.end * channels];
            for (value, &sum) in values.iter_mut().zip(sums) {
                *value = fixed.value(sum) as f32;
            }
        }
    }

    /// Whether any sample of a texel gathers light under the current geometry.
    pub(super) fn is_alive(&self, texel: usize, chunk: usize) -> bool {
        let state = self.current.and_then(|current| self.versions.get(&current));
        let Some(Some(chunk_in_world)) = state.map(|state| state.chunks[chunk].as_ref()) else {
            return false;
        };
        let samples = self.samples as usize;
        let at = (texel - self.chunks[chunk].first as usize) * samples;
        chunk_in_world.samples[at..at + samples].iter().any(|sample| !sample.is_dead())
    }
}

impl<R> Lightmap<R> {
    /// Where everything lies.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The light after a whole number of updates. Cheap, and safe to keep and to send to another thread while updates go on.
    pub fn published(&self) -> Arc<Published> {
        Arc::clone(&self.front)
    }

    /// Values of a texel: 3, or 12 for directional maps.
    pub fn channels(&self) -> usize {
        if self.directional { 12 } else { 3 }
    }

    /// Covered texels.
    pub fn texels(&self) -> usize {
        self.pixels.len()
    }

    /// What charts cover.
    pub fn coverage(&self) -> &CoverageReport {
        &self.coverage
    }

    /// What became of samples under the current geometry, over those that were made anew for it.
    pub fn receivers(&self) -> ReceiverReport {
        self.current
            .and_then(|current| self.versions.get(&current))
            .map_or_else(Default::default, |v| v.report)
    }

    /// What did not fit into the sums.
    pub fn counts(&self) -> FixedPointCounts {
        self.counts
    }

    /// How light is rounded.
    pub fn fixed_point(&self) -> FixedPoint {
        self.fixed
    }

    /// Versions of the geometry that are held. Each that isn't the current one holds memory until the last light under it has been updated:
    /// a host that wants to bound that stops taking edits until there are few.
    pub fn versions(&self) -> impl Iterator<Item = GeometryVersion> {
        self.versions.keys().copied()
    }

    /// Rays of a version, if it is held.
    pub fn rays(&self, version: GeometryVersion) -> Option<&R> {
        self.versions.get(&version).map(|state| &state.rays)
    }

    /// Updates in the map.
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// Lights added or subtracted so far.
    pub fn accumulations(&self) -> u64 {
        self.accumulations
    }

    /// Contributions in the map.
    pub fn live(&self) -> u64 {
        self.versions.values().map(|state| state.live).sum()
    }

    /// The sums, chunk by chunk: equal if and only if the light is the same to the bit.
    pub fn sums(&self) -> impl Iterator<Item = i64> {
        self.sums.iter().flat_map(|chunk| chunk.iter().copied())
    }

    /// Puts saved [`sums`](Self::sums) in place of those that are there, which consist of `contributions`. Their versions are given with
    /// [`set_geometry`](Self::set_geometry) before, the current one last.
    ///
    /// # Errors
    /// An update under way, a wrong number of sums, a contribution under a version that isn't held.
    pub fn resume<'a>(
        &mut self,
        sums: &[i64],
        contributions: impl IntoIterator<Item = &'a Contribution>,
    ) -> Result<(), LightmapError> {
        if self.job.is_some() {
            return Err(LightmapError::Busy);
        }
        if sums.len() != self.sums.iter().map(|chunk| chunk.len()).sum::<usize>() {
            return Err(LightmapError::Saved { why: "it has another number of texels" });
        }
        self.versions.values_mut().for_each(|state| state.live = 0);
        for Contribution { version, .. } in contributions {
            let state = self.versions.get_mut(version).ok_or(LightmapError::Version { version: *version })?;
            state.live += 1;
        }
        let mut rest = sums;
        for chunk in &mut self.sums {
            let (own, others) = rest.split_at(chunk.len());
            chunk.copy_from_slice(own);
            rest = others;
        }
        let fixed = self.fixed;
        let values = sums.iter().map(|&sum| fixed.value(sum) as f32).collect();
        self.front = Arc::new(Published { updates: self.updates, values });
        Ok(())
    }

    /// Memory held by texels, bytes: not that of rays and vertices, nor of published values that a reader keeps.
    pub fn bytes(&self) -> usize {
        let places = size_of_val(&*self.pixels) + size_of_val(&*self.sites) + size_of_val(&*self.chunks);
        let sums: usize = self.sums.iter().map(|chunk| size_of_val(&**chunk) + size_of::<Box<[i64]>>()).sum();
        // Chunks that versions share count once.
        let mut seen = std::collections::HashSet::new();
        let in_world: usize = self
            .versions
            .values()
            .flat_map(|state| &state.chunks)
            .map(|chunk| {
                let shared = chunk.as_ref().filter(|chunk| seen.insert(Arc::as_ptr(chunk)));
                let own = shared.map_or(0, |chunk| size_of_val(&*chunk.samples) + size_of::<Chunk>() + 16);
                own + size_of::<Option<Arc<Chunk>>>()
            })
            .sum();
        places + sums + in_world + size_of_val(&*self.front.values)
    }

    /// Positions and normals of an object's mesh.
    pub(super) fn host_vertices(&self, object: usize) -> (&[Vec3], &[Vec3]) {
        let mesh = &self.meshes[self.host_mesh[object] as usize];
        (&mesh.positions, &mesh.normals)
    }

    pub(super) fn placement(&self, object: u32) -> &Placement {
        self.layout.objects[object as usize].as_ref().expect("a chunk has texels")
    }
}

fn bounds(points: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), p| (min.min(p), max.max(p)))
}

/// Column and row of a texel on its page.
pub(super) fn page_pixel(placement: &Placement, pixel: [u16; 2]) -> [u32; 2] {
    let (origin, _) = placement.pixels();
    [origin[0] + u32::from(pixel[0]), origin[1] + u32::from(pixel[1])]
}
