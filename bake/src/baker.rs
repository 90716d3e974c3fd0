//! The bake: lamps, paths, clusters, and what of them is in the baked light.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};

use crate::aperture::{ApertureTree, Stage};
use crate::attention::{Attention, Invalid};
use crate::cut::{Cut, Saved};
use crate::foresight::Foresight;
use crate::forest::{Forest, Node, OCTREE, Place};
use crate::path_numbers::PathNumbers;
use crate::paths::Paths;
use crate::schedule::Turns;
use crate::sums::{GRID, Units};
use crate::trace::PathRules;
use crate::validate::EditLog;
use crate::{BakeError, BakeParams, Contribution, GeometryVersion, Light, LightKey};

/// Baked light that follows its scene.
///
/// Edits are calls; they are cheap, and only say what is out of date. [`step`](Self::step) does the work, a
/// bit at a time.
#[derive(Clone, Debug)]
pub struct Baker {
    pub(crate) params: BakeParams,
    pub(crate) rules: PathRules,
    pub(crate) forest: Forest,
    pub(crate) cut: Cut,
    pub(crate) paths: Paths,
    pub(crate) lights: BTreeMap<LightKey, Lamp>,
    /// Owner of the paths from this number on.
    pub(crate) owners: BTreeMap<u32, LightKey>,
    pub(crate) numbers: PathNumbers,
    pub(crate) version: GeometryVersion,
    /// Counts edits of any kind.
    pub(crate) edit: u32,
    pub(crate) log: EditLog,
    /// The edit that an object changed at last, of those that some path may not have been looked at since.
    pub(crate) objects: BTreeMap<u32, u32>,
    pub(crate) turns: Turns,
    pub(crate) attention: Attention,
    pub(crate) foresight: Option<Foresight>,
    /// Paths and members that were looked at while updates wait for what is foreseen.
    pub(crate) waited: f64,
    /// All paths were traced once.
    pub(crate) primed: bool,
    /// What a saved bake said, until paths are traced and it can be given to its clusters.
    pub(crate) restored: Vec<Saved>,
    pub(crate) stats: BakeStats,
}

/// A light and its paths.
#[derive(Clone, Debug)]
pub(crate) struct Lamp {
    pub(crate) light: Light,
    pub(crate) tree: ApertureTree,
    /// The forest's node of each piece.
    pub(crate) nodes: Vec<u32>,
    pub(crate) first_path: u32,
    /// Paths that are known to be invalid.
    pub(crate) known: Vec<u32>,
    /// Their power, in units of flux.
    pub(crate) invalid: i64,
    /// Paths from here on may be invalid, too.
    pub(crate) cursor: u32,
    /// The edit that its emission changed at last.
    pub(crate) changed: u32,
}

/// What was done since the bake began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct BakeStats {
    /// Paths found valid, or made so.
    pub paths_validated: u64,
    /// Those of them that needed a ray.
    pub paths_traced: u64,
    /// Those of them that had changed.
    pub paths_changed: u64,
    /// Rays asked of the host.
    pub rays: u64,
    /// Answers of the host that were no surface: not finite, no unit normal, or an albedo outside [0, 1].
    /// They counted as misses.
    pub unsound_hits: u64,
    /// Updates of clusters that were out of date.
    pub validation_updates: u64,
    /// Updates that refined or merged clusters.
    pub balancing_updates: u64,
    /// Lights added and subtracted by both.
    pub accumulations: u64,
}

impl Baker {
    /// A bake of nothing: add lights, then step.
    ///
    /// # Errors
    /// A world or a dial out of range.
    pub fn new(params: BakeParams) -> Result<Self, BakeError> {
        params.check()?;
        let [min, max] = [params.world.min, params.world.max].map(Vec3::as_dvec3);
        // A little more than the box, so that a wall at its border is not on a face of the grid.
        let side = (max - min).max_element() * (1.0 + 1.0 / 512.0);
        let center = 0.5 * (min + max);
        let origin = center - DVec3::splat(0.5 * side);
        let units =
            Units { origin, length: side / f64::from(GRID), flux: params.path_power / f64::from(GRID) };
        let stage = Stage {
            center: center.as_vec3(),
            radius: (0.5 * (max - min).length()) as f32,
            lift: (4.0 * side / f64::from(GRID)) as f32,
        };
        let mut forest = Forest::new(units, params.leaf_members);
        let mut cut = Cut::new(params.clusters, params.order);
        cut.select(&mut forest.nodes, OCTREE);
        let mut baker = Self {
            rules: PathRules { seed: params.seed, bounces: params.bounces, stage },
            params,
            forest,
            cut,
            paths: Paths::new(units),
            lights: BTreeMap::new(),
            owners: BTreeMap::new(),
            numbers: PathNumbers::default(),
            version: GeometryVersion::default(),
            edit: 0,
            log: EditLog::default(),
            objects: BTreeMap::new(),
            turns: Turns::default(),
            attention: Attention::default(),
            foresight: None,
            waited: 0.0,
            primed: false,
            restored: Vec::new(),
            stats: BakeStats::default(),
        };
        baker.refresh();
        Ok(baker)
    }

