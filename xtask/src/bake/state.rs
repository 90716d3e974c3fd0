//! Saved bakes on disk: what the bake saves of itself, and the sums of the lightmap, whole or not at all.
//!
//! Layout, little-endian: `LTLMAP`, a format number (u16), a checksum of the rest (FNV-1a, u64); then the
//! scene's name (u64), that of the settings (u64), edits done (u64) and the updates made since the last one
//! (u64), the name of each (u64), length and bytes of the bake, number of sums (u64) and the sums (i64).

use std::io::Write;
use std::path::Path;

use bake::lightmap::Lightmap;
use glam::Vec3;

use super::world::Geometry;
use crate::failure::Failure;
use crate::output;

const MAGIC: &[u8; 6] = b"LTLMAP";
const FORMAT: u16 = 1;

/// What is saved.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct State {
    /// Hash of the scene as it was opened.
    pub(crate) scene: u64,
    /// Hash of everything that decides what texels there are and how they are lit.
    pub(crate) settings: u64,
    /// Hashes of the edits that were done, in order.
    pub(crate) edits: Vec<u64>,
    /// Updates since the last of these.
    pub(crate) since: u64,
    /// [`bake::Baker::save`].
    pub(crate) bake: Vec<u8>,
    /// [`bake::lightmap::Lightmap::sums`].
    pub(crate) sums: Vec<i64>,
}

/// FNV-1a, 64 bits.
pub(crate) fn fnv(bytes: &[u8]) -> u64 {
    let mut hash = Fnv::default();
    hash.bytes(bytes);
    hash.0
}

/// FNV-1a under way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fnv(pub(crate) u64);

impl Default for Fnv {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv {
    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}

/// The name of a lightmap's light: that of its sums.
pub(crate) fn hash_sums(map: &Lightmap<Geometry>) -> u64 {
    let mut hash = Fnv::default();
    map.sums().for_each(|sum| hash.bytes(&sum.to_le_bytes()));
    hash.0
}

/// The name of everything in a scene that light depends on.
pub(crate) fn hash_scene(scene: &scene::Scene) -> u64 {
    let mut hash = Fnv::default();
    let vectors = |hash: &mut Fnv, values: &[Vec3]| {
        values.iter().flat_map(|v| v.to_array()).for_each(|x| hash.bytes(&x.to_le_bytes()));
    };
    for mesh in &scene.meshes {
        vectors(&mut hash, &mesh.positions);
        vectors(&mut hash, &mesh.normals);
        mesh.uvs
            .iter()
            .chain(&mesh.uvs1)
            .flat_map(|uv| uv.to_array())
            .for_each(|x| hash.bytes(&x.to_le_bytes()));
        mesh.triangles.iter().flatten().for_each(|v| hash.bytes(&v.to_le_bytes()));
        hash.bytes(&mesh.material.to_le_bytes());
    }
    let texts = [
        format!("{:?}", scene.instances),
        format!("{:?}", scene.materials),
        format!("{:?}", scene.lights),
        format!("{:?}", scene.distant),
    ];
    texts.iter().for_each(|text| hash.bytes(text.as_bytes()));
    scene.textures.iter().for_each(|texture| hash.bytes(texture.texels.as_flattened()));
    hash.0
}

impl State {
    /// Writes the state, with `sums` in place of its own, as [`output::whole`] does. Sums are asked for twice
    /// instead of being held once more.
    ///
    /// # Errors
    /// A failure that names the file.
    pub(crate) fn write<S: Iterator<Item = i64>>(
        &self,
        path: &Path,
        sums: impl Fn() -> S,
    ) -> Result<(), Failure> {
        let mut head = Vec::with_capacity(64 + self.bake.len());
        let mut word = |word: u64| head.extend_from_slice(&word.to_le_bytes());
        word(self.scene);
        word(self.settings);
        word(self.edits.len() as u64);
        word(self.since);
        self.edits.iter().for_each(|&edit| word(edit));
        word(self.bake.len() as u64);
        head.extend_from_slice(&self.bake);
        head.extend_from_slice(&(sums().count() as u64).to_le_bytes());
        let mut hash = Fnv::default();
        hash.bytes(&head);
        sums().for_each(|sum| hash.bytes(&sum.to_le_bytes()));
        output::whole(path, |file| {
            file.write_all(MAGIC)?;
            file.write_all(&FORMAT.to_le_bytes())?;
            file.write_all(&hash.0.to_le_bytes())?;
            file.write_all(&head)?;
            sums().try_for_each(|sum| file.write_all(&sum.to_le_bytes()))
        })
    }

    /// Reads a state.
    ///
    /// # Errors
    /// A failure that names the file, and what it is instead.
    pub(crate) fn read(path: &Path) -> Result<Self, Failure> {
        let fail = |why: &str| Failure::failed(format!("{}: {why}", path.display()));
        let bytes = std::fs::read(path).map_err(|error| fail(&error.to_string()))?;
        Self::parse(&bytes).map_err(|why| fail(&why))
    }

    fn parse(bytes: &[u8]) -> Result<Self, String> {
        let rest = bytes.strip_prefix(MAGIC.as_slice()).ok_or("this is no saved bake")?;
        let (format, rest) = rest.split_first_chunk::<2>().ok_or("this saved bake is cut off")?;
        let format = u16::from_le_bytes(*format);
        if format != FORMAT {
            return Err(format!(
                "this bake was saved in format {format}, and only {FORMAT} is read: bake anew"
            ));
        }
        let (sum, rest) = rest.split_first_chunk::<8>().ok_or("this saved bake is cut off")?;
        if fnv(rest) != u64::from_le_bytes(*sum) {
            return Err("this saved bake is damaged: bake anew".to_owned());
        }
        let mut left = rest;
        let mut word = || -> Result<u64, String> {
            let (word, after) = left.split_first_chunk::<8>().ok_or("this saved bake is cut off")?;
            left = after;
            Ok(u64::from_le_bytes(*word))
        };
        let (scene, settings, edits, since) = (word()?, word()?, word()?, word()?);
        let edits = (0..edits).map(|_| word()).collect::<Result<_, _>>()?;
        let length = word()? as usize;
        if length > left.len() {
            return Err("this saved bake is cut off".to_owned());
        }
        let (bake, after) = left.split_at(length);
        let (count, sums) = after.split_first_chunk::<8>().ok_or("this saved bake is cut off")?;
        let (sums, none) = sums.as_chunks::<8>();
        if sums.len() as u64 != u64::from_le_bytes(*count) || !none.is_empty() {
            return Err("this saved bake is cut off".to_owned());
        }
        let sums = sums.iter().map(|sum| i64::from_le_bytes(*sum)).collect();
        Ok(Self { scene, settings, edits, since, bake: bake.to_vec(), sums })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_comes_back_and_broken_ones_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bake.state");
        let state = State {
            scene: 1,
            settings: 2,
            edits: vec![3, 4],
            since: 5,
            bake: vec![6, 7, 8],
            sums: vec![-9, i64::MAX],
        };
        state.write(&path, || state.sums.iter().copied()).unwrap();
        assert_eq!(State::read(&path).unwrap(), state);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        let bytes = std::fs::read(&path).unwrap();
        for length in 0..bytes.len() {
            assert!(State::parse(&bytes[..length]).is_err(), "{length} bytes");
        }
        for at in 0..bytes.len() {
            let mut broken = bytes.clone();
            broken[at] ^= 0x40;
            assert!(State::parse(&broken).is_err(), "byte {at}");
        }
        assert!(State::read(&folder.path().join("none")).unwrap_err().to_string().contains("none"));
    }
}
