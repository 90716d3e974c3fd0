//! The program as people and scripts call it: exit codes, error lines, JSON, files.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// Runs the program in a folder of its own.
fn xtask(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .expect("the program starts")
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A picture of few pixels (24x16 unless the options say otherwise) with the options given, whose JSON is
/// returned.
fn render(folder: &Path, arguments: &[&str]) -> Value {
    let size: &[&str] = if arguments.contains(&"--size") { &[] } else { &["--size", "24x16"] };
    let output = xtask(folder, &[&["render", "--json"], size, arguments].concat());
    assert!(output.status.success(), "{}", text(&output.stderr));
    let stdout = text(&output.stdout);
    serde_json::from_str(stdout.lines().last().expect("a line")).expect("the last line is JSON")
}

/// Asserts that a call ends with `code` and one line of error that holds all `words`; nothing may be written.
fn refuses(arguments: &[&str], code: i32, words: &[&str]) {
    let folder = folder();
    let output = xtask(folder.path(), arguments);
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {stderr}");
    let errors: Vec<_> = stderr.lines().filter(|line| line.starts_with("error: ")).collect();
    let [line] = errors[..] else { panic!("{arguments:?}: not one error line: {stderr}") };
    assert_eq!(stderr.lines().last(), Some(line), "{arguments:?}: the error is not the last line: {stderr}");
    for word in words {
        assert!(line.contains(word), "{arguments:?}: `{line}` lacks `{word}`");
    }
    assert!(!stderr.contains("panicked"), "{stderr}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "{arguments:?} left files");
    assert!(output.stdout.is_empty(), "{arguments:?} wrote to standard output");
}

/// What is in the picture; its bytes hold its settings, too.
fn pixels(path: &Path) -> Vec<glam::Vec3> {
    scene::read_exr(path, None).unwrap().pixels
}

fn keys(object: &Value) -> Vec<&str> {
    object.as_object().expect("an object").keys().map(String::as_str).collect()
}

/// The methods that a device has give the CPU's picture, from the same lights where both build the same tree.
#[test]
fn a_device_takes_the_picture_of_the_cpu() {
    let folder = folder();
    let probe = ["hall:60", "--method", "tree", "--spp", "1", "--device", "gpu", "--size", "8x8"];
    let output = xtask(folder.path(), &[&["render"], &probe[..]].concat());
    if !output.status.success() {
        let reason = text(&output.stderr);
        assert!(std::env::var_os("LIGHTTREE_REQUIRE_GPU").is_none(), "{reason}");
        assert!(reason.contains("no Vulkan adapter"), "{reason}");
        return eprintln!("SKIPPED: {reason}");
    }
    let take = |method: &str, size: &str, spp: &str, more: &[&str]| {
        let options =
            ["hall:60", "--method", method, "--set", "builder=perfect", "--spp", spp, "--size", size];
        render(folder.path(), &[&options[..], more].concat())
    };
    let error = |json: &Value| json["error"]["relmse"].as_f64().expect("an error");
    let on_device = ["-o", "gpu.exr", "--device", "gpu", "--reference", "cpu.exr"];

    // Walks draw the same lights; another seed draws others.
    take("tree", "48x32", "4", &["-o", "cpu.exr"]);
    let json = take("tree", "48x32", "4", &on_device);
    assert_eq!(json["device"], "gpu");
    assert!(json["stages"].as_object().is_some_and(|stages| stages.len() > 4), "{json}");
    assert!(error(&json) < 1e-3, "{json}");
    let other = take("tree", "48x32", "4", &[&on_device[..], &["--seed", "2"]].concat());
    assert!(error(&other) > 1e-2, "{other}");

    // Cuts are made from other random numbers: the same picture but for noise.
    for method in ["cut", "shared-cut"] {
        take(method, "24x16", "64", &["-o", "cpu.exr"]);
        let json = take(method, "24x16", "64", &on_device);
        assert!(error(&json) < 0.15, "{method}: {json}");
    }

    // So are distributions. Their error is the CPU's own; the control is what draws worse.
    let small = ["hall:60", "--size", "24x16"];
    render(folder.path(), &[&small[..], &["--method", "brute", "--spp", "16", "-o", "truth.exr"]].concat());
    let noise = |method: &str, more: &[&str]| {
        let options = ["--method", method, "--spp", "8", "--seed", "5", "--reference", "truth.exr"];
        error(&render(folder.path(), &[&small[..], &options, more].concat()))
    };
    let uniform = noise("uniform", &[]);
    for method in ["cut-cdf", "cut-cdf-vis"] {
        let cpu = noise(method, &["--set", "nodes=64", "--set", "builder=perfect"]);
        let gpu = noise(method, &["--set", "nodes=64", "--device", "gpu"]);
        assert!(gpu < 1.5 * cpu + 1e-3 && cpu < 1.5 * gpu + 1e-3, "{method}: {gpu}, and {cpu} on the cpu");
        assert!(uniform > 3.0 * cpu, "{method}: {cpu}, and {uniform} for lights drawn evenly");
    }

    // Two frames of a scene that moves, with what was learned kept and with filters: those of the CPU.
    let film = ["sun:200", "--method", "tree", "--set", "builder=perfect", "--spp", "1", "--frames", "2"];
    let film = |more: &[&str]| render(folder.path(), &[&film[..], &["--size", "48x32"], more].concat());
    let filtered = ["--set", "filter=svgf+taa"];
    film(&[&filtered[..], &["-o", "cpu.exr"]].concat());
    let on_device = ["-o", "gpu.exr", "--device", "gpu", "--reference", "cpu.0001.exr"];
    let json = film(&[&filtered[..], &on_device].concat());
    assert_eq!(json["frames"].as_array().map(Vec::len), Some(2), "{json}");
    let last = |json: &Value| json["frames"][1]["error"]["relmse"].as_f64().expect("an error");
    assert!(last(&json) < 1e-4, "{json}");
    assert!(json["filter"]["pixels"]["with_history"].as_u64() > Some(100), "{json}");
    let less = film(&[&filtered[..], &["--set", "filter_levels=4"], &on_device].concat());
    assert!(last(&less) > 1e-3, "{less}");
    let learning = ["sun:200", "--method", "cut-cdf-vis", "--set", "nodes=64", "--spp", "1", "--frames", "3"];
    let json = render(folder.path(), &[&learning[..], &["--device", "gpu"]].concat());
    assert_eq!(json["frames"].as_array().map(Vec::len), Some(3), "{json}");
    assert!(json["stages"]["learn"].as_f64() > Some(0.0), "{json}");

    // Bodies that turn, each with the tree of its mesh: the CPU's second frame and not its first, with as
    // much noise as the CPU has with another seed.
    let bodies = ["cornell-lights:300", "--set", "builder=two-level", "--spp", "32", "--frames", "2"];
    let film = |method: &str, more: &[&str]| {
        let method = ["--size", "24x16", "--method", method];
        render(folder.path(), &[&bodies[..], &method, more].concat())
    };
    film("tree", &["-o", "cpu.exr"]);
    for method in ["tree", "cut", "shared-cut"] {
        let json = film(method, &on_device);
        let first = json["frames"][0]["error"]["relmse"].as_f64().expect("an error");
        let noise = last(&film(method, &["--seed", "3", "--reference", "cpu.0001.exr"]));
        assert!(last(&json) < 1.4 * noise && first > 1.3 * last(&json), "{method}: {noise} and {json}");
    }
}

#[test]
fn json_has_every_key_that_scripts_read() {
    let folder = folder();
    let json = render(folder.path(), &["hall:50", "--method", "lightcut", "--spp", "1"]);
    assert_eq!(
        keys(&json),
        [
            "method",
            "device",
            "scene",
            "triangles",
            "lights",
            "vpls",
            "width",
            "height",
            "spp",
            "seed",
            "threads",
            "seconds",
            "counts",
            "bytes",
            "output",
            "settings",
            "gi",
            "bounces",
            "camera",
            "exposure",
            "made_by"
        ]
    );
    assert_eq!(keys(&json["seconds"]), ["load", "build_rays", "build_lights", "render", "total"]);
    assert_eq!(
        keys(&json["counts"]),
        [
            "shadow_rays",
            "closest_hit_rays",
            "light_evaluations",
            "node_visits",
            "cut_nodes_mean",
            "cut_nodes_max",
            "fallbacks",
            "clamped",
            "non_finite"
        ]
    );
    assert_eq!(keys(&json["bytes"]), ["light_tree", "rays", "peak_rss"]);
    assert_eq!(
        (&json["method"], &json["device"], &json["scene"]),
        (&"lightcut".into(), &"cpu".into(), &"hall:50".into())
    );
    assert_eq!(
        (json["width"].as_u64(), json["height"].as_u64(), json["lights"].as_u64()),
        (Some(24), Some(16), Some(50))
    );
    assert!(json["counts"]["cut_nodes_mean"].as_f64().unwrap() >= 1.0);
    assert!(json["counts"]["closest_hit_rays"].as_u64().unwrap() >= 24 * 16);
    assert_eq!(json["counts"]["non_finite"], 0);
    assert!(json["bytes"]["peak_rss"].as_u64().is_none_or(|bytes| bytes > 1 << 20));
    assert!(json["seconds"]["total"].as_f64().unwrap() >= json["seconds"]["render"].as_f64().unwrap());
    assert!(folder.path().join("render.exr").is_file() && folder.path().join("render.png").is_file());

    // The picture says itself what it is.
    let bytes = std::fs::read(folder.path().join("render.exr")).unwrap();
    let about = String::from_utf8_lossy(&bytes[..2000.min(bytes.len())]);
    assert!(about.contains("\"method\":\"lightcut\"") && about.contains("\"threshold\":\"0.02\""), "{about}");
}

#[test]
fn an_error_is_taken_against_a_reference() {
    let folder = folder();
    // The same seed and samples per pixel: the same points to be lit, so that only the lights differ.
    let render = |method: &str, more: &[&str]| {
        render(folder.path(), &[&["hall:50", "--method", method, "--spp", "4"], more].concat())
    };
    render("brute", &["-o", "truth.exr"]);
    let json = render("lightcut", &["--reference", "truth.exr"]);
    assert_eq!(keys(&json["error"]), ["mse", "relmse", "mape", "ssim", "flip", "bias"]);
    let near = json["error"]["relmse"].as_f64().unwrap();
    let json = render("lightcut", &["--set", "max_nodes=1", "--reference", "truth.exr"]);
    let far = json["error"]["relmse"].as_f64().unwrap();
    assert!(near < 1e-3 && far > 1e-2, "lightcut {near}, one node {far}");
    let json = render("brute", &["--reference", "truth.exr"]);
    assert_eq!(json["error"]["mse"], 0.0);
}

#[test]
fn every_method_draws_the_same_scene() {
    let folder = folder();
    let spp = "256";
    render(folder.path(), &["hall:50", "--method", "brute", "--spp", spp, "-o", "truth.exr"]);
    for (method, most) in [
        ("uniform", 0.15),
        ("power", 0.15),
        ("tree", 0.1),
        ("lightcut", 1e-3),
        ("path", 0.1),
        ("ris", 0.1),
        ("cut-cdf", 0.1),
        ("cut-cdf-vis", 0.1),
    ] {
        let json = render(
            folder.path(),
            &["hall:50", "--method", method, "--gi", "none", "--spp", spp, "--reference", "truth.exr"],
        );
        let error = json["error"]["relmse"].as_f64().unwrap();
        assert!(error < most, "{method}: relMSE {error}");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_for_any_threads() {
    let folder = folder();
    let picture = |threads: &str, method: &str, seed: &str, name: &str| {
        let arguments = ["hall:100", "--method", method, "--gi", "vpl", "--vpls", "200", "--spp", "2"];
        render(
            folder.path(),
            &[&arguments[..], &["--threads", threads, "--seed", seed, "-o", name]].concat(),
        );
        std::fs::read(folder.path().join(name)).unwrap()
    };
    let pixels = |name: &str| pixels(&folder.path().join(name));
    for method in ["tree", "lightcut", "ris", "cut-cdf-vis"] {
        assert_eq!(picture("1", method, "7", "one.exr"), picture("2", method, "7", "two.exr"), "{method}");
        picture("2", method, "8", "other.exr");
        assert_ne!(pixels("one.exr"), pixels("other.exr"), "{method}: the seed changes nothing");
    }
}

/// Frames are files of their own and entries of the report; the first one is the picture without the option.
#[test]
fn frames_are_written_one_by_one() {
    let folder = folder();
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let pixels = |name: &str| pixels(&folder.path().join(name));
    for scene in ["cornell-lights:200", "sun:500", "hall:50"] {
        let one = render(folder.path(), &[scene, "--method", "tree", "--spp", "2", "-o", "one.exr"]);
        assert!(one.get("frames").is_none(), "one picture is reported as ever");
        let arguments = [scene, "--method", "tree", "--spp", "2", "--frames", "3", "-o", "film.exr"];
        let json = render(folder.path(), &arguments);
        let frames = json["frames"].as_array().unwrap();
        assert_eq!((frames.len(), json["output"].as_str()), (3, Some("film.exr")));
        assert_eq!(keys(&frames[1]), ["frame", "seed", "seconds", "change", "output"]);
        assert_eq!(keys(&frames[1]["seconds"]), ["move", "build_rays", "build_lights", "render", "total"]);
        let names = ["film.0000.exr", "film.0001.exr", "film.0002.exr"];
        for (frame, name) in frames.iter().zip(names) {
            assert_eq!(frame["output"], name);
            assert!(folder.path().join(name).with_extension("png").is_file());
        }
        assert!(frames[0]["change"].is_null() && frames[1]["change"].as_f64().unwrap() > 0.0);
        let sum: u64 = json["counts"]["closest_hit_rays"].as_u64().unwrap();
        assert!(sum >= 3 * 2 * 24 * 16, "counts are those of all frames");
        assert_eq!(read("one.exr"), read("film.0000.exr"), "{scene}");
        assert_ne!(pixels("film.0001.exr"), pixels("film.0002.exr"), "{scene}");

        // The same bits again, on another number of threads.
        let again = [&arguments[..7], &["-o", "again.exr", "--threads", "1"]].concat();
        render(folder.path(), &again);
        for frame in ["0000", "0001", "0002"] {
            assert_eq!(read(&format!("film.{frame}.exr")), read(&format!("again.{frame}.exr")), "{scene}");
        }
    }
}

/// Two levels of trees draw the same picture as one, for walks in mesh space and for cuts in world space.
#[test]
fn two_levels_draw_the_same_picture() {
    let folder = folder();
    let scene = ["cornell-lights:120", "--spp", "64"];
    render(folder.path(), &[&scene[..], &["--method", "brute", "-o", "truth.exr"]].concat());
    for (method, most) in [("tree", 0.02), ("lightcut", 0.002)] {
        let error = |builder: &str| {
            let method = ["--method", method, "--set", builder, "--reference", "truth.exr"];
            render(folder.path(), &[&scene[..], &method].concat())["error"]["relmse"].as_f64().unwrap()
        };
        let (one, two) = (error("builder=saoh"), error("builder=two-level"));
        assert!(two < most && two < 2.0 * one + 1e-4, "{method}: {two} in two levels, {one} in one");
    }
}

#[test]
fn a_camera_goes_round() {
    let folder = folder();
    let read = |name: &str| pixels(&folder.path().join(name));
    let arguments = ["hall:50", "--method", "brute", "--frames", "2", "-o"];
    render(folder.path(), &[&arguments[..], &["still.exr"]].concat());
    render(folder.path(), &[&arguments[..], &["orbit.exr", "--set", "orbit=20"]].concat());
    assert_eq!(read("still.0000.exr"), read("orbit.0000.exr"));
    assert_ne!(read("still.0001.exr"), read("orbit.0001.exr"));
}

#[test]
fn pixels_renders_only_so_many() {
    let folder = folder();
    let json = render(folder.path(), &["hall:50", "--method", "brute", "--pixels", "10", "--spp", "1"]);
    let camera_rays = json["counts"]["closest_hit_rays"].as_u64().unwrap();
    assert!((10..200).contains(&camera_rays), "{camera_rays} camera rays for 10 pixels");

    // The error is that of those pixels alone: the rest is black, and would weigh if it counted.
    render(folder.path(), &["hall:50", "--method", "brute", "-o", "truth.exr"]);
    let json = render(
        folder.path(),
        &["hall:50", "--method", "brute", "--pixels", "10", "--reference", "truth.exr", "-o", "few.exr"],
    );
    assert!(json["error"]["relmse"].as_f64().unwrap() < 1e-6);
    assert_eq!((&json["error"]["ssim"], &json["error"]["flip"]), (&Value::Null, &Value::Null));
}

#[test]
fn bad_calls_exit_with_2_and_say_what_to_write() {
    refuses(&["render", "--method", "nonsense"], 2, &["nonsense", "is unknown", "lightcut"]);
    refuses(&["render", "--method", "lightcutt"], 2, &["did you mean `lightcut`?"]);
    refuses(&["render", "hal:10"], 2, &["did you mean hall?"]);
    refuses(&["render", "--size", "65536x65536"], 2, &["4294967296 pixels", "memory"]);
    refuses(&["compare", "--methods", "tree,tree", "-o", "out"], 2, &["tree", "twice"]);
    refuses(
        &["render", "--method", "tree", "--set", "threshold=1"],
        2,
        &["tree", "threshold", "lights, choice, builder"],
    );
    refuses(&["render", "--set", "threshold=abc"], 2, &["threshold", "from 0 to 1"]);
    refuses(&["render", "--set", "threshold"], 2, &["KEY=VALUE"]);
    refuses(&["render", "--set", "materials=gold"], 2, &["materials", "gltf"]);
    refuses(&["render", "palace"], 2, &["palace", "hall"]);
    refuses(&["render", "hall:0"], 2, &["hall", "0"]);
    refuses(&["render", "hall:10", "--set", "camera=roof"], 2, &["roof", "no such camera"]);
    refuses(&["render", "--size", "24"], 2, &["--size", "WIDTHxHEIGHT"]);
    refuses(&["render", "--spp", "0"], 2, &["--spp"]);
    refuses(&["render", "--frames", "0"], 2, &["--frames"]);
    let on_device = |arguments: &[&str], words: &[&str]| {
        refuses(&[&["render", "--device", "gpu"], arguments].concat(), 2, words);
    };
    on_device(&[], &["gpu", "lightcut", "shared-cut"]);
    on_device(&["--method", "tree", "--pixels", "9"], &["gpu", "--pixels"]);
    on_device(&["--method", "tree", "--set", "builder=median"], &["gpu", "median", "perfect"]);
    on_device(&["--method", "cut-cdf", "--set", "builder=two-level"], &["gpu", "one level", "shared-cut"]);
    on_device(&["--method", "cut", "--set", "lights=64"], &["gpu", "64", "32"]);
    on_device(&["--method", "cut-cdf", "--set", "nodes=600"], &["gpu", "600", "512"]);
    refuses(&["render", "-o", "picture.jpg"], 2, &["picture.jpg", ".exr"]);
    refuses(&["render", "-o", "nowhere/picture.exr"], 2, &["nowhere", "make it first"]);
    refuses(&["render", "--nonsense"], 2, &["--nonsense", "--help"]);
    refuses(&["nonsense"], 2, &["nonsense", "--help"]);
    refuses(&["compare", "hall:10"], 2, &["--output", "--help"]);
    refuses(&["compare", "hall:10", "--methods", "tree,nonsense", "-o", "out"], 2, &["nonsense"]);
    refuses(
        &["compare", "hall:10", "--methods", "tree", "--set", "threshold=1", "-o", "out"],
        2,
        &["threshold"],
    );
    refuses(&["inspect"], 2, &["<SCENE>"]);
}

#[test]
fn work_that_fails_exits_with_1_and_names_the_file() {
    refuses(&["render", "missing.glb"], 1, &["missing.glb"]);
    refuses(&["inspect", "missing.gltf"], 1, &["missing.gltf"]);
    for command in ["compare", "bake"] {
        refuses(&[command, "cornell", "-o", "/dev/null/maps"], 1, &["/dev/null is a file, not a folder"]);
    }
    refuses(&["render", "hall:10", "--reference", "missing.exr"], 1, &["missing.exr"]);

    let folder = folder();
    let broken = folder.path().join("broken.glb");
    std::fs::write(&broken, b"glTF\x02\0\0\0\xff\xff").unwrap();
    refuses(&["render", broken.to_str().unwrap()], 1, &["broken.glb"]);
    render(folder.path(), &["cornell", "--size", "8x8", "--spp", "1", "-o", "small.exr"]);
    let small = folder.path().join("small.exr");
    refuses(
        &["render", "cornell", "--reference", small.to_str().unwrap()],
        1,
        &["small.exr", "8x8", "--size"],
    );
}

#[test]
fn nothing_half_written_is_left() {
    let folder = folder();
    let old = folder.path().join("render.exr");
    std::fs::write(&old, "what was there").unwrap();
    let broken = folder.path().join("broken.glb");
    std::fs::write(&broken, "no").unwrap();
    let output = xtask(folder.path(), &["render", "broken.glb"]);
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(std::fs::read(&old).unwrap(), b"what was there");

    render(folder.path(), &["cornell", "--method", "brute"]);
    let mut names: Vec<_> =
        std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["broken.glb", "render.exr", "render.png"]);
}

/// Ctrl-C while a picture is under way: what is finished is written, and the exit code says that it is not
/// all.
#[cfg(unix)]
#[test]
fn an_interrupt_writes_what_is_finished() {
    let folder = folder();
    let arguments = ["render", "hall:2000", "--method", "brute", "--size", "32x32", "--threads", "1"];
    let mut child = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(arguments)
        .args(["--frames", "1000"])
        .current_dir(folder.path())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    // Once a frame is written, the next one is under way.
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(|line| line.unwrap());
    let written = lines.find(|line| line.contains("render.0000.exr")).unwrap();
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    let last = lines.last().unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{written}, {last}");
    let line = last.strip_prefix("error: ").unwrap();
    let (cut_short, _) = line.split_once(": cut short").unwrap();
    assert_ne!(cut_short, "render.0000.exr", "the one that was finished before");
    for name in ["render.0000.exr", cut_short] {
        let path = folder.path().join(name);
        assert!(path.is_file() && path.with_extension("png").is_file(), "{name}");
    }
}

/// `| head` closes the pipe before all is said.
#[cfg(unix)]
#[test]
fn a_reader_that_has_had_enough_is_no_failure() {
    let program = env!("CARGO_BIN_EXE_xtask");
    let piped = |rest: &str| {
        let line = format!("'{program}' render --help-methods {rest}");
        let output = Command::new("sh").args(["-c", &line]).output().unwrap();
        (text(&output.stdout), text(&output.stderr))
    };
    assert_eq!(piped("| true"), (String::new(), String::new()));
    let (_, full) = piped("> /dev/full");
    assert!(
        full.starts_with("error: standard output cannot be written") || !cfg!(target_os = "linux"),
        "{full}"
    );
}

#[test]
fn a_black_picture_says_why() {
    let folder = folder();
    std::fs::write(folder.path().join("empty.gltf"), r#"{"asset": {"version": "2.0"}}"#).unwrap();
    let output = xtask(folder.path(), &["render", "empty.gltf", "--size", "8x8"]);
    assert!(output.status.success());
    assert!(text(&output.stderr).contains("the picture is black: empty.gltf has no triangles"));
}

#[test]
fn compare_makes_its_files() {
    let folder = folder();
    let output = xtask(
        folder.path(),
        &[
            "compare",
            "hall:50",
            "--size",
            "24x16",
            "--methods",
            "tree,lightcut",
            "--seconds-per-method",
            "0.2",
            "--reference-seconds",
            "0.5",
            "-o",
            "out",
        ],
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
    let files = [
        "index.html",
        "data.json",
        "data.csv",
        "reference.exr",
        "reference.png",
        "tree.exr",
        "tree.png",
        "lightcut.png",
    ];
    for file in files {
        assert!(folder.path().join("out").join(file).is_file(), "{file}");
    }
    let read = |name: &str| std::fs::read_to_string(folder.path().join("out").join(name)).unwrap();
    let data: Value = serde_json::from_str(&read("data.json")).unwrap();
    assert_eq!(data["methods"].as_array().unwrap().len(), 2);
    assert!(data["reference"]["made"]["noise"]["relmse"].is_number());
    assert_eq!(read("data.csv").lines().count(), 3);
    // What is needed to make it again, and to judge it.
    assert_eq!((&data["seed"], &data["lights"]), (&1.into(), &50.into()));
    assert_eq!(data["methods"][1]["settings"]["threshold"], "0.02");
    assert!(data["units"]["mse"].is_string() && data["made_by"]["machine"]["os"].is_string(), "{data}");
    let command = data["made_by"]["command"].as_str().unwrap();
    assert!(command.starts_with("cargo xtask compare hall:50 --size 24x16"), "{command}");
    let table = text(&output.stdout);
    assert!(table.contains("tree") && table.contains("lightcut") && table.contains("relMSE"));
}

#[test]
fn inspect_counts_what_is_there() {
    let folder = folder();
    let output = xtask(folder.path(), &["inspect", "hall:50", "--json"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let json: Value = serde_json::from_str(text(&output.stdout).lines().last().unwrap()).unwrap();
    assert_eq!(json["lights"]["total"], 50);
    assert!(json["triangles"].as_u64().unwrap() > 100);
    assert!(json["trees"].as_array().unwrap().len() >= 4);
    assert!(xtask(folder.path(), &["inspect", "cornell"]).status.success());
}

#[test]
fn help_is_there_for_people() {
    let folder = folder();
    for arguments in [&["--help"][..], &["render", "--help"], &["render", "--help-methods"]] {
        let output = xtask(folder.path(), arguments);
        assert!(output.status.success() && text(&output.stdout).lines().count() > 5, "{arguments:?}");
    }
}

/// Real scenes lie outside the project; without them this test says that it skips.
#[test]
fn a_real_file_renders() {
    let scenes = std::env::var_os("LIGHTTREE_SCENES")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/scenes"), PathBuf::from);
    let file = scenes.join("cornell-box.glb");
    if !file.is_file() {
        eprintln!("skipped: no {}", file.display());
        return;
    }
    let folder = folder();
    let json = render(folder.path(), &[file.to_str().unwrap(), "--method", "path", "--spp", "2"]);
    assert_eq!((json["triangles"].as_u64(), json["lights"].as_u64()), (Some(38), Some(2)));
}
