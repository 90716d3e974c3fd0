//! All light paths: where they met surfaces, and what they left there as virtual point lights.
//!
//! Luksch, Wimmer and Schwärzler 2019, sections 3.3 and 4.2. A vertex takes 40 bytes and a path 8; lists are
//! threaded through the vertices.
//!
//! Differs from the paper: no list leads from an object to its vertices. Each vertex names its object, and an
//! edit looks at all of them in the order of memory, which takes no longer than a walk along a list would
//! through a tenth of them.

use std::collections::BTreeSet;

use glam::Vec3;

use crate::forest::{Member, Members, NONE};
use crate::normal_code::decode;
use crate::sums::{Sums, Units};

/// Most paths.
pub(crate) const MAX_PATHS: u32 = 1 << 28;
/// The last vertex of a path.
const END: u32 = 1 << 31;
/// In place of the cell of a vertex that is free.
const FREE: u32 = NONE - 1;

/// What a path meets, as far as it is kept. Bits are compared to tell whether it is still there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Hit {
    /// Just off the surface.
    pub(crate) position: Vec3,
    /// Unit normal, [`encoded`](crate::normal_code::encode).
    pub(crate) normal: u32,
    /// What the surface sends on, W per channel.
    pub(crate) flux: Vec3,
    pub(crate) object: u32,
}

/// A hit in its lists.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vertex {
    pub(crate) hit: Hit,
    /// The next on its path; of the last, [`END`] and the path.
    next: u32,
    /// The next in its cell, or [`FREE`].
    in_cell: u32,
}

/// A path's state.
#[derive(Clone, Copy, Debug)]
struct Path {
    /// Its first vertex.
    first: u32,
    /// Whether its first segment is counted; its end escapes << 1; the upper half of its power's bits << 2,
    /// which has no sign; and the edit that it was validated at less [`Paths::base`] << 17.
    bits: u32,
}

/// Where the edit begins in a path's bits,
const EDIT: u32 = 17;
/// and the last that they hold. A path that was validated later is looked at again.
const LAST_EDIT: u32 = u32::MAX >> EDIT;

/// The next number up that a path's bits hold: 8 of its bits. What roulette goes by, and so nothing is lost
/// or gained by it.
pub(crate) fn rounded_power(power: f32) -> f32 {
    let up = power.to_bits().saturating_add(0xffff) & !0xffff;
    // The largest are rounded down, or they would be infinite.
    f32::from_bits(up.min(f32::MAX.to_bits() & !0xffff))
}

/// How a path ends, and when it was looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PathInfo {
    /// Its first segment is in the sums of the piece that it leaves from.
    pub(crate) counted: bool,
    /// Its last segment meets nothing.
    pub(crate) escaped: bool,
    /// The edit up to which it is valid, at least.
    pub(crate) edit: u32,
    /// The largest channel that it carries, W, [rounded up](rounded_power).
    pub(crate) power: f32,
}

/// Vertices and paths.
#[derive(Clone, Debug)]
pub(crate) struct Paths {
    paths: Vec<Path>,
    vertices: Vec<Vertex>,
    /// First of the free vertices, threaded by `next`.
    free: u32,
    pub(crate) vertex_count: usize,
    /// The edit up to which all paths are valid.
    base: u32,
    units: Units,
}

impl Paths {
    pub(crate) const fn new(units: Units) -> Self {
        Self { paths: Vec::new(), vertices: Vec::new(), free: NONE, vertex_count: 0, base: 0, units }
    }

    /// Room for paths up to `count`, untraced.
    pub(crate) fn grow(&mut self, count: u32) {
        let count = count as usize;
        if count > self.paths.len() {
            self.paths.reserve_exact(count - self.paths.len());
            self.paths.resize(count, Path { first: NONE, bits: 0 });
        }
    }

    pub(crate) fn info(&self, path: u32) -> PathInfo {
        let bits = self.paths[path as usize].bits;
        let power = f32::from_bits((bits >> 2 & 0x7fff) << 16);
        PathInfo { counted: bits & 1 != 0, escaped: bits & 2 != 0, edit: self.base + (bits >> EDIT), power }
    }

