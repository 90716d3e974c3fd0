//! Saved bakes: little-endian bytes that say what is in the baked light, and by which lamps and dials.
//!
//! Paths are not saved: each is a function of its light's name and its number, and the first steps after
//! loading trace them again. What is saved is what cannot be had again: the contributions, which have to be
//! subtracted one day as the records they were added as.
//!
//! Layout: `LTBAKE`, a format number (u16), the host's name of the scene (u64), length of the rest (u64), a
//! checksum of the rest (FNV-1a, 64 bits), the rest.

use core::fmt;

use glam::{Affine3A, Mat3A, Quat, Vec3, Vec3A};

use crate::baker::Baker;
use crate::cut::Saved;
use crate::forest::Place;
use crate::{
    Aperture, BakeError, BakeParams, Contribution, GeometryVersion, IntensityTable, Light, LightKey, Places,
    Polygon, Profile, Shape, VirtualLight,
};

const MAGIC: &[u8; 6] = b"LTBAKE";

/// Why a saved bake cannot be taken up again.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum LoadError {
    /// These bytes are no saved bake.
    NoBake,
    /// They are of a format that this version does not read.
    Format {
        /// Its number.
        found: u16,
        /// The one that is read.
        expected: u16,
    },
    /// They are of another scene.
    OtherScene {
        /// Its name.
        found: u64,
        /// The one that was asked for.
        expected: u64,
    },
    /// This dial was another one.
    OtherDial {
        /// Its name.
        name: &'static str,
    },
    /// Some bytes are missing or changed.
    Damaged,
    /// What is in it cannot be baked.
    Bake(BakeError),
}

impl fmt::Display for LoadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoBake => write!(f, "this is no saved bake"),
            Self::Format { found, expected } => {
                write!(f, "this bake was saved in format {found}, and only {expected} is read; bake anew")
            }
            Self::OtherScene { found, expected } => {
                write!(f, "this bake is of scene {found:016x}, not of {expected:016x}; bake anew")
            }
            Self::OtherDial { name } => {
                write!(f, "this bake was made with another `{name}`; set it back, or bake anew")
            }
            Self::Damaged => write!(f, "this saved bake is damaged; take an older one, or bake anew"),
            Self::Bake(error) => write!(f, "this saved bake: {error}"),
        }
    }
}

impl core::error::Error for LoadError {}

impl From<BakeError> for LoadError {
    fn from(error: BakeError) -> Self {
        Self::Bake(error)
    }
}

impl Baker {
    /// Number of the format that [`save`](Self::save) writes; another one where the same dials give other
    /// paths or clusters, too.
    pub const FORMAT: u16 = 3;

    /// The bake as bytes. `scene` is the host's name of the scene, a hash of its geometry as a rule.
    pub fn save(&self, scene: u64) -> Vec<u8> {
        let mut body = Writer(Vec::new());
        body.dials(&self.params);
        body.u32(self.version.0);
        body.f64(self.turns.saved);
        body.u32(self.lights.len() as u32);
        for (key, lamp) in &self.lights {
            body.u32(key.0);
            body.light(&lamp.light);
        }
        let saved = self.cut.save(&self.forest, &self.restored);
        body.u64(saved.len() as u64);
        for entry in &saved {
            body.saved(entry);
        }
        let mut file = Writer(MAGIC.to_vec());
        file.0.extend(Self::FORMAT.to_le_bytes());
        file.u64(scene);
        file.u64(body.0.len() as u64);
        file.u64(checksum(&body.0));
        file.0.extend(body.0);
        file.0
    }

