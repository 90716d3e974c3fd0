//! Pictures of what the method does, in place of what it is for.

use cutinterp::{Chosen, Selection};
use glam::{DVec3, Vec3};
use lighttree::rng::{pcg4d, unit_f32};
use scene::luminance;

/// What is painted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Show {
    /// The light.
    Picture,
    /// Records as white dots, on the colours of [`Weights`](Self::Weights).
    Records,
    /// Each record has a colour, mixed by weight.
    Weights,
    /// Nodes of the interpolated cut, in thousands.
    CutSize,
    /// The share of the point's light that is seen, as interpolated.
    Visibility,
}

impl Show {
    /// As in `--set show=`.
    pub(crate) const NAMES: [&str; 5] = ["picture", "records", "weights", "cut-size", "visibility"];

    /// The one of that name.
    ///
    /// # Panics
    /// For a name that is not in [`NAMES`](Self::NAMES).
    pub(crate) fn named(name: &str) -> Self {
        let all = [Self::Picture, Self::Records, Self::Weights, Self::CutSize, Self::Visibility];
        let at = Self::NAMES.iter().position(|&known| known == name);
        all[at.unwrap_or_else(|| panic!("`{name}` is nothing to show"))]
    }

    /// Paints a point that fell back magenta, unless it is the picture that is wanted.
    pub(crate) fn is_fallback(self, radiance: &mut [DVec3]) -> bool {
        if self != Self::Picture {
            radiance.fill(DVec3::new(1.0, 0.0, 1.0));
        }
        self != Self::Picture
    }

    /// The colour of a point, whose nearest record is `pixels` pixels away.
    pub(crate) fn paint(
        self,
        selection: &Selection,
        pixels: f32,
        chosen: &[Chosen],
        unoccluded: &[Vec3],
    ) -> DVec3 {
        let mixed = || {
            let parts = selection.records().iter().zip(selection.weights());
            parts.map(|(&id, &weight)| weight * colour(id)).sum::<Vec3>().as_dvec3()
        };
        match self {
            Self::Records if pixels < 1.0 => DVec3::ONE,
            Self::Records => 0.3 * mixed(),
            Self::Weights | Self::Picture => mixed(),
            Self::CutSize => DVec3::splat(chosen.len() as f64 / 1000.0),
            Self::Visibility => {
                let light = |i: usize| f64::from(luminance(unoccluded[i]));
                let all: f64 = (0..chosen.len()).map(light).sum();
                let seen: f64 = (0..chosen.len()).map(|i| f64::from(chosen[i].visibility) * light(i)).sum();
                DVec3::splat(if all > 0.0 { seen / all } else { 0.0 })
            }
        }
    }
}

/// A record's colour.
fn colour(id: u32) -> Vec3 {
    let [r, g, b, _] = pcg4d([id, 1, 2, 3]).map(unit_f32);
    Vec3::new(r, g, b)
}
