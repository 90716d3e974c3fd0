//! `cargo xtask report`: what each method gives for its time, dial by dial.

mod page;
mod plot;
mod sweep;

use std::path::PathBuf;
use std::time::Instant;

use scene::{RenderParams, SceneRays};
use serde_json::{Value, json};

use crate::compare::blend;
use crate::failure::Failure;
use crate::methods::Method;
use crate::progress::Watched;
use crate::provenance::{provenance, units};
use crate::render::{self, LookArgs};
use crate::settings::Settings;
use crate::shot::{Plan, Stage};
use crate::{output, source, stop};
use sweep::{Curve, Point};

/// What to report on.
#[derive(clap::Args)]
pub(crate) struct ReportArgs {
    /// Scenes, separated by commas: files, or built-in scenes [default:
    /// hall:10000,city:10000,glossy:1000,wall:100000]
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    scenes: Vec<String>,

    /// Methods, separated by commas [default: all methods of direct light]
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    methods: Vec<String>,

    /// Camera samples per pixel, of the reference and of every method alike: the same rays, so that what
    /// differs is light selection alone
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=4096))]
    spp: u32,

    /// Few lights, small pictures and short curves: a minute or two, to see that all of it works
    #[arg(long)]
    quick: bool,

    #[command(flatten)]
    look: LookArgs,

    /// Folder for the page, the curves, the pictures and the data; made if it is not there
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
}

/// Every class of scene once: clustered lamps, facades, gloss, virtual lights.
const SCENES: [&str; 4] = ["hall:10000", "city:10000", "glossy:1000", "wall:100000"];
const QUICK_SCENES: [&str; 2] = ["hall:300", "city:300"];

/// Writes curves of error against time for every method on every scene.
pub(crate) fn report(args: &ReportArgs) -> Result<(), Failure> {
    let methods = methods(args)?;
    let names: Vec<&str> = match (args.scenes.is_empty(), args.quick) {
        (false, _) => args.scenes.iter().map(String::as_str).collect(),
        (true, false) => SCENES.to_vec(),
        (true, true) => QUICK_SCENES.to_vec(),
    };
    stop::listen()?;
    render::use_threads(args.look.threads)?;
    output::check_folder(&args.output)?;

    let mut scenes = Vec::new();
    for (index, name) in names.iter().enumerate() {
        scenes.push(one_scene(args, name, &format!("scene{index}"), &methods)?);
        if stop::asked() {
            break;
        }
    }

    let data = json!({
        "threads": rayon::current_num_threads(), "spp": args.spp, "seed": args.look.seed, "scenes": scenes,
        "units": units(), "made_by": provenance(),
    });
    output::text(&args.output.join("data.json"), &format!("{data:#}\n"))?;
    output::text(&args.output.join("data.csv"), &csv(&data))?;
    output::text(&args.output.join("index.html"), &page::page(&data))?;
    eprintln!("wrote {}", args.output.join("index.html").display());
    if scenes.len() < names.len() {
        let line =
            format!("{}: cut short after {} of {} scenes", args.output.display(), scenes.len(), names.len());
        return Err(Failure::Interrupted(line));
    }
    Ok(())
}

/// Methods of direct light, which `brute` judges.
fn methods(args: &ReportArgs) -> Result<Vec<Method>, Failure> {
    if args.methods.is_empty() {
        return Ok(Method::all().filter(|&method| sweep::is_direct(method)).collect());
    }
    let named = |name: &String| {
        let method = Method::named(name)?;
        if sweep::is_direct(method) {
            return Ok(method);
        }
        Err(Failure::usage(format!(
            "method `{name}` is no approximation of direct light; compare it by `cargo xtask compare --gi path`"
        )))
    };
    args.methods.iter().map(named).collect()
}

/// All curves of one scene: pictures and plot are written, the figures returned.
fn one_scene(args: &ReportArgs, name: &str, stem: &str, methods: &[Method]) -> Result<Value, Failure> {
    let brute = Settings::parse("the reference", &Method::Brute.keys(), &[])?;
    let (scene, _) = source::load(name, source::material_mode(&brute)?)?;
    let camera = source::camera(&scene, &brute)?;
    let rays =
        SceneRays::build(&scene).map_err(|error| Failure::failed(format!("{}: {error}", scene.name)))?;
    let stage = Stage { scene: &scene, rays: &rays, camera: &camera };
    output::make_folder(&args.output)?;
    let (width, height) = if args.quick { (96, 54) } else { args.look.size };
    let params = RenderParams {
        width,
        height,
        spp: args.spp,
        threads: args.look.threads as usize,
        ..RenderParams::default()
    };

    // Every light at the very same points.
    let plan = args.look.plan(Method::Brute, brute)?;
    let truth = Truth::make(&stage, &plan, &params)?;
    eprintln!("{}: reference in {:.1} s, {}", scene.name, truth.seconds, truth.noise());
    let stops = scene::auto_exposure(&truth.film);
    let mut about = plan.about(&scene.name, &camera.name, &params);
    output::picture(&args.output.join(format!("{stem}-reference.exr")), &truth.film, stops, &about)?;

    // Every method, from its cheapest setting to its dearest.
    let mut curves = Vec::new();
    for &method in methods {
        let curve = Curve::measure(&stage, &args.look, method, &params, &truth.film, args.quick)?;
        let picture = args.output.join(format!("{stem}-{}.exr", method.about().name));
        if let Some(film) = &curve.picture {
            let middle = &curve.points[curve.points.len() / 2];
            about["method"] = method.about().name.into();
            about["settings"] =
                if curve.key.is_empty() { json!({}) } else { json!({ curve.key: middle.value }) };
            output::picture(&picture, film, stops, &about)?;
        }
        curves.push(curve);
        if stop::asked() {
            break;
        }
    }
    let svg = format!("{stem}.svg");
    let about = json!({
        "scene": scene.name, "lights": scene.lights.len() + scene.distant.len(), "width": width, "height": height,
        "spp": args.spp, "seed": plan.seed, "made_by": provenance(),
    });
    let plot = plot::plot(&about, rayon::current_num_threads(), &curves)?;
    output::text(&args.output.join(&svg), &plot)?;
    Ok(json!({
        "scene": scene.name,
        "stem": stem,
        "triangles": scene.triangle_count(),
        "lights": scene.lights.len() + scene.distant.len(),
        "camera": camera.name,
        "width": width,
        "height": height,
        "gi": plan.gi.name(),
        "bounces": plan.bounces,
        "vpls": plan.gi.vpls(),
        "exposure": stops,
        "reference": { "method": "brute", "seconds": truth.seconds, "noise": truth.relmse, "description": truth.noise() },
        "curves": curves.iter().map(Curve::json).collect::<Vec<_>>(),
    }))
}

