//! Which tree, which way down it and how large a cut for which scene? Exact variances, without noise and
//! without a clock.
//!
//! For each receiver every light's probability is listed, and with it the variance of one light from each of
//! n subtrees is known. The figure is n × variance ÷ (L² + 0.01 mean(L)²), L what all lights give: the
//! expected relMSE times the number of light samples, so that cuts of all sizes compare at equal cost. Its
//! mean and median over the receivers are written to `exact-variance.csv` and `exact-variance.json` in
//! cargo's target folder, and printed. `--quick` takes fewer lights and receivers.

mod common;

use std::fmt::Write;
use std::path::PathBuf;

use common::{Class, classes, median};
use lighttree::oracle::Distribution;
use lighttree::{
    BuildParams, ChildChoice, LambertReceiver, LightBounds, LightHierarchy, LightId, LightTree, MortonBits,
    NodeId, PerfectTree, PowerSampler, TreeSampler, UniformSampler,
};
use stochastic::{CutParams, CutSampler, EnergySpread, Selection, SplitParams, SplitSampler, Subtrees};

const SIZES: [u32; 7] = [1, 2, 4, 8, 16, 32, 64];
const FLOORS: [f32; 5] = [0.0, 0.005, 0.02, 0.1, 0.5];
const DEFAULT_FLOOR: f32 = 0.02;

/// One line of the table.
struct Line {
    class: &'static str,
    builder: &'static str,
    choice: String,
    /// `cut`, `split`, or the name of a method without a tree.
    method: &'static str,
    nodes: u32,
    floor: f32,
    mean: f64,
    median: f64,
}

/// What the receivers of a class get, and what that is compared with.
struct Truth<'a> {
    class: &'a Class,
    /// By receiver, then by light.
    contributions: Vec<Vec<f64>>,
    totals: Vec<f64>,
    /// 1 % of the squared mean.
    floor: f64,
}

impl<'a> Truth<'a> {
    fn of(class: &'a Class) -> Self {
        let contributions: Vec<Vec<f64>> = class
            .receivers
            .iter()
            .map(|receiver| class.lamps.iter().map(|lamp| lamp.contribution(receiver)).collect())
            .collect();
        let totals: Vec<f64> = contributions.iter().map(|all| all.iter().sum()).collect();
        let mean = totals.iter().sum::<f64>() / totals.len() as f64;
        Self { class, contributions, totals, floor: 0.01 * mean * mean }
    }

    /// Mean and median of `samples` × variance, relative.
    fn figures(&self, scaled_variance: impl Fn(usize, &LambertReceiver) -> f64) -> (f64, f64) {
        let figure =
            |(i, receiver)| scaled_variance(i, receiver) / (self.totals[i] * self.totals[i] + self.floor);
        let all: Vec<f64> = self.class.receivers.iter().enumerate().map(figure).collect();
        (all.iter().sum::<f64>() / all.len() as f64, median(all))
    }

    /// n × the variance of one light from each of n subtrees.
    fn of_subtrees<T: LightHierarchy>(&self, i: usize, subtrees: &Subtrees<'_, T>) -> f64 {
        let (receiver, tree) = (&self.class.receivers[i], subtrees.walk.tree());
        let of_one = |&node: &NodeId| {
            // Σ c²/p - (Σ c)² within the subtree, as squared deviations.
            let lights: Vec<(f64, f64)> = tree
                .items(node)
                .map(|slot| tree.light_at(slot))
                .map(|light| {
                    let contribution = self.contributions[i][light.0 as usize];
                    (contribution, subtrees.walk.pmf_below(node, receiver, light))
                })
                .collect();
            let sum: f64 = lights.iter().map(|(c, _)| c).sum();
            let drawn: f64 = lights.iter().map(|(_, p)| p).sum();
            let deviations = lights.iter().filter(|(_, p)| *p > 0.0).map(|(c, p)| p * (c / p - sum).powi(2));
            deviations.sum::<f64>() + (1.0 - drawn).max(0.0) * sum * sum
        };
        subtrees.nodes.iter().map(of_one).sum::<f64>() * subtrees.nodes.len() as f64
    }
}

/// All lines of one tree.
fn of_tree<T: LightHierarchy>(truth: &Truth<'_>, builder: &'static str, tree: &T, lines: &mut Vec<Line>) {
    let class = truth.class.name;
    let spread = EnergySpread::of(tree);
    for choice in ChildChoice::ALL {
        let walk = || TreeSampler::new(tree).with_choice(choice);
        let mut push = |method, nodes, floor, (mean, median)| {
            lines.push(Line {
                class,
                builder,
                choice: format!("{choice:?}"),
                method,
                nodes,
                floor,
                mean,
                median,
            });
        };
        let cut = |nodes, distance_floor| {
            let sampler = CutSampler::with_walk(walk(), CutParams { nodes, distance_floor });
            truth.figures(|i, receiver| {
                let mut selection = Selection::default();
                truth.of_subtrees(i, &sampler.subtrees(sampler.select(receiver, &mut selection)))
            })
        };
        for nodes in SIZES {
            push("cut", nodes, DEFAULT_FLOOR, cut(nodes, DEFAULT_FLOOR));
        }
        if choice != ChildChoice::default() {
            continue;
        }
        for floor in FLOORS.into_iter().filter(|&floor| floor != DEFAULT_FLOOR) {
            push("cut", 16, floor, cut(16, floor));
        }
        for max_nodes in [4, 8, 16, 32] {
            let params = SplitParams { threshold: 1.0, max_nodes, distance_floor: DEFAULT_FLOOR };
            let sampler = SplitSampler::new(walk(), &spread, params);
            let figures = truth.figures(|i, receiver| {
                let mut selection = Selection::default();
                truth.of_subtrees(i, &sampler.subtrees(sampler.select(receiver, &mut selection)))
            });
            push("split", max_nodes, DEFAULT_FLOOR, figures);
        }
    }
}

