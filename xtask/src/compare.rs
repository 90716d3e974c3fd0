//! `cargo xtask compare`: several methods on one scene against one reference, at equal time.

mod page;
mod reference;

use std::path::PathBuf;
use std::time::Instant;

use scene::{Counts, Errors, Film, RenderParams, Rendered, SceneRays};
use serde_json::{Value, json};

use crate::failure::Failure;
use crate::methods::Method;
use crate::methods::filter::Filter;
use crate::progress::Watched;
use crate::provenance::{provenance, units};
use crate::report;
use crate::settings::{self, Settings};
use crate::shot::{Plan, Stage};
use crate::{output, render, source, stop};
use reference::Reference;
pub(crate) use reference::blend;

/// What to compare.
#[derive(clap::Args)]
pub(crate) struct CompareArgs {
    /// A .glb or .gltf file, or a built-in scene with an optional number of lights: hall:10000, cornell,
    /// city:100000, glossy:1000, wall:1000000
    #[arg(default_value = source::DEFAULT_SCENE)]
    scene: String,

    /// Methods, separated by commas
    #[arg(
        long,
        value_name = "A,B,...",
        value_delimiter = ',',
        default_value = "uniform,power,tree,lightcut"
    )]
    methods: Vec<String>,

    /// The truth; without it one is made, by every light (`brute`) or by path tracing with --gi path, and its
    /// own noise is measured
    #[arg(long, value_name = "FILE.exr")]
    reference: Option<PathBuf>,

    /// Seconds that each method has, to build its tree and to render; a method whose single sample per pixel
    /// takes longer has that long
    #[arg(long, value_name = "S", default_value_t = 10.0, value_parser = seconds)]
    seconds_per_method: f64,

    /// Seconds for a reference that has to be made; what is out of reach in them is judged on fewer pixels
    #[arg(long, value_name = "S", default_value_t = 60.0, value_parser = seconds)]
    reference_seconds: f64,

    /// Turn a dial, for all methods that have it
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,

    #[command(flatten)]
    look: render::LookArgs,

    /// Folder for the page, the pictures and the data; made if it is not there
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|s| (0.01..=1e6).contains(s));
    seconds.ok_or_else(|| "write seconds from 0.01 to 1000000".to_owned())
}

/// What one method did in its time.
struct Row {
    method: Method,
    settings: Settings,
    film: Film,
    spp: u32,
    build_seconds: f64,
    render_seconds: f64,
    counts: Counts,
    errors: Errors,
}

/// Renders with every method for the same time and writes table, pictures, page and data.
pub(crate) fn compare(args: &CompareArgs) -> Result<(), Failure> {
    let plans = plans(args)?;
    let (width, height) = args.look.size;
    let given = args.reference.as_deref().map(|path| report::reference(path, args.look.size)).transpose()?;
    stop::listen()?;
    render::use_threads(args.look.threads)?;
    output::check_folder(&args.output)?;

    // Set the stage.
    let settings = &plans[0].settings;
    let (scene, _) = source::load(&args.scene, source::material_mode(settings)?)?;
    let camera = source::camera(&scene, settings)?;
    let rays =
        SceneRays::build(&scene).map_err(|error| Failure::failed(format!("{}: {error}", scene.name)))?;
    let stage = Stage { scene: &scene, rays: &rays, camera: &camera };
    let params = RenderParams {
        width,
        height,
        spp: 1,
        first_sample: 0,
        threads: args.look.threads as usize,
        pixels: None,
    };

    output::make_folder(&args.output)?;

    // Get the truth.
    let reference = match given {
        Some(film) => Reference::given(film),
        None => Reference::make(&stage, &plans[0], &params, args.reference_seconds)?,
    };
    eprintln!("reference: {}", reference.describe());

    // Give each method its time.
    let mut rows = Vec::new();
    for plan in &plans {
        let Some(row) = run(&stage, plan, &params, args.seconds_per_method, &reference)? else { break };
        eprintln!("{}", line(&row));
        rows.push(row);
        if stop::asked() {
            break;
        }
    }

    if rows.is_empty() {
        let line = "cut short before the first method was finished; nothing is written";
        return Err(Failure::Interrupted(line.to_owned()));
    }

    // Write it all with one exposure.
    let exposure = render::exposure(settings, &reference.film);
    let about = json!({ "scene": scene.name, "camera": camera.name, "reference": reference.json() });
    output::picture(&args.output.join("reference.exr"), &reference.film, exposure, &about)?;
    for (row, plan) in rows.iter().zip(&plans) {
        let path = args.output.join(format!("{}.exr", row.method.about().name));
        let about = plan.about(&scene.name, &camera.name, &RenderParams { spp: row.spp, ..params });
        output::picture(&path, &row.film, exposure, &about)?;
    }
    let data = data(&stage, &plans[0], &params, args, &reference, &rows, exposure);
    output::text(&args.output.join("data.json"), &format!("{data:#}\n"))?;
    output::text(&args.output.join("data.csv"), &csv(&rows))?;
    output::text(&args.output.join("index.html"), &page::page(&data))?;
    output::print(&table(&rows))?;
    eprintln!("wrote {}", args.output.join("index.html").display());
    if stop::asked() {
        return Err(Failure::Interrupted(format!(
            "{}: cut short after {} of {} methods",
            args.output.display(),
            rows.len(),
            plans.len()
        )));
    }
    Ok(())
}