/// Every light at every point.
struct Truth {
    film: scene::Film,
    seconds: f64,
    /// relMSE of the reference itself, estimated; `None`: no light has an area, and it is exact.
    relmse: Option<f64>,
}

/// Pictures of the same camera rays, with other places on area lights, that make a reference.
const REFERENCE_PICTURES: u32 = 8;

impl Truth {
    fn make(stage: &Stage<'_>, plan: &Plan, params: &RenderParams) -> Result<Self, Failure> {
        let prepared = stage.prepare(plan)?;
        let start = Instant::now();
        let picture = |number: u32| {
            // Places that no method uses: the reference must not share their luck.
            let plan = Plan { light_seed: plan.seed.wrapping_add(1 + number), ..plan.clone() };
            let rendered = stage.render(&plan, &prepared, params, &Watched::new("reference"))?;
            if rendered.cut_short {
                let line = "cut short before the reference was finished; nothing of this scene is written";
                return Err(Failure::Interrupted(line.to_owned()));
            }
            Ok(rendered)
        };
        let first = picture(0)?;
        if stage.scene.lights.iter().all(scene::Light::is_point) {
            let seconds = start.elapsed().as_secs_f64();
            return Ok(Self { film: first.film, seconds, relmse: None });
        }

        // Two halves tell the noise: their mean's variance is a quarter of their mean squared difference.
        let mut halves = [first.film, picture(1)?.film];
        for number in 2..REFERENCE_PICTURES {
            let half = &mut halves[number as usize % 2];
            blend(half, number / 2, &picture(number)?.film, 1);
        }
        let [mut film, second] = halves;
        let apart =
            scene::compare(&second, &film, None).map_err(|error| Failure::failed(error.to_string()))?;
        blend(&mut film, 1, &second, 1);
        Ok(Self { film, seconds: start.elapsed().as_secs_f64(), relmse: Some(0.25 * apart.relmse) })
    }

    /// In half a sentence.
    fn noise(&self) -> String {
        self.relmse.map_or_else(
            || "it is exact for these camera rays".to_owned(),
            |relmse| format!("its own noise is {relmse:.1e} relMSE: smaller errors mean little"),
        )
    }
}

/// A line per measured point.
fn csv(data: &Value) -> String {
    let mut text = String::from(
        "scene,method,key,value,build_seconds,render_seconds,shadow_rays,light_evaluations,relmse,mse,mape,ssim,flip,bias,lights,width,height,spp,seed,reference_relmse\n",
    );
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    for scene in list(&data["scenes"]) {
        for curve in list(&scene["curves"]) {
            for point in list(&curve["points"]) {
                let number = |value: &Value| if value.is_null() { String::new() } else { value.to_string() };
                let error = &point["error"];
                let fields = [
                    scene["scene"].as_str().unwrap_or_default().replace([',', '"', '\n'], " "),
                    curve["method"].as_str().unwrap_or_default().to_owned(),
                    curve["key"].as_str().unwrap_or_default().to_owned(),
                    point["value"].as_str().unwrap_or_default().to_owned(),
                    number(&point["seconds"]["build_lights"]),
                    number(&point["seconds"]["render"]),
                    number(&point["counts"]["shadow_rays"]),
                    number(&point["counts"]["light_evaluations"]),
                    number(&error["relmse"]),
                    number(&error["mse"]),
                    number(&error["mape"]),
                    number(&error["ssim"]),
                    number(&error["flip"]),
                    number(&error["bias"]),
                    number(&scene["lights"]),
                    number(&scene["width"]),
                    number(&scene["height"]),
                    number(&data["spp"]),
                    number(&data["seed"]),
                    number(&scene["reference"]["noise"]),
                ];
                text += &(fields.join(",") + "\n");
            }
        }
    }
    text
}

impl Curve {
    /// For other programs, and for the page.
    fn json(&self) -> Value {
        let points = self.points.iter().map(Point::json).collect::<Vec<_>>();
        json!({
            "method": self.method.about().name,
            "what": self.method.about().what,
            "key": self.key,
            "points": points,
            "seconds_to_relmse": { "1e-2": self.seconds_to(1e-2), "1e-3": self.seconds_to(1e-3), "1e-4": self.seconds_to(1e-4) },
        })
    }
}
