//! What a picture is to look like.

use scene::RenderParams;
use serde_json::{Value, json};

use crate::methods::Method;
use crate::settings::Settings;

/// Light beyond the direct one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Gi {
    /// None.
    None,
    /// As virtual point lights: about this many.
    Vpl(usize),
    /// By path tracing.
    Path,
}

impl Gi {
    /// As written after `--gi`.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Vpl(_) => "vpl",
            Self::Path => "path",
        }
    }

    /// Virtual point lights asked for.
    pub(crate) const fn vpls(self) -> Option<usize> {
        match self {
            Self::Vpl(count) => Some(count),
            _ => None,
        }
    }
}

/// Everything that decides what a picture looks like, but for the scene, the camera and the size.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    /// Of direct light.
    pub(crate) method: Method,
    /// The method's dials.
    pub(crate) settings: Settings,
    /// Of indirect light.
    pub(crate) gi: Gi,
    /// Indirect bounces.
    pub(crate) bounces: u32,
    /// Of every random number, but for those below.
    pub(crate) seed: u32,
    /// Of lights drawn and places on them.
    pub(crate) light_seed: u32,
}

impl Plan {
    /// All that decides what the picture looks like, and nothing else: the same picture has the same words,
    /// whatever the machine.
    pub(crate) fn about(&self, scene: &str, camera: &str, params: &RenderParams) -> Value {
        json!({
            "scene": scene,
            "camera": camera,
            "width": params.width,
            "height": params.height,
            "method": self.method.about().name,
            "settings": self.settings.json(),
            "spp": params.spp,
            "pixels": params.pixels,
            "seed": self.seed,
            "gi": self.gi.name(),
            "bounces": self.bounces,
            "vpls": self.gi.vpls(),
            "unit": "linear RGB radiance, W/m2/sr",
        })
    }
}