/// One plan per method. A key has to belong to one of the methods at least; those that do not have it go
/// without.
fn plans(args: &CompareArgs) -> Result<Vec<Plan>, Failure> {
    let methods = args.methods.iter().map(|name| Method::named(name)).collect::<Result<Vec<_>, _>>()?;
    if let Some((_, twice)) =
        args.methods.iter().enumerate().find(|(i, name)| args.methods[..*i].contains(name))
    {
        return Err(Failure::usage(format!("--methods: `{twice}` is there twice: leave one of them out")));
    }
    for assignment in &args.set {
        let (key, _) = settings::split(assignment)?;
        if !methods.iter().any(|method| method.keys().iter().any(|k| k.name == key)) {
            let all: Vec<_> = methods.iter().flat_map(|method| method.keys()).collect();
            Settings::parse(
                &format!("none of {}", args.methods.join(", ")),
                &all,
                std::slice::from_ref(assignment),
            )?;
        }
    }
    let plan = |method: Method| {
        let keys = method.keys();
        let mine: Vec<_> = args
            .set
            .iter()
            .filter(|a| settings::split(a).is_ok_and(|(key, _)| keys.iter().any(|k| k.name == key)))
            .cloned()
            .collect();
        let settings = Settings::parse(&format!("method `{}`", method.about().name), &keys, &mine)?;
        if Filter::is_in(&settings) {
            let line = "--set filter: `compare` judges what methods draw; filter pictures with `render`";
            return Err(Failure::usage(line));
        }
        args.look.plan(method, settings)
    };
    methods.into_iter().map(plan).collect()
}

/// Renders one sample per pixel, and then as many more as the rest of the time allows. `None` if that was cut
/// short before each pixel had one.
fn run(
    stage: &Stage<'_>,
    plan: &Plan,
    params: &RenderParams,
    seconds: f64,
    reference: &Reference,
) -> Result<Option<Row>, Failure> {
    let watched = Watched::new(plan.method.about().name);
    let prepared = stage.prepare(plan)?;
    let start = Instant::now();
    let first = stage.render(plan, &prepared, params, &watched)?;
    if first.cut_short {
        return Ok(None);
    }
    let once = start.elapsed().as_secs_f64();
    let more = ((seconds - prepared.seconds - once) / once).floor().clamp(0.0, 1e6) as u32;
    let (mut film, mut counts, mut spp) = (first.film, first.counts, 1);
    if more > 0 && !stop::asked() {
        let params = RenderParams { spp: more, first_sample: 1, ..*params };
        let rest = stage.render(plan, &prepared, &params, &watched)?;
        if !rest.cut_short {
            blend(&mut film, 1, &rest.film, more);
            counts.add(&rest.counts);
            spp += more;
        }
    }
    let render_seconds = start.elapsed().as_secs_f64();
    let mask = reference.mask.clone().or(first.mask);
    let rendered = Rendered { film, counts, mask, cut_short: false };
    let errors = report::errors(&rendered, &reference.film)?;
    let Rendered { film, counts, .. } = rendered;
    Ok(Some(Row {
        method: plan.method,
        settings: plan.settings.clone(),
        film,
        spp,
        build_seconds: prepared.seconds,
        render_seconds,
        counts,
        errors,
    }))
}

