//! glTF materials to [`Material`]s, in the mode that was asked for.

use std::collections::BTreeMap;

use glam::{Affine2, Vec2, Vec3};
use gltf::material::AlphaMode as GltfAlphaMode;
use gltf::texture;

use super::error::thing;
use super::textures::TextureTable;
use super::{ImportProblem, Notes};
use crate::{AlphaMode, Material, MaterialMode, TextureSlot};

/// A converted material, or `None` where the mode leaves its surfaces out.
pub(super) type Converted = Option<Material>;

/// Converts one material.
pub(super) fn convert(
    source: &gltf::Material<'_>,
    mode: MaterialMode,
    textures: &mut TextureTable,
    notes: &mut Notes,
) -> Result<Converted, ImportProblem> {
    let at = match source.index() {
        Some(index) => thing("material", index, source.name()),
        None => "default material".to_owned(),
    };
    let mut check = Check { at: &at, notes };
    let pbr = source.pbr_metallic_roughness();
    let [r, g, b, alpha] = pbr.base_color_factor();
    let base_color = check.unit3("base colour", Vec3::new(r, g, b))?;
    let alpha = check.unit("alpha", alpha)?;
    let strength = check.positive("emissive strength", source.emissive_strength().unwrap_or(1.0))?;
    let factor = source.emissive_factor();
    let emissive = check.positive3("emissive factor", Vec3::from(factor))? * strength;
    let emissive = check.positive3("emission", emissive)?;
    let specular = match source.specular() {
        Some(specular) => check.unit("specular factor", specular.specular_factor())?,
        None => 1.0,
    };
    let specular_color = match source.specular() {
        Some(specular) => check.positive3("specular colour", Vec3::from(specular.specular_color_factor()))?,
        None => Vec3::ONE,
    };
    let transmission = match source.transmission() {
        Some(transmission) => check.unit("transmission", transmission.transmission_factor())?,
        None => 0.0,
    };
    let thin = source.volume().is_none_or(|volume| volume.thickness_factor() <= 0.0);
    let cutoff = check.positive("alpha cutoff", source.alpha_cutoff().unwrap_or(0.5))?;
    let material = Material {
        name: super::error::one_line(source.name().unwrap_or("")),
        base_color,
        alpha,
        base_color_texture: check.slot(pbr.base_color_texture(), true, textures)?,
        alpha_mode: match source.alpha_mode() {
            GltfAlphaMode::Opaque => AlphaMode::Opaque,
            GltfAlphaMode::Mask => AlphaMode::Mask(cutoff),
            GltfAlphaMode::Blend => AlphaMode::Blend,
        },
        metallic: check.unit("metallic factor", pbr.metallic_factor())?,
        roughness: check.unit("roughness factor", pbr.roughness_factor())?,
        metallic_roughness_texture: match mode {
            MaterialMode::Gltf => check.slot(pbr.metallic_roughness_texture(), false, textures)?,
            MaterialMode::Diffuse | MaterialMode::Phong(_) => None,
        },
        emissive,
        // Where the factor is black the texture lights nothing, and need not be decoded.
        emissive_texture: match emissive == Vec3::ZERO {
            true => None,
            false => check.slot(source.emissive_texture(), true, textures)?,
        },
        double_sided: source.double_sided(),
        ior: check.ior(source.ior().unwrap_or(1.5))?,
        specular,
        specular_color,
        transmission,
        thin,
        phong_exponent: None,
        mirror: false,
    };
    check.note_what_is_ignored(source);
    Ok(in_mode(material, mode))
}

/// `--set materials=...`: the rule of the modes other than glTF.
fn in_mode(material: Material, mode: MaterialMode) -> Converted {
    let phong_exponent = match mode {
        MaterialMode::Gltf => return Some(material),
        MaterialMode::Diffuse => None,
        MaterialMode::Phong(exponent) => Some(exponent),
    };
    let see_through =
        material.alpha_mode == AlphaMode::Blend && material.alpha < 0.5 || material.transmission > 0.5;
    if see_through {
        return None;
    }
    Some(Material {
        alpha: if material.alpha_mode == AlphaMode::Blend { 1.0 } else { material.alpha },
        alpha_mode: match material.alpha_mode {
            AlphaMode::Blend => AlphaMode::Opaque,
            kept => kept,
        },
        metallic: 0.0,
        roughness: 1.0,
        specular: 0.0,
        transmission: 0.0,
        phong_exponent,
        ..material
    })
}