    /// The bake that [`save`](Self::save) wrote, of the same scene and with the same dials; only
    /// [`skip_unaffected`](BakeParams::skip_unaffected), [`order`](BakeParams::order) and
    /// [`patience`](BakeParams::patience) may differ. The host
    /// answers rays in the geometry of [`version`](Self::version), and knows the older ones that
    /// [`contributions`](Self::contributions) name. Whatever was under way goes on, and ends with the same
    /// bits.
    ///
    /// # Errors
    /// Bytes that are no bake of this scene and these dials.
    pub fn load(bytes: &[u8], scene: u64, params: BakeParams) -> Result<Self, LoadError> {
        let mut file = Reader(bytes);
        if file.take(MAGIC.len()).map_err(|_| LoadError::NoBake)? != MAGIC {
            return Err(LoadError::NoBake);
        }
        let found = u16::from_le_bytes(file.array()?);
        if found != Self::FORMAT {
            return Err(LoadError::Format { found, expected: Self::FORMAT });
        }
        let found = file.u64()?;
        if found != scene {
            return Err(LoadError::OtherScene { found, expected: scene });
        }
        let (length, sum) = (file.u64()?, file.u64()?);
        if file.0.len() as u64 != length || checksum(file.0) != sum {
            return Err(LoadError::Damaged);
        }
        let mut baker = Self::new(params)?;
        file.same_dials(&params)?;
        baker.version = GeometryVersion(file.u32()?);
        baker.turns.saved = file.f64()?;
        for _ in 0..file.u32()? {
            let key = LightKey(file.u32()?);
            let light = file.light()?;
            baker.add_light(key, light)?;
        }
        let count = file.u64()?;
        for _ in 0..count {
            baker.restored.push(file.saved()?);
        }
        if file.0.is_empty() { Ok(baker) } else { Err(LoadError::Damaged) }
    }
}

