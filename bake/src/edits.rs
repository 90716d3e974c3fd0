//! Edits: what a user does to a scene.

use std::collections::BTreeSet;

use crate::aperture::ApertureTree;
use crate::baker::{Baker, Lamp};
use crate::forest::{NONE, Place};
use crate::paths::PathInfo;
use crate::{BakeError, Bounds, GeometryVersion, Light, LightKey};

/// An object that was moved, bent, added or removed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObjectChange {
    /// Its number, as in [`SurfaceHit::object`](crate::SurfaceHit::object).
    pub object: u32,
    /// World-space box around it before; `None` if there was none.
    pub before: Option<Bounds>,
    /// World-space box around it after; `None` if it is gone.
    pub after: Option<Bounds>,
}

impl Baker {
    /// A new light.
    ///
    /// # Errors
    /// A light that is none, or of a name that is taken; more than 2²⁸ paths.
    pub fn add_light(&mut self, key: LightKey, light: Light) -> Result<(), BakeError> {
        light.check().map_err(|error| BakeError::Light { key, error })?;
        if self.lights.contains_key(&key) {
            return Err(BakeError::SameKey { key });
        }
        self.plant_light(key, light)?;
        self.refresh();
        Ok(())
    }

    /// Takes a light and everything it sends out.
    ///
    /// # Errors
    /// There is no light of this name.
    pub fn remove_light(&mut self, key: LightKey) -> Result<(), BakeError> {
        self.uproot_light(key)?;
        self.refresh();
        Ok(())
    }

    /// Replaces a light: moves it, dims it, gives it another profile or aperture. The same aperture and
    /// number of paths keep its clusters as they are.
    ///
    /// # Errors
    /// A light that is none, no light of this name, or more than 2²⁸ paths. Then nothing has changed.
    pub fn set_light(&mut self, key: LightKey, light: Light) -> Result<(), BakeError> {
        light.check().map_err(|error| BakeError::Light { key, error })?;
        let lamp = self.lights.get(&key).ok_or(BakeError::NoLight { key })?;
        if lamp.light == light {
            return Ok(());
        }
        let tree = ApertureTree::build(&light, &self.rules.stage);
        let alike = lamp.light.aperture == light.aperture
            && lamp.light.paths == light.paths
            && tree.is_like(&lamp.tree);
        if alike {
            self.edit += 1;
            self.replace_light(key, light, tree);
        } else {
            // Not before there is room for the new one.
            let mut numbers = self.numbers.clone();
            numbers.give_back(lamp.first_path, lamp.light.paths);
            numbers.take(light.paths).ok_or(BakeError::TooManyPaths)?;
            self.uproot_light(key)?;
            self.plant_light(key, light)?;
        }
        self.refresh();
        Ok(())
    }

    /// Objects that were moved, bent, added or removed. From the next [`step`](Self::step) on the host
    /// answers rays in the geometry after the change, whose version this returns.
    ///
    /// # Errors
    /// A box that is none; then nothing has changed.
    pub fn change_geometry(&mut self, changes: &[ObjectChange]) -> Result<GeometryVersion, BakeError> {
        let sound = |bounds: &Bounds| {
            bounds.min.is_finite() && bounds.max.is_finite() && bounds.min.cmple(bounds.max).all()
        };
        if let Some(index) = changes.iter().position(|c| !c.before.iter().chain(&c.after).all(sound)) {
            return Err(BakeError::Bounds { index });
        }
        self.edit += 1;
        self.version.0 += 1;
        self.mark_objects(&changes.iter().map(|change| change.object).collect());
        for change in changes {
            for bounds in change.before.iter().chain(&change.after) {
                self.log.push(self.edit, *bounds);
                self.attention.log(self.version, *bounds);
            }
        }
        for lamp in self.lights.values_mut() {
            lamp.cursor = 0;
        }
        self.cut.pend_all();
        self.refresh();
        Ok(self.version)
    }

    /// Objects whose albedo changed. Shadows did not, so the version of the geometry stays.
    pub fn recolour(&mut self, objects: &[u32]) {
        self.edit += 1;
        self.mark_objects(&objects.iter().copied().collect());
        self.refresh();
    }