/// Checks numbers of one material, for messages that name it.
struct Check<'a> {
    at: &'a str,
    notes: &'a mut Notes,
}

impl Check<'_> {
    fn bad<T>(&self, what: &str, value: f32, rule: &str) -> Result<T, ImportProblem> {
        Err(ImportProblem::invalid(
            self.at,
            format!("{what} is {value}"),
            match rule {
                "finite" => "write a finite number",
                _ => "write a number that is not negative",
            },
        ))
    }

    /// A number that has to lie in [0, 1]; brought there with a note, since exporters round.
    fn unit(&mut self, what: &str, value: f32) -> Result<f32, ImportProblem> {
        if !value.is_finite() {
            return self.bad(what, value, "finite");
        }
        if !(0.0..=1.0).contains(&value) {
            self.notes.say(format!("{}: {what} {value} was brought into the range 0 to 1", self.at));
        }
        Ok(value.clamp(0.0, 1.0))
    }

    fn unit3(&mut self, what: &str, value: Vec3) -> Result<Vec3, ImportProblem> {
        Ok(Vec3::new(self.unit(what, value.x)?, self.unit(what, value.y)?, self.unit(what, value.z)?))
    }

    fn positive(&mut self, what: &str, value: f32) -> Result<f32, ImportProblem> {
        match value {
            _ if !value.is_finite() => self.bad(what, value, "finite"),
            _ if value < 0.0 => self.bad(what, value, "not negative"),
            _ => Ok(value),
        }
    }

    fn positive3(&mut self, what: &str, value: Vec3) -> Result<Vec3, ImportProblem> {
        Ok(Vec3::new(
            self.positive(what, value.x)?,
            self.positive(what, value.y)?,
            self.positive(what, value.z)?,
        ))
    }

    /// At least 1; 0 means "no limit", for which the largest index that matters will do.
    fn ior(&mut self, value: f32) -> Result<f32, ImportProblem> {
        let value = self.positive("index of refraction", value)?;
        if value < 1.0 && value != 0.0 {
            self.notes.say(format!("{}: index of refraction {value} was raised to 1", self.at));
        }
        Ok(if value == 0.0 { 0.0 } else { value.max(1.0) })
    }

    fn slot(
        &mut self,
        info: Option<texture::Info<'_>>,
        srgb: bool,
        textures: &mut TextureTable,
    ) -> Result<Option<TextureSlot>, ImportProblem> {
        let Some(info) = info else { return Ok(None) };
        let given = info.texture_transform();
        let set = given.as_ref().and_then(texture::TextureTransform::tex_coord).unwrap_or(info.tex_coord());
        if set > 1 {
            self.notes
                .say(format!("{}: a texture by TEXCOORD_{set} is left out: sets 0 and 1 are read", self.at));
            return Ok(None);
        }
        let transform = given.map_or(Affine2::IDENTITY, |t| {
            // v points down, so that counter-clockwise on the image is a negative angle.
            Affine2::from_scale_angle_translation(
                Vec2::from(t.scale()),
                -t.rotation(),
                Vec2::from(t.offset()),
            )
        });
        if !transform.is_finite() {
            return Err(ImportProblem::invalid(
                self.at,
                "texture transform is not finite",
                "write finite numbers",
            ));
        }
        Ok(Some(TextureSlot { texture: textures.slot(&info.texture(), srgb), uv_set: set as u8, transform }))
    }

    /// Parts of a material that have no counterpart in [`Material`].
    fn note_what_is_ignored(&mut self, source: &gltf::Material<'_>) {
        let mut ignored: BTreeMap<&str, bool> = BTreeMap::new();
        ignored.insert("normal maps", source.normal_texture().is_some());
        ignored.insert("occlusion maps", source.occlusion_texture().is_some());
        let specular = source.specular();
        let textured =
            specular.is_some_and(|s| s.specular_texture().is_some() || s.specular_color_texture().is_some());
        ignored.insert("specular textures", textured);
        let transmission = source.transmission().is_some_and(|t| t.transmission_texture().is_some());
        ignored.insert("transmission textures", transmission);
        for what in ignored.into_iter().filter(|(_, present)| *present).map(|(what, _)| what) {
            self.notes.count(format!("materials' {what} are ignored"));
        }
    }
}