    pub(crate) fn set_info(&mut self, path: u32, info: PathInfo) {
        debug_assert_eq!(info.power.to_bits(), rounded_power(info.power).to_bits());
        let since = info.edit.saturating_sub(self.base).min(LAST_EDIT);
        let power = info.power.to_bits() >> 16 & 0x7fff;
        self.paths[path as usize].bits =
            since << EDIT | power << 2 | u32::from(info.escaped) << 1 | u32::from(info.counted);
    }

    /// All paths are valid up to this edit.
    pub(crate) fn all_valid(&mut self, edit: u32) {
        self.base = edit;
        self.paths.iter_mut().for_each(|path| path.bits &= (1 << EDIT) - 1);
    }

    /// Vertices of a path, in order.
    pub(crate) fn on_path(&self, path: u32) -> impl Iterator<Item = u32> {
        let some = |vertex: u32| (vertex < END).then_some(vertex);
        core::iter::successors(some(self.paths[path as usize].first), move |&v| {
            some(self.vertices[v as usize].next)
        })
    }

    pub(crate) fn hit(&self, vertex: u32) -> &Hit {
        &self.vertices[vertex as usize].hit
    }

    /// The path of a vertex.
    pub(crate) fn path(&self, vertex: u32) -> u32 {
        let mut next = self.vertices[vertex as usize].next;
        while next < END {
            next = self.vertices[next as usize].next;
        }
        next & !END
    }

    /// The path of a vertex, and its number on it.
    pub(crate) fn name(&self, vertex: u32) -> (u32, u32) {
        let path = self.path(vertex);
        let number = self.on_path(path).position(|v| v == vertex).expect("a vertex is on its path");
        (path, number as u32)
    }

    /// Vertices on any of these objects, in no order that means anything.
    pub(crate) fn on_objects(&self, objects: &BTreeSet<u32>) -> impl Iterator<Item = u32> {
        let is_on = |v: &Vertex| v.in_cell != FREE && objects.contains(&v.hit.object);
        (0u32..).zip(&self.vertices).filter(move |(_, vertex)| is_on(vertex)).map(|(index, _)| index)
    }

    /// Appends a vertex to its path: after `last`, which is the path's last, or as its first. It is in no
    /// cell.
    pub(crate) fn append(&mut self, path: u32, last: Option<u32>, hit: Hit) -> u32 {
        let vertex = Vertex { hit, next: END | path, in_cell: NONE };
        let index = if self.free == NONE {
            if self.vertices.len() == self.vertices.capacity() {
                // Twice as much would spoil the bytes per vertex.
                self.vertices.reserve_exact(self.vertices.len() / 16 + 1024);
            }
            self.vertices.push(vertex);
            (self.vertices.len() - 1) as u32
        } else {
            let index = self.free;
            self.free = self.vertices[index as usize].next;
            self.vertices[index as usize] = vertex;
            index
        };
        match last {
            Some(last) => self.vertices[last as usize].next = index,
            None => self.paths[path as usize].first = index,
        }
        self.vertex_count += 1;
        index
    }

    /// Cuts a path off after `last`, or wholly; the vertices, which are in no cell any more, are free.
    pub(crate) fn truncate(&mut self, path: u32, last: Option<u32>) {
        let link = match last {
            Some(last) => &mut self.vertices[last as usize].next,
            None => &mut self.paths[path as usize].first,
        };
        let mut vertex = core::mem::replace(link, END | path);
        while vertex < END {
            let entry = &mut self.vertices[vertex as usize];
            let next = core::mem::replace(&mut entry.next, self.free);
            entry.in_cell = FREE;
            self.free = vertex;
            self.vertex_count -= 1;
            vertex = next;
        }
    }

