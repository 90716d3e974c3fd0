//! One method from its cheapest setting to its dearest.

use std::time::Instant;

use scene::{Errors, Film, RenderParams};
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::methods::Method;
use crate::progress::Watched;
use crate::render::LookArgs;
use crate::report;
use crate::settings::Settings;
use crate::shot::Stage;
use crate::stop;

/// Dials that trade time for accuracy, and what they are turned to, cheap to dear. A method's curve is over
/// the first of them that it has.
const DIALS: [(&str, [&str; 5]); 2] =
    [("threshold", ["0.1", "0.05", "0.02", "0.01", "0.005"]), ("lights", ["1", "4", "16", "64", "256"])];

/// A method's error against its time.
pub(super) struct Curve {
    pub(super) method: Method,
    /// The dial that was turned; empty for a method without one.
    pub(super) key: &'static str,
    /// Cheap to dear.
    pub(super) points: Vec<Point>,
    /// What the setting in the middle looks like.
    pub(super) picture: Option<Film>,
}

/// One setting.
pub(super) struct Point {
    pub(super) value: &'static str,
    pub(super) build_seconds: f64,
    pub(super) render_seconds: f64,
    pub(super) counts: Value,
    pub(super) errors: Errors,
}

/// Whether `brute` is the truth for what it computes.
pub(super) fn is_direct(method: Method) -> bool {
    !["brute", "path", "gather", "photoncut"].contains(&method.about().name)
}

impl Curve {
    /// Renders `method` at each value of its dial and compares with `truth`, made of the same camera rays.
    pub(super) fn measure(
        stage: &Stage<'_>,
        look: &LookArgs,
        method: Method,
        params: &RenderParams,
        truth: &Film,
        quick: bool,
    ) -> Result<Self, Failure> {
        let name = method.about().name;
        let keys = method.keys();
        let dial = DIALS.iter().find(|(dial, _)| keys.iter().any(|key| key.name == *dial));
        let (key, values) = dial.map_or(("", &[""][..]), |(key, values)| (*key, &values[..]));
        let values = if quick { &values[..values.len().min(3)] } else { values };
        let mut curve = Self { method, key, points: Vec::new(), picture: None };
        for (index, &value) in values.iter().enumerate() {
            let assignment = if key.is_empty() { vec![] } else { vec![format!("{key}={value}")] };
            let settings = Settings::parse(&format!("method `{name}`"), &keys, &assignment)?;
            let plan = look.plan(method, settings)?;
            let prepared = stage.prepare(&plan)?;
            let start = Instant::now();
            let rendered =
                stage.render(&plan, &prepared, params, &Watched::new(&format!("{name} {assignment:?}")))?;
            let render_seconds = start.elapsed().as_secs_f64();
            if stop::asked() {
                break;
            }
            let point = Point {
                value,
                build_seconds: prepared.seconds,
                render_seconds,
                counts: report::counts(&rendered.counts),
                errors: report::errors(&rendered, truth)?,
            };
            eprintln!(
                "{name:>14} {:<15} {render_seconds:>8.2} s, {}",
                assignment.concat(),
                report::errors_line(&point.errors)
            );
            curve.points.push(point);
            if index == values.len() / 2 {
                curve.picture = Some(rendered.film);
            }
        }
        Ok(curve)
    }

    /// Seconds to render to a relMSE of `target`, by a straight line in the logarithms between the two
    /// settings around it; `None` where the curve does not get there.
    pub(super) fn seconds_to(&self, target: f64) -> Option<f64> {
        seconds_to(self.points.iter().map(|p| (p.render_seconds, p.errors.relmse)), target)
    }
}

/// See [`Curve::seconds_to`]; the points are seconds and errors.
fn seconds_to(points: impl Iterator<Item = (f64, f64)>, target: f64) -> Option<f64> {
    let mut before: Option<(f64, f64)> = None;
    for (seconds, error) in points {
        if error <= target {
            let Some((s0, e0)) = before else { return Some(seconds) };
            let along = (e0 / target).ln() / (e0 / error.max(f64::MIN_POSITIVE)).ln();
            return Some(s0 * (seconds / s0).powf(along));
        }
        before = Some((seconds, error));
    }
    None
}

impl Point {
    /// For other programs.
    pub(super) fn json(&self) -> Value {
        json!({
            "value": self.value,
            "seconds": { "build_lights": self.build_seconds, "render": self.render_seconds },
            "counts": self.counts,
            "error": report::errors_json(&self.errors),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::seconds_to;

    #[test]
    fn times_are_read_off_the_curve_in_logarithms() {
        let noise = [(1.0, 1.0), (4.0, 0.25), (16.0, 0.0625)];
        let at = |target| seconds_to(noise.into_iter(), target);
        assert!((at(0.5).unwrap() - 2.0).abs() < 1e-12 && (at(0.125).unwrap() - 8.0).abs() < 1e-12);
        assert_eq!((at(2.0), at(0.0625), at(0.01)), (Some(1.0), Some(16.0), None));
    }

    #[test]
    fn every_method_of_direct_light_has_a_dial() {
        for method in crate::methods::Method::all().filter(|&method| super::is_direct(method)) {
            let keys = method.keys();
            let has = super::DIALS.iter().any(|(dial, _)| keys.iter().any(|key| key.name == *dial));
            assert!(has, "{} has no dial that a curve could go over", method.about().name);
        }
    }
}