    /// The dials.
    pub const fn params(&self) -> &BakeParams {
        &self.params
    }

    /// Another order of updates from now on.
    pub fn set_order(&mut self, order: crate::UpdateOrder) {
        self.params.order = order;
        self.foresight = None;
        self.cut.set_order(order);
        self.refresh();
    }

    /// The version of the geometry that paths are traced in, and lights added under.
    pub const fn version(&self) -> GeometryVersion {
        self.version
    }

    /// The oldest version that some baked light still names, or the current one: the host may forget all
    /// before it. Looks at every contribution.
    pub fn oldest_version(&self) -> GeometryVersion {
        self.contributions().map(|contribution| contribution.version).min().unwrap_or(self.version)
    }

    /// Everything that is in the baked light, in no order that means anything: what a host adds up that
    /// starts anew with an empty map.
    pub fn contributions(&self) -> impl Iterator<Item = &Contribution> {
        self.cut.contributions().chain(self.restored.iter().flat_map(|saved| &saved.baked))
    }

    /// A light as it is described now.
    pub fn light(&self, key: LightKey) -> Option<&Light> {
        self.lights.get(&key).map(|lamp| &lamp.light)
    }

    /// Names of all lights, in order.
    pub fn light_keys(&self) -> impl Iterator<Item = LightKey> {
        self.lights.keys().copied()
    }

    /// What was done so far.
    pub const fn stats(&self) -> BakeStats {
        self.stats
    }

    /// Virtual point lights of all paths.
    pub const fn path_vertices(&self) -> usize {
        self.paths.vertex_count
    }

    /// Selected clusters: cells and pieces of lamps.
    pub const fn clusters(&self) -> usize {
        self.cut.selected
    }

    /// Virtual point lights outside [`BakeParams::world`], which went into the cells at its border.
    pub const fn outside(&self) -> u32 {
        self.forest.outside
    }

    /// Bytes of paths, clusters and lamps' trees; what is baked comes on top, some 350 bytes for each
    /// contribution.
    pub fn bytes(&self) -> usize {
        let lamps = self.lights.values().map(|lamp| {
            size_of::<Lamp>() + lamp.tree.bytes() + size_of_val(&*lamp.nodes) + lamp.known.capacity() * 4
        });
        self.paths.bytes() + self.forest.bytes() + lamps.sum::<usize>()
    }

    /// Gives what was loaded to its clusters.
    pub(crate) fn restore(&mut self) {
        for saved in core::mem::take(&mut self.restored) {
            let root = match saved.place {
                Some(Place::Cell { .. }) => Some(OCTREE),
                Some(Place::Piece { light, .. }) => self.lights.get(&light).map(|lamp| lamp.nodes[0]),
                None => None,
            };
            self.cut.restore(&mut self.forest, saved, root);
        }
    }

    /// Brings the order of clusters up to date after paths changed.
    pub(crate) fn refresh(&mut self) {
        let (lights, units) = (&self.lights, self.forest.units);
        let stale = self.forest.refresh(|node| match node.place {
            Place::Cell { .. } => node.sums.metric(),
            Place::Piece { light, piece } => {
                lights.get(&light).map_or(0.0, |lamp| lamp.metric(node, piece, units.length))
            }
        });
        let lamp = |node: &Node| match node.place {
            Place::Cell { .. } => None,
            Place::Piece { light, .. } => lights.get(&light),
        };
        let attention = &self.attention;
        let worth = |node: &Node, invalid: &Invalid<'_>| attention.worth(node, invalid, &units, lamp(node));
        self.cut.refresh(&self.forest, &stale, worth);
    }
}

impl Lamp {
    /// B of a piece: as of a cell, with what its aperture and profile say in place of its members.
    fn metric(&self, node: &Node, piece: u32, length: f64) -> f64 {
        use crate::{Aperture, Shape};
        let piece = &self.tree.pieces[piece as usize];
        let is_surface = !matches!(piece.shape, Shape::Point { .. } | Shape::Sphere { .. });
        let contribution = node.sums.visual_contribution(node.sums.flux as f64);
        let visibility = match self.light.aperture {
            // The sky is as large as it looks, from everywhere.
            Aperture::Sky { .. } => piece.size,
            _ => node.sums.visibility_error(piece.size / length),
        };
        contribution * self.light.profile.directionality(is_surface) * visibility
    }
}