/// All lines of one class.
fn of_class(class: &Class, lines: &mut Vec<Line>) {
    let truth = Truth::of(class);
    let bounds: Vec<LightBounds> = class.lamps.iter().map(|lamp| lamp.bounds()).collect();
    let count = bounds.len() as u32;
    let power = PowerSampler::new(&bounds).expect("finite lights");
    let without_tree = |distribution: &dyn Fn(&LambertReceiver) -> Distribution| {
        truth.figures(|i, receiver| {
            distribution(receiver).moments(|light: LightId| truth.contributions[i][light.0 as usize]).variance
        })
    };
    for (method, (mean, median)) in [
        ("uniform", without_tree(&|r| Distribution::of(&UniformSampler { count }, r, count))),
        ("power", without_tree(&|r| Distribution::of(&power, r, count))),
    ] {
        let (builder, choice) = ("", String::new());
        lines.push(Line { class: class.name, builder, choice, method, nodes: 1, floor: 0.0, mean, median });
    }
    for (name, params) in [
        ("median", BuildParams::median()),
        ("saoh", BuildParams::saoh()),
        ("agglomerative", BuildParams::agglomerative()),
        ("morton", BuildParams::morton()),
    ] {
        of_tree(&truth, name, &LightTree::build(&bounds, &params).expect("finite lights"), lines);
    }
    let perfect = PerfectTree::build(&bounds, MortonBits::default()).expect("finite lights");
    of_tree(&truth, "perfect", &perfect, lines);
}

fn print(lines: &[Line]) {
    let is_default = |line: &&Line| line.floor == DEFAULT_FLOOR && line.method == "cut";
    let of = |class: &str, builder: &str, choice: &str| -> Vec<&Line> {
        let same = |line: &&Line| line.class == class && line.builder == builder && line.choice == choice;
        lines.iter().filter(is_default).filter(same).collect()
    };
    let mut classes: Vec<&str> = lines.iter().map(|line| line.class).collect();
    classes.dedup();
    for class in classes {
        println!("\n{class}: mean (median) of relMSE x samples, cuts of {SIZES:?} subtrees");
        for line in lines.iter().filter(|line| line.class == class && line.builder.is_empty()) {
            println!("  {:<32}{:>8.2} ({:.2})", line.method, line.mean, line.median);
        }
        for builder in ["median", "saoh", "agglomerative", "morton", "perfect"] {
            for choice in ChildChoice::ALL {
                let row: String = of(class, builder, &format!("{choice:?}"))
                    .iter()
                    .map(|line| format!("{:>16}", format!("{:.2} ({:.2})", line.mean, line.median)))
                    .collect();
                println!("  {builder:<15}{:<17}{row}", format!("{choice:?}"));
            }
        }
        for line in lines.iter().filter(|line| line.class == class && line.builder == "saoh") {
            if line.method == "split" || line.floor != DEFAULT_FLOOR {
                println!(
                    "  saoh, {} of {} with floor {}: {:.2} ({:.2})",
                    line.method, line.nodes, line.floor, line.mean, line.median
                );
            }
        }
    }
}

fn write(lines: &[Line]) -> std::io::Result<PathBuf> {
    let target = std::env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../target")), PathBuf::from);
    let mut csv = String::from("scene,method,builder,choice,nodes,distance_floor,mean,median\n");
    let mut json = String::from("[");
    for (i, line) in lines.iter().enumerate() {
        let Line { class, builder, choice, method, nodes, floor, mean, median } = line;
        writeln!(csv, "{class},{method},{builder},{choice},{nodes},{floor},{mean},{median}")
            .expect("a string");
        let comma = if i > 0 { "," } else { "" };
        write!(
            json,
            "{comma}\n{{\"scene\": \"{class}\", \"method\": \"{method}\", \"builder\": \"{builder}\", \"choice\": \"{choice}\", \"nodes\": {nodes}, \"distance_floor\": {floor}, \"mean\": {mean}, \"median\": {median}}}"
        )
        .expect("a string");
    }
    json.push_str("\n]\n");
    std::fs::create_dir_all(&target)?;
    std::fs::write(target.join("exact-variance.json"), json)?;
    let path = target.join("exact-variance.csv");
    std::fs::write(&path, csv)?;
    Ok(path)
}

fn main() {
    // `cargo test --benches` only asks whether it runs.
    let has = |wanted: &str| std::env::args().any(|argument| argument == wanted);
    let (lights, receivers) = match (has("--bench"), has("--quick")) {
        (false, _) => (100, 4),
        (true, true) => (500, 16),
        (true, false) => (3000, 60),
    };
    let mut lines = Vec::new();
    for class in classes(lights, receivers) {
        of_class(&class, &mut lines);
    }
    print(&lines);
    let path = write(&lines).expect("the target folder can be written");
    eprintln!("\nwrote {} and .json beside it", path.display());
}
