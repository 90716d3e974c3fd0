//! Error against time as SVG.

use plotters::prelude::*;
use serde_json::Value;

use super::sweep::Curve;
use crate::failure::Failure;
use crate::html::escape;
use crate::provenance::machine_line;

/// Colours that stay apart for people who see red and green alike (Okabe and Ito 2008), and two more.
const COLORS: [RGBColor; 9] = [
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 158, 115),
    RGBColor(240, 228, 66),
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(204, 121, 167),
    RGBColor(170, 170, 170),
    RGBColor(120, 94, 240),
];

const SIZE: (u32, u32) = (900, 560);
const BACKGROUND: RGBColor = RGBColor(22, 24, 28);
const INK: RGBColor = RGBColor(220, 220, 220);

/// Both axes are logarithmic; a curve with an error of zero ends before it. `about` is what all curves share;
/// it is kept in the file, as its description.
///
/// # Errors
/// What the plotter says, which no data can cause.
pub(super) fn plot(about: &Value, threads: usize, curves: &[Curve]) -> Result<String, Failure> {
    let mut svg = String::new();
    let scene = about["scene"].as_str().unwrap_or_default();
    draw(&mut svg, about, threads, curves)
        .map_err(|error| Failure::failed(format!("{scene}: no plot: {error}")))?;
    // The first tag is the whole picture's.
    let description = format!(">\n<desc>{}</desc>", escape(&about.to_string()));
    Ok(svg.replacen('>', &description, 1))
}

fn draw(
    svg: &mut String,
    about: &Value,
    threads: usize,
    curves: &[Curve],
) -> Result<(), Box<dyn std::error::Error>> {
    let title = format!(
        "{}: {} lights, {}×{} pixels, {} per pixel, seed {}",
        about["scene"].as_str().unwrap_or_default(),
        about["lights"],
        about["width"],
        about["height"],
        about["spp"],
        about["seed"]
    );
    let series: Vec<Vec<(f64, f64)>> = curves
        .iter()
        .map(|curve| {
            let points = curve.points.iter().map(|p| (p.render_seconds, p.errors.relmse));
            points.filter(|&(seconds, error)| seconds > 0.0 && error > 0.0).collect()
        })
        .collect();
    let seconds = span(series.iter().flatten().map(|p| p.0));
    let errors = span(series.iter().flatten().map(|p| p.1));

    let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    area.fill(&BACKGROUND)?;
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", 18).into_font().color(&INK))
        .margin(14)
        .x_label_area_size(42)
        .y_label_area_size(70)
        .build_cartesian_2d(seconds.log_scale(), errors.log_scale())?;
    chart
        .configure_mesh()
        .x_desc(format!("seconds to render, {}", machine_line(threads)))
        .y_desc("relMSE, no unit")
        .label_style(("sans-serif", 14).into_font().color(&INK))
        .axis_style(INK)
        .bold_line_style(INK.mix(0.25))
        .light_line_style(INK.mix(0.07))
        .y_label_formatter(&|y| format!("{y:.0e}"))
        .draw()?;
    for (index, (curve, points)) in curves.iter().zip(&series).enumerate() {
        let color = COLORS[index % COLORS.len()];
        chart
            .draw_series(LineSeries::new(points.iter().copied(), color.stroke_width(2)).point_size(4))?
            .label(curve.method.about().name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(3)));
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(BACKGROUND.mix(0.85))
        .border_style(INK.mix(0.3))
        .label_font(("sans-serif", 14).into_font().color(&INK))
        .draw()?;
    area.present()?;
    Ok(())
}

/// All of the values and a little beyond; a decade around 1 if there are none.
fn span(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(low, high), v| (low.min(v), high.max(v)));
    if low > high { 0.3..3.0 } else { low / 1.5..high * 1.5 }
}