    /// What a segment adds to the sums of where it starts: it meets `next`, or escapes, or there is none.
    pub(crate) fn segment(&self, from: Vec3, next: Option<&Hit>, info: PathInfo) -> Sums {
        match next {
            // What is sent on over what arrived.
            Some(hit) if info.power > 0.0 => {
                Sums::of_hit(&self.units, from, hit.position, hit.flux.max_element() / info.power)
            }
            Some(hit) => Sums::of_hit(&self.units, from, hit.position, 0.0),
            None if info.escaped => Sums::of_escape(),
            None => Sums::default(),
        }
    }

    /// A vertex as the octree counts it.
    fn sums(&self, vertex: u32) -> Sums {
        let Vertex { hit, next, .. } = &self.vertices[vertex as usize];
        let mut sums = Sums::of_vpl(&self.units, hit.position, decode(hit.normal), hit.flux);
        let next = (*next < END).then(|| self.hit(*next));
        sums.add(&self.segment(hit.position, next, self.info(self.path(vertex))));
        sums
    }

    /// Gives back what growing ahead took, once no more comes for a while.
    pub(crate) fn trim(&mut self) {
        if self.vertices.capacity() - self.vertices.len() > self.vertices.len() / 128 + 64 {
            self.vertices.shrink_to_fit();
        }
    }

    /// Bytes of vertices, paths and lists.
    pub(crate) fn bytes(&self) -> usize {
        self.vertices.capacity() * size_of::<Vertex>() + self.paths.capacity() * size_of::<Path>()
    }
}

impl Members for Paths {
    fn member(&self, vertex: u32) -> Member {
        let hit = &self.vertices[vertex as usize].hit;
        Member { position: hit.position, normal: decode(hit.normal), sums: self.sums(vertex) }
    }

    fn next(&self, vertex: u32) -> u32 {
        self.vertices[vertex as usize].in_cell
    }

    fn set_next(&mut self, vertex: u32, next: u32) {
        self.vertices[vertex as usize].in_cell = next;
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn powers_are_rounded_up_by_little() {
        for power in [0.0, 1e-45, 1e-30, 0.1, 1.0, 1.000_001, 3.7e4, 3e38, f32::MAX] {
            let rounded = rounded_power(power);
            assert_eq!(rounded_power(rounded), rounded);
            assert!(rounded.is_finite() && rounded >= power.min(3.3e38), "{power} became {rounded}");
            assert!(power < 1e-38 || rounded <= power * 1.008, "{power} became {rounded}");
        }
    }

    #[test]
    fn a_path_keeps_what_it_is_told() {
        let units = Units { origin: DVec3::ZERO, length: 1.0, flux: 1.0 };
        let mut paths = Paths::new(units);
        paths.grow(2);
        paths.all_valid(1000);
        let info = PathInfo { counted: true, escaped: true, edit: 1003, power: rounded_power(0.3) };
        paths.set_info(1, info);
        assert_eq!(paths.info(1), info);
        assert_eq!(paths.info(0), PathInfo { edit: 1000, ..PathInfo::default() });
        // So many edits later it counts as older than it is, never as younger.
        paths.set_info(1, PathInfo { edit: 1001 + LAST_EDIT, ..info });
        assert_eq!(paths.info(1), PathInfo { edit: 1000 + LAST_EDIT, ..info });
        paths.all_valid(2_000_000);
        assert_eq!(paths.info(1), PathInfo { edit: 2_000_000, ..info });
    }

    #[test]
    fn vertices_are_found_by_their_object_and_free_ones_are_not() {
        let mut paths = Paths::new(Units { origin: DVec3::ZERO, length: 1.0, flux: 1.0 });
        paths.grow(3);
        let hit = |object| Hit { position: Vec3::ZERO, normal: 0, flux: Vec3::ONE, object };
        let first = paths.append(0, None, hit(7));
        paths.append(0, Some(first), hit(u32::MAX));
        let other = paths.append(1, None, hit(7));
        paths.append(2, None, hit(8));
        let on = |paths: &Paths, objects: [u32; 2]| paths.on_objects(&objects.into()).collect::<Vec<_>>();
        assert_eq!(on(&paths, [7, u32::MAX]), [0, 1, 2]);
        paths.truncate(0, None);
        assert_eq!(on(&paths, [7, u32::MAX]), [other]);
    }
}
