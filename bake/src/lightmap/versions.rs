//! States of the geometry: where the texels of a lightmap are in the world, and by what rays they gather, for
//! as long as light in the map names them.

use std::sync::Arc;

use glam::{Affine3A, Vec3};

use super::parallel;
use super::receivers::{LightmapRays, ReceiverReport, Sample, Standing};
use super::store::{ChunkPlace, Lightmap, LightmapError};
use crate::{Bounds, GeometryVersion};

/// A chunk in the world under some versions.
pub(super) struct Chunk {
    min: Vec3,
    max: Vec3,
    pub(super) samples: Box<[Sample]>,
}

/// One state of the geometry, for as long as something in the map was lit under it.
pub(super) struct Version<R> {
    pub(super) rays: R,
    pub(super) objects: Vec<Option<Affine3A>>,
    pub(super) chunks: Vec<Option<Arc<Chunk>>>,
    /// Longer than any way out of the scene.
    pub(super) far: f32,
    /// Contributions in the map that name this version.
    pub(super) live: u64,
    pub(super) report: ReceiverReport,
}

impl<R: LightmapRays> Lightmap<R> {
    /// Takes a new state of the geometry, under which light is added from now on: rays, and where objects
    /// stand (`None`: absent). Receivers are made anew for objects that moved and for what the boxes of these
    /// touch, before or after; all others are shared with the last version.
    ///
    /// A version is let go of at the end of an update once nothing in the map was lit under it and another
    /// one is current.
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

        let absent = vec![None; objects.len()];
        let changed = self.moved(last.map_or(&absent, |last| &last.objects), objects);
        let all = objects.iter().enumerate().filter_map(|(o, at)| at.map(|at| self.world_box(o, at)));
        let (min, max) =
            all.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(a, b), all| (a.min(all.min), b.max(all.max)));
        let far = if min.cmple(max).all() { 2.0 * (max - min).length() + f32::MIN_POSITIVE } else { 1.0 };

        let made = parallel::map(&self.chunks, R::Scratch::default, |index, place, scratch| {
            let at = objects[place.object as usize]?;
            let mut report = ReceiverReport::default();
            if let Some(last) = last
                && last.objects[place.object as usize] == Some(at)
                && let Some(chunk) = &last.chunks[index]
                && !changed
                    .iter()
                    .any(|moved| chunk.min.cmple(moved.max).all() && chunk.max.cmpge(moved.min).all())
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

    /// Boxes around what stands elsewhere in the one state than in the other, in both.
    pub(super) fn moved(&self, before: &[Option<Affine3A>], after: &[Option<Affine3A>]) -> Vec<Bounds> {
        let differs = before.iter().zip(after).enumerate().filter(|(_, (before, after))| before != after);
        let boxes = differs.flat_map(|(object, (before, after))| {
            [before, after].into_iter().flatten().map(move |&at| self.world_box(object, at))
        });
        boxes.collect()
    }

    fn world_box(&self, object: usize, at: Affine3A) -> Bounds {
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
        let (min, max) = bounds((0..8).map(corner));
        Bounds { min, max }
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

pub(super) fn bounds(points: impl Iterator<Item = Vec3>) -> (Vec3, Vec3) {
    points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(min, max), p| (min.min(p), max.max(p)))
}
