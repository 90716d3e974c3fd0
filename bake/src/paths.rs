//! All light paths: where they met surfaces, and what they left there as virtual point lights.
//!
//! Luksch, Wimmer and Schwärzler 2019, sections 3.3 and 4.2. A vertex takes 48 bytes and a path 12; lists are threaded through the vertices.

use glam::Vec3;

use crate::forest::{Member, Members, NONE};
use crate::normal_code::decode;
use crate::sums::{Sums, Units};

/// Most paths.
pub(crate) const MAX_PATHS: u32 = 1 << 28;
/// The last vertex of a path.
const END: u32 = 1 << 31;

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
    /// The next in its cell.
    in_cell: u32,
    /// Neighbours among those on its object.
    on_object: [u32; 2],
}

/// A path's state.
#[derive(Clone, Copy, Debug)]
struct Path {
    /// Its first vertex.
    first: u32,
    /// Edit that it was validated at << 2 | whether its end escapes << 1 | whether its first segment is counted.
    bits: u32,
    /// The largest channel that it carries, W: roulette keeps it the same all along.
    power: f32,
}

/// How a path ends, and when it was looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PathInfo {
    /// Its first segment is in the sums of the piece that it leaves from.
    pub(crate) counted: bool,
    /// Its last segment meets nothing.
    pub(crate) escaped: bool,
    /// The edit up to which it is valid.
    pub(crate) edit: u32,
    /// The largest channel that it carries, W.
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
    /// First vertex on each object.
    objects: Vec<u32>,
    units: Units,
}

impl Paths {
    pub(crate) const fn new(units: Units) -> Self {
        Self {
            paths: Vec::new(),
            vertices: Vec::new(),
            free: NONE,
            vertex_count: 0,
            objects: Vec::new(),
            units,
        }
    }

    /// Room for paths up to `count`, untraced.
    pub(crate) fn grow(&mut self, count: u32) {
        let count = count as usize;
        if count > self.paths.len() {
            self.paths.reserve_exact(count - self.paths.len());
            self.paths.resize(count, Path { first: NONE, bits: 0, power: 0.0 });
        }
    }

    pub(crate) fn info(&self, path: u32) -> PathInfo {
        let Path { bits, power, .. } = self.paths[path as usize];
        PathInfo { counted: bits & 1 != 0, escaped: bits & 2 != 0, edit: bits >> 2, power }
    }

    pub(crate) fn set_info(&mut self, path: u32, info: PathInfo) {
        let path = &mut self.paths[path as usize];
        path.bits = info.edit << 2 | u32::from(info.escaped) << 1 | u32::from(info.counted);
        path.power = info.power;
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

    /// Vertices on an object, in no order that means anything.
    pub(crate) fn on_object(&self, object: u32) -> impl Iterator<Item = u32> {
        let some = |vertex: u32| (vertex != NONE).then_some(vertex);
        let first = self.objects.get(object as usize).copied().unwrap_or(NONE);
        core::iter::successors(some(first), move |&v| some(self.vertices[v as usize].on_object[1]))
    }

    /// Appends a vertex to its path: after `last`, which is the path's last, or as its first. It is in no cell.
    pub(crate) fn append(&mut self, path: u32, last: Option<u32>, hit: Hit) -> u32 {
        if hit.object as usize >= self.objects.len() {
            self.objects.resize(hit.object as usize + 1, NONE);
        }
        let after = self.objects[hit.object as usize];
        let vertex = Vertex { hit, next: END | path, in_cell: NONE, on_object: [NONE, after] };
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
        if after != NONE {
            self.vertices[after as usize].on_object[0] = index;
        }
        self.objects[hit.object as usize] = index;
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
            let Vertex { next, on_object: [before, after], hit, .. } = self.vertices[vertex as usize];
            if before == NONE {
                self.objects[hit.object as usize] = after;
            } else {
                self.vertices[before as usize].on_object[1] = after;
            }
            if after != NONE {
                self.vertices[after as usize].on_object[0] = before;
            }
            self.vertices[vertex as usize].next = self.free;
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
        self.vertices.capacity() * size_of::<Vertex>()
            + self.paths.capacity() * size_of::<Path>()
            + self.objects.capacity() * size_of::<u32>()
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
