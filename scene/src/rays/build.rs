//! The tree and how it is built.

use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;

use super::binary::Binary;
use super::collapse::Plan;
use super::dispatch::Path;
use super::error::RaysError;
use super::node::{LANES, Link, MAX_LEAF, MAX_PACKETS, Node, STACK};
use super::ray::Scale;
use super::triangle::{MASKED_ID, Packet};

/// An 8-wide bounding volume hierarchy over triangles.
///
/// # Memory
/// 256 bytes a node, 320 bytes a packet of up to 8 triangles: 65 to 85 bytes a triangle in scenes of some
/// size, 105 at most where each leaf is as empty as it gets in a regular mesh. While building, some 400 bytes
/// a triangle more.
#[derive(Clone, Debug)]
pub struct WideBvh {
    pub(super) nodes: Vec<Node>,
    pub(super) packets: Vec<Packet>,
    pub(super) scale: Scale,
    path: Path,
    stats: BuildStats,
}

/// What a build did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BuildStats {
    /// Triangles given.
    pub triangles: usize,
    /// Of these, left out because two of their corners are the same point: no ray can hit them.
    pub pointless: usize,
    /// Masked ones.
    pub masked: usize,
    /// Wide nodes.
    pub nodes: usize,
    /// Packets of eight triangles.
    pub packets: usize,
    /// Stack entries that a traversal can need, proved from the tree.
    pub stack: usize,
    /// The built tree was too deep for the stack and was balanced.
    pub balanced: bool,
}

impl BuildStats {
    /// Of both together: sums, the deeper stack, balanced if either was.
    pub(super) fn with(self, other: &Self) -> Self {
        Self {
            triangles: self.triangles + other.triangles,
            pointless: self.pointless + other.pointless,
            masked: self.masked + other.masked,
            nodes: self.nodes + other.nodes,
            packets: self.packets + other.packets,
            stack: self.stack.max(other.stack),
            balanced: self.balanced || other.balanced,
        }
    }
}

/// Triangles that a tree can name.
const MAX_TRIANGLES: u64 = MASKED_ID as u64 - 1;

impl WideBvh {
    /// A tree over `triangles`, none of them masked. Any order, any winding; empty is fine.
    ///
    /// # Errors
    /// [`RaysError::NonFinite`] names the first triangle with a vertex that isn't finite;
    /// [`RaysError::TooMany`].
    pub fn build(triangles: &[[Vec3; 3]]) -> Result<Self, RaysError> {
        Self::build_masked(triangles, |_| false)
    }

    /// As [`build`](Self::build); hits on triangles for which `masked` holds are put to the queries'
    /// [`HitFilter`](super::HitFilter).
    ///
    /// # Errors
    /// As [`build`](Self::build).
    pub fn build_masked(triangles: &[[Vec3; 3]], masked: impl Fn(u32) -> bool) -> Result<Self, RaysError> {
        let count = triangles.len() as u64;
        if count > MAX_TRIANGLES {
            return Err(RaysError::TooMany { count, limit: MAX_TRIANGLES });
        }
        if let Some(i) = triangles.iter().position(|t| !t.iter().all(|v| v.is_finite())) {
            return Err(RaysError::NonFinite { triangle: i as u32 });
        }
        let largest = triangles.iter().flatten().fold(0.0f32, |m, v| m.max(v.abs().max_element()));
        let scale = Scale::of(largest);

        // Leave out what no ray can hit. Two equal corners make the edge functions exact opposites, so their
        // sum is zero and t no number, whatever the rounding. Triangles that are merely thin stay: they may
        // close a gap.
        let kept: Vec<u32> = (0u32..)
            .zip(triangles)
            .filter(|(_, [a, b, c])| a != b && b != c && c != a)
            .map(|(i, _)| i)
            .collect();
        let scaled = |i: u32| triangles[i as usize].map(|v| v * scale.factor);
        let boxes: Vec<Aabb> = kept
            .iter()
            .map(|&i| {
                let [a, b, c] = scaled(i).map(Vec3A::from);
                Aabb { min: a.min(b).min(c), max: a.max(b).max(c) }
            })
            .collect();

        let tree = Binary::build(&boxes);
        let mut stats = BuildStats {
            triangles: triangles.len(),
            pointless: triangles.len() - kept.len(),
            masked: kept.iter().filter(|&&i| masked(i)).count(),
            ..BuildStats::default()
        };
        let id = |i: u32| if stats.masked > 0 && masked(i) { i | MASKED_ID } else { i };
        let pack = |tree: &Binary| {
            let mut packets = Vec::with_capacity(kept.len() / 4);
            let (nodes, stack) = Plan::new(tree, MAX_LEAF).emit(tree, |below| {
                let first = packets.len();
                for lanes in below.chunks(LANES) {
                    let mut packet = Packet::EMPTY;
                    for (lane, &at) in lanes.iter().enumerate() {
                        let i = kept[at as usize];
                        packet.set(lane, id(i), scaled(i));
                    }
                    packets.push(packet);
                }
                let any_masked = below.iter().any(|&at| id(kept[at as usize]) & MASKED_ID != 0);
                // Past the limit the link is wrong, and the tree thrown away below.
                Link::leaf(first.min(MAX_PACKETS - 1), packets.len() - first, any_masked)
            });
            (nodes, packets, stack)
        };
        let (mut nodes, mut packets, mut stack) = pack(&tree);
        if stack > STACK {
            // 2^31 leaves are 31 levels deep, and a level leaves 7 siblings at most on the stack: 218
            // entries.
            stats.balanced = true;
            (nodes, packets, stack) = pack(&tree.halved(&boxes));
            assert!(stack <= STACK, "a balanced tree needs {stack} stack entries, more than can be");
        }
        if packets.len() > MAX_PACKETS {
            return Err(RaysError::TooMany { count, limit: MAX_PACKETS as u64 });
        }
        nodes.shrink_to_fit();
        packets.shrink_to_fit();
        (stats.nodes, stats.packets, stats.stack) = (nodes.len(), packets.len(), stack);
        Ok(Self { nodes, packets, scale, path: Path::detect(), stats })
    }

    /// The instructions that queries use.
    pub fn path(&self) -> Path {
        self.path
    }

    /// Uses `path`, or the portable one where this processor lacks it: for tests and benches, since answers
    /// are the same.
    pub fn set_path(&mut self, path: Path) {
        self.path = if path == Path::detect() { path } else { Path::Portable };
    }

    /// What the build did.
    pub fn stats(&self) -> &BuildStats {
        &self.stats
    }

    /// Memory held, bytes.
    pub fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>() + self.packets.capacity() * size_of::<Packet>()
    }

    /// Without padding in the slabs: the negative control of the watertightness tests.
    #[cfg(test)]
    pub(super) fn without_padding(mut self) -> Self {
        self.scale.padding = 0.0;
        self
    }
}
