//! How fast does a view come right after an edit?
//!
//! Four kinds of edit in three scenes, as in the paper's section 6: the error of what a camera sees, relative
//! to its error before the first update, against lights accumulated. The view is what a camera sees of the
//! scene before the edit. Clusters by invalid flux, clusters first in, first out, and a bake from scratch. A
//! line for each, and the curves as SVG into the folder named after `--svg`. `--quick` runs a small one;
//! `--watch 64` says so many points of what is looked at, `--blind` none, `--why` what became of lights and
//! how few changes would do, `--scene museum` runs one of them, `--points` where the curves are, `--least 0.5`
//! sets the least share of validation.

mod common;
#[path = "common/spending.rs"]
mod spending;

use std::fmt::Write as _;

use bake::{Baker, LightKey, StepBudget, UpdateOrder};
use common::{Host, View, baker, finish, stage};
use glam::Vec3;
use plotters::prelude::*;

/// What a designer does.
const EDITS: [&str; 4] = ["lamp moved", "crate moved", "floor painted", "partition put up"];

/// How deep the partition waits.
const BELOW: f32 = 100.0;

/// Name, size, paths, clusters, and pixels of the view.
type Run = (&'static str, usize, u32, usize, (u32, u32));

/// What was asked for.
#[derive(Clone, Copy)]
struct Options {
    /// Say where accumulations go.
    why: bool,
    /// Nobody says what is looked at.
    blind: bool,
    /// The least share of validation.
    least: f64,
    /// How many points of the view are said to be looked at.
    watch: u32,
}

/// Error over initial error after so many accumulations.
type Curve = Vec<(f64, f64)>;

struct Case {
    edit: &'static str,
    by_flux: Curve,
    in_order: Curve,
    /// Lights of a bake from scratch.
    from_scratch: usize,
    updates: u64,
    /// Where accumulations go, if asked.
    spent: String,
}

fn edit(name: &str, host: &mut Host, baker: &mut Baker) {
    let objects = host.now().scene.instances.len();
    match name {
        "lamp moved" => {
            let power = |&key: &LightKey| baker.light(key).unwrap().flux.element_sum();
            let brightest = baker.light_keys().max_by(|a, b| power(a).total_cmp(&power(b))).unwrap();
            let mut light = baker.light(brightest).unwrap().clone();
            light.transform.translation += glam::Vec3A::new(1.5, 0.0, 1.0);
            baker.set_light(brightest, light).unwrap();
        }
        "crate moved" => host.change(baker, objects - 2, |scene| {
            scene.instances[objects - 2].to_world.translation += glam::Vec3A::new(2.0, 0.0, -2.0);
        }),
        "floor painted" => host.paint(baker, 0, Vec3::new(0.8, 0.3, 0.2)),
        // It waits below the ground.
        _ => host.change(baker, objects - 1, |scene| {
            scene.instances[objects - 1].to_world.translation.y += BELOW;
        }),
    }
}

fn measure((name, lights, paths, clusters, size): Run, options: Options) -> Vec<Case> {
    let mut scene = stage(name, lights);
    let mut start = baker(&scene, paths, clusters, |params| bake::BakeParams {
        least_validation: options.least,
        ..params
    });
    let wall = scene.instances.len() - 1;
    scene.instances[wall].to_world.translation.y -= BELOW;
    let host = Host::new(scene);
    let budget = StepBudget { paths: 4096, accumulations: 1 };
    let mut view = View::new(host.now(), size);
    finish(&mut start, &host, &mut view, budget, |_| {});
    if options.why {
        print!("{name}\n{}", spending::borders(&start.contributions().cloned().collect::<Vec<_>>()));
    }
    EDITS.iter().map(|edit| case(edit, &start, &host, &view, (budget, size), options)).collect()
}

fn case(
    name: &'static str,
    start: &Baker,
    before: &Host,
    seen: &View,
    (budget, size): (StepBudget, (u32, u32)),
    options: Options,
) -> Case {
    let run = |order: UpdateOrder| -> (Curve, Baker, Host) {
        let mut host = Host { versions: before.versions.clone(), current: before.current };
        let mut baker = start.clone();
        baker.set_order(order);
        if !options.blind {
            // What is looked at is not what the error is taken of: the same camera, but other points.
            baker.watch(&common::spread(before.now(), size, options.watch)).unwrap();
            // One look at what is baked, before it changes.
            baker.step(StepBudget { paths: 0, accumulations: 0 }, &host.trace(), &mut |_| {});
        }
        edit(name, &mut host, &mut baker);
        let mut view = View { accumulations: 0, ..seen.clone() };
        // What is right is known in the end.
        let mut states = vec![(0, narrowed(&view.sums))];
        finish(&mut baker, &host, &mut view, budget, |view| {
            states.push((view.accumulations, narrowed(&view.sums)));
        });
        let truth = states.last().unwrap().1.clone();
        let initial = rms(&states[0].1, &truth);
        let relative = |(at, sums): &(usize, Vec<f32>)| (*at as f64, rms(sums, &truth) / initial);
        (states.iter().map(relative).collect(), baker, host)
    };
    let (by_flux, done, host) = run(UpdateOrder::InvalidFlux);
    let (in_order, ..) = run(UpdateOrder::FirstInFirstOut);
    let (from, to) = (start.stats(), done.stats());
    let updates =
        to.validation_updates + to.balancing_updates - from.validation_updates - from.balancing_updates;
    let lights = |baker: &Baker| baker.contributions().cloned().collect::<Vec<_>>();
    let spent = if options.why {
        spending::spending(&lights(start), &lights(&done), &host, seen)
    } else {
        String::new()
    };
    Case { edit: name, by_flux, in_order, from_scratch: done.contributions().count(), updates, spent }
}

fn narrowed(sums: &[f64]) -> Vec<f32> {
    sums.iter().map(|&sum| sum as f32).collect()
}

fn rms(a: &[f32], b: &[f32]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    (squares / a.len() as f64).sqrt()
}

/// Accumulations until the error stays below a tenth.
fn until_tenth(curve: &Curve) -> f64 {
    let last_above = curve.iter().rposition(|&(_, error)| error >= 0.1);
    last_above.map_or(0.0, |i| curve.get(i + 1).map_or(f64::INFINITY, |point| point.0))
}

/// ∫ error up to `end`.
fn area(curve: &Curve, end: f64) -> f64 {
    let step = |pair: &[(f64, f64)]| pair[0].1 * (pair[1].0.min(end) - pair[0].0.min(end));
    curve.windows(2).map(step).sum()
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let quick = args.iter().any(|arg| arg == "--quick" || arg == "--test");
    let least = args.iter().position(|arg| arg == "--least").and_then(|i| args.get(i + 1)?.parse().ok());
    let asked = |name: &str| args.iter().any(|arg| arg == name);
    let watch = args.iter().position(|arg| arg == "--watch").and_then(|i| args.get(i + 1)?.parse().ok());
    let options = Options {
        why: asked("--why"),
        blind: asked("--blind"),
        least: least.unwrap_or(0.5),
        watch: watch.unwrap_or(4096),
    };
    let svg = args.iter().position(|arg| arg == "--svg").and_then(|i| args.get(i + 1));
    let scenes: &[Run] = if quick {
        &[("warehouse", 24, 4000, 80, (24, 14))]
    } else {
        &[
            ("museum", 48, 100_000, 1500, (32, 18)),
            ("town", 120, 100_000, 1500, (32, 18)),
            ("warehouse", 24, 100_000, 1500, (32, 18)),
        ]
    };
    println!(
        "{:<11}{:<18}{:>9}{:>11}{:>9}{:>11}{:>8}{:>10}{:>10}",
        "scene", "edit", "to 10 %", "fifo 10 %", "scratch", "scratch/x", "area x", "all", "per update"
    );
    let only = args.iter().position(|arg| arg == "--scene").and_then(|i| args.get(i + 1));
    for &(name, lights, paths, clusters, size) in
        scenes.iter().filter(|run| only.is_none_or(|only| only == run.0))
    {
        let cases = measure((name, lights, paths, clusters, size), options);
        for case in &cases {
            let end = case.by_flux.last().unwrap().0.max(case.in_order.last().unwrap().0);
            let all = case.by_flux.last().unwrap().0;
            let mut line = format!("{name:<11}{:<18}", case.edit);
            let (ours, fifo) = (until_tenth(&case.by_flux), until_tenth(&case.in_order));
            let scratch = case.from_scratch as f64;
            let ratio = area(&case.in_order, end) / area(&case.by_flux, end);
            write!(line, "{ours:>9}{fifo:>11}{scratch:>9}{:>11.1}", scratch / ours).unwrap();
            write!(line, "{ratio:>8.2}{all:>10}{:>10.2}", all / case.updates.max(1) as f64).unwrap();
            println!("{line}");
            print!("{}", case.spent);
            if args.iter().any(|arg| arg == "--points") {
                for curve in [&case.by_flux, &case.in_order] {
                    let at = |share: f64| curve.iter().take_while(|p| p.0 <= share * end).last().unwrap().1;
                    let shares = [0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.0];
                    println!("    {:?}", shares.map(|share| (at(share) * 1000.0).round() / 1000.0));
                }
            }
        }
        if let Some(folder) = svg {
            let path = format!("{folder}/bake-{name}.svg");
            let drawn = plot(name, &cases);
            if let Err(error) = std::fs::write(&path, drawn) {
                eprintln!("{path}: {error}");
                std::process::exit(1);
            }
        }
    }
}

/// A panel for each edit.
fn plot(name: &str, cases: &[Case]) -> String {
    const COLORS: [RGBColor; 3] = [RGBColor(86, 180, 233), RGBColor(230, 159, 0), RGBColor(170, 170, 170)];
    const INK: RGBColor = RGBColor(220, 220, 220);
    const BACKGROUND: RGBColor = RGBColor(22, 24, 28);
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (1000, 700)).into_drawing_area();
        area.fill(&BACKGROUND).unwrap();
        for (panel, case) in area.split_evenly((2, 2)).iter().zip(cases) {
            let end = case.by_flux.last().unwrap().0.max(case.in_order.last().unwrap().0).max(2.0);
            let mut chart = ChartBuilder::on(panel)
                .caption(format!("{name}: {}", case.edit), ("sans-serif", 16).into_font().color(&INK))
                .margin(10)
                .x_label_area_size(36)
                .y_label_area_size(50)
                .build_cartesian_2d(0.0..end, 0.0..1.1)
                .unwrap();
            chart
                .configure_mesh()
                .x_desc("lights accumulated")
                .y_desc("RMS error over initial")
                .x_label_formatter(&|x| format!("{x:.0}"))
                .label_style(("sans-serif", 12).into_font().color(&INK))
                .axis_style(INK)
                .bold_line_style(INK.mix(0.2))
                .light_line_style(INK.mix(0.0))
                .draw()
                .unwrap();
            for ((curve, color), label) in [&case.by_flux, &case.in_order]
                .into_iter()
                .zip(COLORS)
                .zip(["largest change first", "first in, first out"])
            {
                // A few hundred points show all there is.
                let every = (curve.len() / 300).max(1);
                let thinned = curve.iter().step_by(every).chain(curve.last()).copied();
                chart
                    .draw_series(LineSeries::new(thinned, color.stroke_width(2)))
                    .unwrap()
                    .label(label)
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], color.stroke_width(3)));
            }
            let scratch = case.from_scratch as f64;
            chart
                .draw_series(LineSeries::new([(scratch, 0.0), (scratch, 1.1)], COLORS[2].stroke_width(1)))
                .unwrap()
                .label("all lights once")
                .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], COLORS[2].stroke_width(2)));
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::UpperRight)
                .background_style(BACKGROUND.mix(0.85))
                .border_style(INK.mix(0.3))
                .label_font(("sans-serif", 12).into_font().color(&INK))
                .draw()
                .unwrap();
        }
        area.present().unwrap();
    }
    svg
}
