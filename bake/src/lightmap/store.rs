//! The lightmap itself: texels and their sums of light.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3;

use super::coverage::{CoverageReport, Site, cover, sample_positions};
use super::fixed_point::{FixedPoint, FixedPointCounts};
use super::layout::{Layout, LayoutError, LayoutParams, MeshView, ObjectView, Placement};
use super::receivers::{LightmapRays, ReceiverReport};
use super::versions::{Chunk, Version, bounds};
use super::work::{Job, Published};
use crate::{Contribution, GeometryVersion};

/// Texels that are worked on together, neighbours on one object.
pub(super) const CHUNK: usize = 64;

/// How a lightmap is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightmapParams {
    /// Charts and pages.
    pub layout: LayoutParams,
    /// Samples of each texel, 1 to 16: points of its area at which light is gathered, and their mean taken.
    /// More smooth the edges of shadows, at so many times the rays and 28 bytes a texel each.
    pub samples: u32,
    /// Whether to keep four coefficients of spherical harmonics of the arriving radiance in place of the
    /// irradiance alone, for normal maps.
    pub directional: bool,
    /// The largest irradiance to be expected, W·m⁻²: sets the quantum (see [`FixedPoint::for_peak`]).
    pub peak: f64,
}

impl Default for LightmapParams {
    fn default() -> Self {
        Self { layout: LayoutParams::default(), samples: 1, directional: false, peak: 1e6 }
    }
}

/// A lightmap that is changed by [`Update`](crate::Update)s and comes back to the same bits when they are
/// undone. `R` answers rays, one for each version of the geometry.
///
/// # Memory
/// A covered texel takes 12 bytes of place (4, and 8 a sample), 20 a sample in the world, 24 of sums and 12
/// of the values that readers see: 68 with one sample, plus 2 for the chunks it is in. Each further sample
/// takes 28, directional maps 108 more. A version of the geometry that is kept shares the chunks that it has
/// in common with the next.
pub struct Lightmap<R> {
    pub(super) layout: Layout,
    pub(super) meshes: Vec<HostMesh>,
    pub(super) host_mesh: Vec<u32>,
    pub(super) samples: u32,
    pub(super) directional: bool,
    pub(super) chunks: Vec<ChunkPlace>,
    pub(super) pixels: Vec<[u16; 2]>,
    pub(super) sites: Vec<Site>,
    pub(super) coverage: CoverageReport,
    pub(super) fixed: FixedPoint,
    pub(super) sums: Vec<Box<[i64]>>,
    pub(super) counts: FixedPointCounts,
    pub(super) versions: BTreeMap<GeometryVersion, Version<R>>,
    pub(super) current: Option<GeometryVersion>,
    pub(super) job: Option<Job>,
    pub(super) front: Arc<Published>,
    pub(super) updates: u64,
    pub(super) accumulations: u64,
}

/// Vertices that stay as the host had them.
pub(super) struct HostMesh {
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) min: Vec3,
    pub(super) max: Vec3,
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
}

impl<R> Lightmap<R> {
    /// Where everything lies.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The light after a whole number of updates. Cheap, and safe to keep and to send to another thread while
    /// updates go on.
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

    /// Versions of the geometry that are held. Each that isn't the current one holds memory until the last
    /// light under it has been updated: a host that wants to bound that stops taking edits until there are
    /// few.
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

    /// Puts saved [`sums`](Self::sums) in place of those that are there, which consist of `contributions`.
    /// Their versions are given with [`set_geometry`](Self::set_geometry) before, the current one last.
    ///
    /// # Errors
    /// An update under way, a wrong number of sums, a contribution under a version that isn't held. Then
    /// nothing has changed.
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
        let mut live: BTreeMap<GeometryVersion, u64> =
            self.versions.keys().map(|&version| (version, 0)).collect();
        for &Contribution { version, .. } in contributions {
            *live.get_mut(&version).ok_or(LightmapError::Version { version })? += 1;
        }
        for (state, live) in self.versions.values_mut().zip(live.into_values()) {
            state.live = live;
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

    /// Memory held by texels, bytes: not that of rays and vertices, nor of published values that a reader
    /// keeps.
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

/// Column and row of a texel on its page.
pub(super) fn page_pixel(placement: &Placement, pixel: [u16; 2]) -> [u32; 2] {
    let (origin, _) = placement.pixels();
    [origin[0] + u32::from(pixel[0]), origin[1] + u32::from(pixel[1])]
}