    /// Paths that met these objects are known to be invalid.
    fn mark_objects(&mut self, objects: &BTreeSet<u32>) {
        self.objects.extend(objects.iter().map(|&object| (object, self.edit)));
        for vertex in self.paths.on_objects(objects) {
            let path = self.paths.path(vertex);
            let power = self.forest.units.flux(glam::Vec3::splat(self.paths.info(path).power));
            let key = *self.owners.range(..=path).next_back().expect("every path has an owner").1;
            let lamp = self.lights.get_mut(&key).expect("a path's owner is a light");
            let index = path - lamp.first_path;
            // Vertices of a path mostly follow one another.
            if lamp.known.last() != Some(&index) {
                lamp.known.push(index);
                lamp.invalid = lamp.invalid.saturating_add(power);
            }
        }
    }

    /// The light whose path this is.
    pub(crate) fn owner(&self, path: u32) -> LightKey {
        *self.owners.range(..=path).next_back().expect("every path has an owner").1
    }

    fn plant_light(&mut self, key: LightKey, light: Light) -> Result<(), BakeError> {
        self.edit += 1;
        let first_path = self.numbers.take(light.paths).ok_or(BakeError::TooManyPaths)?;
        self.paths.grow(self.numbers.end());
        self.owners.insert(first_path, key);
        let tree = ApertureTree::build(&light, &self.rules.stage);
        // Parents come before children.
        let mut nodes = vec![NONE; tree.pieces.len()];
        let mut root = NONE;
        for (index, piece) in tree.pieces.iter().enumerate() {
            let place = Place::Piece { light: key, piece: index as u32 };
            if nodes[index] == NONE {
                nodes[index] = self.forest.plant(place, NONE);
                root = nodes[index];
            }
            for (slot, &child) in piece.children.iter().flatten().enumerate() {
                let place = Place::Piece { light: key, piece: child };
                nodes[child as usize] = self.forest.plant(place, nodes[index]);
                self.forest.set_child(nodes[index], slot, nodes[child as usize]);
            }
        }
        let paths = light.paths;
        let lamp = Lamp {
            light,
            tree,
            nodes,
            first_path,
            known: (0..paths).collect(),
            invalid: i64::MAX,
            cursor: paths,
            changed: self.edit,
        };
        self.lights.insert(key, lamp);
        self.set_flux(key);
        self.cut.select(&mut self.forest.nodes, root);
        Ok(())
    }

    /// Flux of a light's pieces, as the cut weighs them; their segments have to be counted anew.
    fn set_flux(&mut self, key: LightKey) {
        let lamp = &self.lights[&key];
        let whole = self.rules.power(&lamp.light, lamp.light.paths as f32);
        for (piece, &node) in lamp.tree.pieces.iter().zip(&lamp.nodes) {
            self.forest.nodes[node as usize].sums =
                crate::sums::Sums::of_piece(self.forest.units.flux(whole * piece.share as f32));
            self.forest.mark(node);
        }
    }

    fn uproot_light(&mut self, key: LightKey) -> Result<(), BakeError> {
        let lamp = self.lights.remove(&key).ok_or(BakeError::NoLight { key })?;
        self.edit += 1;
        for path in lamp.first_path..lamp.first_path + lamp.light.paths {
            let vertices: Vec<u32> = self.paths.on_path(path).collect();
            for vertex in vertices {
                self.forest.remove(vertex, &mut self.paths, &mut self.cut);
            }
            self.paths.truncate(path, None);
            self.paths.set_info(path, PathInfo::default());
        }
        self.forest.fell(lamp.nodes[0], &mut self.cut);
        self.owners.remove(&lamp.first_path);
        self.numbers.give_back(lamp.first_path, lamp.light.paths);
        Ok(())
    }

    /// The light sends out something else through the same pieces.
    fn replace_light(&mut self, key: LightKey, light: Light, tree: ApertureTree) {
        let lamp = self.lights.get_mut(&key).expect("the light was found");
        lamp.light = light;
        lamp.tree = tree;
        lamp.changed = self.edit;
        lamp.known = (0..lamp.light.paths).collect();
        lamp.invalid = i64::MAX;
        let (first, count) = (lamp.first_path, lamp.light.paths);
        for path in first..first + count {
            // Its first segment goes with the sums that are reset.
            let info = PathInfo { counted: false, ..self.paths.info(path) };
            self.paths.set_info(path, info);
        }
        self.set_flux(key);
        for node in self.lights[&key].nodes.clone() {
            let (state, flux) =
                (self.forest.nodes[node as usize].state, self.forest.nodes[node as usize].sums.flux);
            if state != NONE && !self.cut.states[state as usize].refined {
                self.cut.change_receivers(state, flux);
            }
        }
    }
}
