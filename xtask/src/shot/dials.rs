//! Settings as the algorithms' parameters.

use cutinterp::{PlacementParams, Visibility, WeightParams};
use lightcut::LightcutParams;

use crate::failure::Failure;
use crate::methods::{CutInterpParams, Show, WhereBeyond};
use crate::settings::Settings;

/// The dials of a lightcut; their ranges were checked when they were read.
pub(super) fn lightcut_params(settings: &Settings) -> LightcutParams {
    let number = |key| settings.number(key).unwrap_or_default();
    LightcutParams {
        threshold: number("threshold"),
        max_nodes: settings.whole("max_nodes"),
        floor: number("floor"),
        shadow_floor: number("shadow_floor"),
        ..LightcutParams::paper()
    }
}

/// The dials of cut interpolation; their ranges were checked when they were read, but not together.
pub(super) fn cutinterp_params(settings: &Settings) -> Result<CutInterpParams, Failure> {
    let number = |key| settings.number(key).unwrap_or_default();
    let visibility = match settings.text("visibility") {
        "full" => Visibility::Full,
        "adaptive" => Visibility::Adaptive { share: number("ray_share"), trust: number("trust") },
        _ => Visibility::Interpolated,
    };
    let weights = WeightParams {
        r_min: number("r_min"),
        r_max: number("r_max"),
        cos_max_angle: number("max_angle").to_radians().cos(),
        ..WeightParams::paper()
    };
    let placement = PlacementParams { weights, coverage: number("coverage"), ..PlacementParams::paper() };
    placement
        .check()
        .map_err(|why| Failure::usage(format!("--set r_min, r_max, max_angle, coverage: {why}")))?;
    Ok(CutInterpParams {
        visibility,
        placement,
        beyond: number("beyond"),
        where_beyond: match settings.text("where_beyond") {
            "finest" => WhereBeyond::Finest,
            _ => WhereBeyond::Refine,
        },
        rays_from_lights: settings.text("rays_from") == "lights",
        guard: number("guard"),
        spread: number("spread"),
        show: Show::named(settings.text("show")),
    })
}