/// FNV-1a.
fn checksum(bytes: &[u8]) -> u64 {
    bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325, |sum, &byte| (sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// Dials that decide what the baked light is, by name, as bits.
fn dials(params: &BakeParams) -> [(&'static str, u64); 13] {
    let float = |x: f32| u64::from(x.to_bits());
    let corner = |v: Vec3| {
        let [x, y, z] = v.to_array().map(f32::to_bits);
        u64::from(x) ^ u64::from(y).rotate_left(21) ^ u64::from(z).rotate_left(42)
    };
    [
        ("world", corner(params.world.min)),
        ("world", corner(params.world.max)),
        ("path_power", params.path_power.to_bits()),
        ("bounces", u64::from(params.bounces)),
        ("clusters", params.clusters as u64),
        ("lights_per_cell", params.lights_per_cell as u64),
        ("plane_members", params.plane_members as u64),
        ("plane_angle", float(params.plane_angle)),
        ("plane_offset", float(params.plane_offset)),
        ("leaf_members", u64::from(params.leaf_members)),
        ("interleave_at", params.interleave_at.to_bits()),
        ("least_validation", params.least_validation.to_bits()),
        ("seed", u64::from(params.seed)),
    ]
}

struct Writer(Vec<u8>);

impl Writer {
    fn u8(&mut self, x: u8) {
        self.0.push(x);
    }
    fn u32(&mut self, x: u32) {
        self.0.extend(x.to_le_bytes());
    }
    fn u64(&mut self, x: u64) {
        self.0.extend(x.to_le_bytes());
    }
    fn f32(&mut self, x: f32) {
        self.u32(x.to_bits());
    }
    fn f64(&mut self, x: f64) {
        self.u64(x.to_bits());
    }
    fn vec3(&mut self, v: Vec3) {
        v.to_array().into_iter().for_each(|x| self.f32(x));
    }
    fn quat(&mut self, q: Quat) {
        q.to_array().into_iter().for_each(|x| self.f32(x));
    }
    fn floats(&mut self, values: &[f32]) {
        self.u32(values.len() as u32);
        values.iter().for_each(|&x| self.f32(x));
    }

    fn dials(&mut self, params: &BakeParams) {
        dials(params).into_iter().for_each(|(_, bits)| self.u64(bits));
    }

    fn light(&mut self, light: &Light) {
        match &light.aperture {
            Aperture::Point => self.u8(0),
            Aperture::Sphere { radius } => {
                self.u8(1);
                self.f32(*radius);
            }
            Aperture::Disk { radius } => {
                self.u8(2);
                self.f32(*radius);
            }
            Aperture::Mesh { triangles, two_sided } => {
                self.u8(3);
                self.u8(u8::from(*two_sided));
                self.u32(triangles.len() as u32);
                triangles.iter().flatten().for_each(|&corner| self.vec3(corner));
            }
            Aperture::Sky { half_angle } => {
                self.u8(4);
                self.f32(*half_angle);
            }
        }
        self.profile(&light.profile);
        self.vec3(light.flux);
        for column in light.transform.matrix3.to_cols_array_2d().map(Vec3::from) {
            self.vec3(column);
        }
        self.vec3(Vec3::from(light.transform.translation));
        self.u32(light.paths);
    }

    fn profile(&mut self, profile: &Profile) {
        match profile {
            Profile::Lambert => self.u8(0),
            Profile::Spot { cos_inner, cos_outer } => {
                self.u8(1);
                self.f32(*cos_inner);
                self.f32(*cos_outer);
            }
            Profile::Table(table) => {
                self.u8(2);
                let (planes, gammas, candela) = table.parts();
                [planes, gammas, candela].into_iter().for_each(|values| self.floats(values));
            }
        }
    }

    fn saved(&mut self, saved: &Saved) {
        match saved.place {
            None => self.u8(0),
            Some(Place::Cell { depth, code }) => {
                self.u8(1);
                self.u8(depth);
                self.u64(code);
            }
            Some(Place::Piece { light, piece }) => {
                self.u8(2);
                self.u32(light.0);
                self.u32(piece);
            }
        }
        self.u64(saved.flux_at_bake as u64);
        self.u64(saved.absolute as u64);
        self.u32(saved.baked.len() as u32);
        for Contribution { light, version } in &saved.baked {
            self.u32(version.0);
            self.u32(light.seed);
            self.vec3(light.flux);
            self.shape(&light.shape);
        }
    }

    fn shape(&mut self, shape: &Shape) {
        match shape {
            Shape::Point { position, profile, frame } => {
                self.u8(0);
                self.vec3(*position);
                self.profile(profile);
                self.quat(*frame);
            }
            Shape::Sphere { center, radius, part } => {
                self.u8(1);
                self.vec3(*center);
                self.f32(*radius);
                part.iter().for_each(|&x| self.u32(x));
            }
            Shape::Disk { position, normal, radius } => {
                self.u8(2);
                self.vec3(*position);
                self.vec3(*normal);
                self.f32(*radius);
            }
            Shape::Polygon(polygon) => {
                self.u8(3);
                self.polygon(polygon);
            }
            Shape::Patch { polygon, places } => {
                self.u8(6);
                self.polygon(polygon);
                self.u8(places.points().len() as u8);
                places.points().iter().for_each(|&point| self.vec3(point));
            }
            Shape::ShapedPolygon { polygon, profile, frame } => {
                self.u8(4);
                self.polygon(polygon);
                self.profile(profile);
                self.quat(*frame);
            }
            Shape::Sky { frame, cos, around } => {
                self.u8(5);
                self.quat(*frame);
                cos.iter().chain(around).for_each(|&x| self.f32(x));
            }
        }
    }

    fn polygon(&mut self, polygon: &Polygon) {
        self.u8(polygon.corners().len() as u8);
        polygon.corners().iter().for_each(|&corner| self.vec3(corner));
    }
}

struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], LoadError> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or(LoadError::Damaged)?;
        self.0 = rest;
        Ok(taken)
    }
    fn array<const N: usize>(&mut self) -> Result<[u8; N], LoadError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }
    fn u8(&mut self) -> Result<u8, LoadError> {
        Ok(self.array::<1>()?[0])
    }
    fn u32(&mut self) -> Result<u32, LoadError> {
        Ok(u32::from_le_bytes(self.array()?))
    }
    fn u64(&mut self) -> Result<u64, LoadError> {
        Ok(u64::from_le_bytes(self.array()?))
    }
    fn f32(&mut self) -> Result<f32, LoadError> {
        let x = f32::from_bits(self.u32()?);
        if x.is_finite() { Ok(x) } else { Err(LoadError::Damaged) }
    }
    fn f64(&mut self) -> Result<f64, LoadError> {
        let x = f64::from_bits(self.u64()?);
        if x.is_finite() { Ok(x) } else { Err(LoadError::Damaged) }
    }
    fn vec3(&mut self) -> Result<Vec3, LoadError> {
        Ok(Vec3::new(self.f32()?, self.f32()?, self.f32()?))
    }
    fn quat(&mut self) -> Result<Quat, LoadError> {
        Ok(Quat::from_xyzw(self.f32()?, self.f32()?, self.f32()?, self.f32()?))
    }
    fn floats(&mut self) -> Result<Vec<f32>, LoadError> {
        (0..self.u32()?).map(|_| self.f32()).collect()
    }

    fn same_dials(&mut self, params: &BakeParams) -> Result<(), LoadError> {
        for (name, bits) in dials(params) {
            if self.u64()? != bits {
                return Err(LoadError::OtherDial { name });
            }
        }
        Ok(())
    }

    fn light(&mut self) -> Result<Light, LoadError> {
        let aperture = match self.u8()? {
            0 => Aperture::Point,
            1 => Aperture::Sphere { radius: self.f32()? },
            2 => Aperture::Disk { radius: self.f32()? },
            3 => {
                let two_sided = self.u8()? != 0;
                let mut triangles = Vec::new();
                for _ in 0..self.u32()? {
                    triangles.push([self.vec3()?, self.vec3()?, self.vec3()?]);
                }
                Aperture::Mesh { triangles: triangles.into(), two_sided }
            }
            4 => Aperture::Sky { half_angle: self.f32()? },
            _ => return Err(LoadError::Damaged),
        };
        let profile = self.profile()?;
        let flux = self.vec3()?;
        let columns = [self.vec3()?, self.vec3()?, self.vec3()?].map(Vec3A::from);
        let matrix3 = Mat3A::from_cols(columns[0], columns[1], columns[2]);
        let transform = Affine3A { matrix3, translation: self.vec3()?.into() };
        Ok(Light { aperture, profile, flux, transform, paths: self.u32()? })
    }

    fn profile(&mut self) -> Result<Profile, LoadError> {
        match self.u8()? {
            0 => Ok(Profile::Lambert),
            1 => Ok(Profile::Spot { cos_inner: self.f32()?, cos_outer: self.f32()? }),
            2 => {
                let table = IntensityTable::new(self.floats()?, self.floats()?, self.floats()?);
                Ok(Profile::Table(table.map_err(|_| LoadError::Damaged)?.into()))
            }
            _ => Err(LoadError::Damaged),
        }
    }

    fn saved(&mut self) -> Result<Saved, LoadError> {
        let place = match self.u8()? {
            0 => None,
            1 => Some(Place::Cell { depth: self.u8()?, code: self.u64()? }),
            2 => Some(Place::Piece { light: LightKey(self.u32()?), piece: self.u32()? }),
            _ => return Err(LoadError::Damaged),
        };
        let (flux_at_bake, absolute) = (self.u64()? as i64, self.u64()? as i64);
        let mut baked = Vec::new();
        for _ in 0..self.u32()? {
            let version = GeometryVersion(self.u32()?);
            let (seed, flux) = (self.u32()?, self.vec3()?);
            let shape = self.shape()?;
            baked.push(Contribution { light: VirtualLight { shape, flux, seed }, version });
        }
        Ok(Saved { place, flux_at_bake, absolute, baked })
    }

    fn shape(&mut self) -> Result<Shape, LoadError> {
        Ok(match self.u8()? {
            0 => Shape::Point { position: self.vec3()?, profile: self.profile()?, frame: self.quat()? },
            1 => {
                Shape::Sphere { center: self.vec3()?, radius: self.f32()?, part: [self.u32()?, self.u32()?] }
            }
            2 => Shape::Disk { position: self.vec3()?, normal: self.vec3()?, radius: self.f32()? },
            3 => Shape::Polygon(self.polygon()?),
            4 => Shape::ShapedPolygon {
                polygon: self.polygon()?,
                profile: self.profile()?,
                frame: self.quat()?,
            },
            5 => Shape::Sky {
                frame: self.quat()?,
                cos: [self.f32()?, self.f32()?],
                around: [self.f32()?, self.f32()?],
            },
            6 => {
                let polygon = self.polygon()?;
                let count = self.u8()?;
                let points = (0..count).map(|_| self.vec3()).collect::<Result<Vec<_>, _>>()?;
                let places = Places::new(&points).ok_or(LoadError::Damaged)?.into();
                Shape::Patch { polygon, places }
            }
            _ => return Err(LoadError::Damaged),
        })
    }

    /// All that a polygon knows follows from its corners, to the bit.
    fn polygon(&mut self) -> Result<Polygon, LoadError> {
        let mut corners = Vec::new();
        for _ in 0..self.u8()? {
            corners.push(self.vec3()?);
        }
        Polygon::new(&corners).ok_or(LoadError::Damaged)
    }
}