fn line(row: &Row) -> String {
    format!(
        "{:>9}: {:>5} spp in {:>7.2} s, {:>12} shadow rays, {}",
        row.method.about().name,
        row.spp,
        row.build_seconds + row.render_seconds,
        row.counts.shadow_rays,
        report::errors_line(&row.errors)
    )
}

/// The table on standard output.
fn table(rows: &[Row]) -> String {
    let mut text = format!(
        "{:<10} {:>6} {:>9} {:>9} {:>13} {:>11} {:>11} {:>8} {:>8} {:>8}\n",
        "method", "spp", "build s", "render s", "shadow rays", "relMSE", "MSE", "MAPE", "SSIM", "FLIP"
    );
    let optional = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |v| format!("{v:.4}"));
    for row in rows {
        let Errors { mse, relmse, mape, ssim, flip, .. } = row.errors;
        text += &format!(
            "{:<10} {:>6} {:>9.3} {:>9.3} {:>13} {relmse:>11.3e} {mse:>11.3e} {mape:>8.4} {:>8} {:>8}\n",
            row.method.about().name,
            row.spp,
            row.build_seconds,
            row.render_seconds,
            row.counts.shadow_rays,
            optional(ssim),
            optional(flip)
        );
    }
    text
}

/// Everything that the page shows, for other programs.
fn data(
    stage: &Stage<'_>,
    like: &Plan,
    params: &RenderParams,
    args: &CompareArgs,
    reference: &Reference,
    rows: &[Row],
    exposure: f32,
) -> Value {
    let scene = stage.scene;
    let rows: Vec<_> = rows
        .iter()
        .map(|row| {
            json!({
                "method": row.method.about().name,
                "what": row.method.about().what,
                "settings": row.settings.json(),
                "spp": row.spp,
                "seconds": { "build_lights": row.build_seconds, "render": row.render_seconds },
                "counts": report::counts(&row.counts),
                "error": report::errors_json(&row.errors),
                "picture": format!("{}.png", row.method.about().name),
            })
        })
        .collect();
    json!({
        "scene": scene.name,
        "triangles": scene.triangle_count(),
        "lights": scene.lights.len() + scene.distant.len(),
        "camera": stage.camera.name,
        "width": params.width,
        "height": params.height,
        "seed": like.seed,
        "gi": like.gi.name(),
        "bounces": like.bounces,
        "vpls": like.gi.vpls(),
        "exposure": exposure,
        "seconds_per_method": args.seconds_per_method,
        "threads": rayon::current_num_threads(),
        "reference": reference.json(),
        "methods": rows,
        "units": units(),
        "made_by": provenance(),
    })
}

/// A line per method. What all of them share is in `data.json`.
fn csv(rows: &[Row]) -> String {
    let mut text = String::from(
        "method,spp,build_seconds,render_seconds,shadow_rays,light_evaluations,node_visits,mse,relmse,mape,bias,ssim,flip\n",
    );
    let optional = |value: Option<f64>| value.map_or_else(String::new, |v| v.to_string());
    for row in rows {
        let Errors { mse, relmse, mape, bias, ssim, flip } = row.errors;
        let Counts { shadow_rays, light_evaluations, node_visits, .. } = row.counts;
        text += &format!(
            "{},{},{},{},{shadow_rays},{light_evaluations},{node_visits},{mse},{relmse},{mape},{bias},{},{}\n",
            row.method.about().name,
            row.spp,
            row.build_seconds,
            row.render_seconds,
            optional(ssim),
            optional(flip)
        );
    }
    text
}
