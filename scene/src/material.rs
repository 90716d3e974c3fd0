//! Surface descriptions as glTF gives them. What they do to light is the `bsdf` module's business.

use glam::{Affine2, Vec3};

/// How materials of a file are read; `--set materials=...`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum MaterialMode {
    /// glTF 2.0 metallic-roughness.
    #[default]
    Gltf,
    /// Every surface Lambert of its base colour; blended or transmissive ones below half coverage are left
    /// out.
    Diffuse,
    /// As [`Diffuse`](Self::Diffuse), plus a Phong lobe of this exponent.
    Phong(f32),
}

/// What a texture multiplies, and how to look it up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureSlot {
    /// Index into [`Scene::textures`](crate::Scene::textures).
    pub texture: u32,
    /// 0: `TEXCOORD_0`, 1: `TEXCOORD_1`.
    pub uv_set: u8,
    /// `KHR_texture_transform`; identity without.
    pub transform: Affine2,
}

/// What the alpha channel means.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AlphaMode {
    /// Nothing.
    #[default]
    Opaque,
    /// A hole where alpha is below the cut-off, for every kind of ray.
    Mask(f32),
    /// Partial coverage. The camera sees such a surface by chance, in proportion to alpha; all other rays
    /// meet it where alpha is at least [`Material::SOLID_ALPHA`], and pass elsewhere. Without a say where
    /// [`Material::transmission`] says what passes.
    Blend,
}

/// glTF 2.0 metallic-roughness with the extensions that the importer reads.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// For messages; may be empty.
    pub name: String,
    /// Linear RGB factor.
    pub base_color: Vec3,
    /// Alpha factor, in [0, 1].
    pub alpha: f32,
    /// RGB × `base_color`, A × `alpha`; stored sRGB, decoded when sampled.
    pub base_color_texture: Option<TextureSlot>,
    /// What alpha means.
    pub alpha_mode: AlphaMode,
    /// In [0, 1].
    pub metallic: f32,
    /// In [0, 1]; GGX alpha is its square.
    pub roughness: f32,
    /// G × roughness, B × metallic; linear.
    pub metallic_roughness_texture: Option<TextureSlot>,
    /// Emitted radiance with `KHR_materials_emissive_strength` applied, W·m⁻²·sr⁻¹.
    pub emissive: Vec3,
    /// × emissive; sRGB.
    pub emissive_texture: Option<TextureSlot>,
    /// Lit and emitting on both sides.
    pub double_sided: bool,
    /// Index of refraction (`KHR_materials_ior`); glTF's default is 1.5.
    pub ior: f32,
    /// `KHR_materials_specular` factor; 0 is pure Lambert.
    pub specular: f32,
    /// `KHR_materials_specular` colour factor.
    pub specular_color: Vec3,
    /// `KHR_materials_transmission` factor, in [0, 1].
    pub transmission: f32,
    /// Has no volume (`KHR_materials_volume` absent or of zero thickness): light passes straight through.
    pub thin: bool,
    /// A Phong lobe of this exponent instead of GGX (R16 forces 150): set by [`MaterialMode::Phong`] or a
    /// built-in scene.
    pub phong_exponent: Option<f32>,
    /// A perfect mirror of `base_color`: set by built-in scenes.
    pub mirror: bool,
}

impl Material {
    /// Alpha from which a blended surface stops shadow rays, paths beyond the point that is lit, and
    /// particles; below, it isn't there for them.
    ///
    /// A threshold instead of chance, so that a shadow ray has one answer whichever method asks, and
    /// neighbours can share it. A pane of alpha 0.12 casts no shadow at all; one of 0.8 a full one. An
    /// emitter is always solid, for its light is drawn as if it were.
    pub const SOLID_ALPHA: f32 = 0.5;

    /// Whether alpha says how much of the surface is there.
    pub(crate) fn is_blended(&self) -> bool {
        self.alpha_mode == AlphaMode::Blend && self.transmission == 0.0
    }

    /// Alpha below which the surface isn't there for shadow rays, though it is for the camera.
    pub(crate) fn shadow_cutoff(&self) -> Option<f32> {
        (self.is_blended() && self.emissive == Vec3::ZERO).then_some(Self::SOLID_ALPHA)
    }
}

impl Default for Material {
    /// glTF's defaults, but pure Lambert and grey: roughness 1, metallic 0, specular 0.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Vec3::splat(0.5),
            alpha: 1.0,
            base_color_texture: None,
            alpha_mode: AlphaMode::Opaque,
            metallic: 0.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            double_sided: true,
            ior: 1.5,
            specular: 0.0,
            specular_color: Vec3::ONE,
            transmission: 0.0,
            thin: true,
            phong_exponent: None,
            mirror: false,
        }
    }
}
