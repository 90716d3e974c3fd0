//! `cargo xtask bake` as scripts call it: files, resuming after a kill, refusals.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use serde_json::Value;

/// A small bake of the Cornell box, and few seconds.
const SMALL: [&str; 9] =
    ["bake", "cornell", "--texels-per-unit", "12", "--set", "clusters=12", "--set", "paths=3000", "--json"];

fn xtask(folder: &Path, arguments: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_xtask")).args(arguments).current_dir(folder).output();
    output.expect("the program starts")
}

fn bake(folder: &Path, more: &[&str]) -> Value {
    let output = xtask(folder, &[&SMALL, more].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    serde_json::from_str(text.lines().last().expect("a line")).unwrap()
}

/// Asserts that a call fails with one line of error that holds `words`.
fn refuses(folder: &Path, arguments: &[&str], words: &[&str]) {
    let output = xtask(folder, arguments);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success(), "{arguments:?}");
    let errors: Vec<_> = stderr.lines().filter(|line| line.starts_with("error: ")).collect();
    let [line] = errors[..] else { panic!("{arguments:?}: not one error line: {stderr}") };
    for word in words {
        assert!(line.contains(word), "{arguments:?}: `{line}` lacks `{word}`");
    }
    assert!(!stderr.contains("panicked") && output.stdout.is_empty(), "{stderr}");
}

/// The short block moves, the red wall turns blue, the lamp dims; all of it back again.
const THERE: &str = r#"{"op": "recolour", "material": "red", "colour": [0.1, 0.1, 0.7]},
    {"op": "set_light", "light": 0, "times": 0.5},
    {"op": "add_light", "position": [0.2, 0.3, 0.1], "flux": [0.3, 0.4, 0.5]},
    {"op": "remove_object", "object": 2}, {"op": "move_object", "object": 1, "by": [0, 0.05, 0]}"#;
const BACK: &str = r#"{"op": "move_object", "object": 1, "by": [0, -0.05, 0]}, {"op": "restore_object", "object": 2},
    {"op": "recolour", "material": "red", "colour": [0.63, 0.065, 0.05]},
    {"op": "set_light", "light": 0, "times": 2}, {"op": "remove_light", "light": 1}"#;

fn write_edits(folder: &Path, list: &str) {
    std::fs::write(folder.join("edits.json"), format!(r#"{{"edits": [{list}]}}"#)).unwrap();
}

#[test]
fn a_bake_writes_what_engines_read() {
    let folder = tempfile::tempdir().unwrap();
    let json =
        bake(folder.path(), &["-o", "out", "--set", "view=1", "--size", "24x24", "--set", "format=f16"]);
    let texels = json["texels"].as_u64().unwrap();
    assert!(texels > 300 && json["virtual_lights"].as_u64().unwrap() > 5, "{json}");
    for count in ["cut_off", "non_finite", "wrapped", "overlapping", "outside", "unsound_hits", "saturated"] {
        assert_eq!(json["counts"][count], 0, "{count}");
    }
    let out = folder.path().join("out");
    let sidecar: Value = serde_json::from_slice(&std::fs::read(out.join("lightmap.json")).unwrap()).unwrap();
    assert!(sidecar["exposure"].as_f64().unwrap() > 0.0);
    let objects = sidecar["objects"].as_array().unwrap();
    assert_eq!(objects.len() as u64, json["objects"].as_u64().unwrap());
    for object in objects {
        assert_eq!(object["lightmap"]["map"], "lightmap.exr");
        let rect: Vec<f64> =
            object["lightmap"]["uv_rect"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
        assert!(
            rect[0] < rect[2] && rect[1] < rect[3] && rect.iter().all(|x| (0.0..=1.0).contains(x)),
            "{rect:?}"
        );
    }
    let map = scene::read_exr(&out.join("lightmap.exr"), None).unwrap();
    assert_eq!(
        (u64::from(map.width), u64::from(map.height)),
        (json["size"][0].as_u64().unwrap(), json["size"][1].as_u64().unwrap())
    );
    assert!(map.pixels.iter().all(|p| p.min_element() >= 0.0) && map.pixels.iter().any(|p| p.x > 0.0));
    let view = scene::read_exr(&out.join("view.exr"), Some((24, 24))).unwrap();
    assert!(view.pixels.iter().all(|p| p.is_finite()) && scene::luminance(view.pixels[12 * 24 + 12]) > 0.0);
    let scene = scene::load(&out.join("scene.glb"), &scene::ImportOptions::default()).unwrap();
    assert_eq!(scene.triangle_count() as u64, json["triangles"].as_u64().unwrap());
    assert!(scene.meshes.iter().all(|mesh| mesh.uvs1.len() == mesh.positions.len()));

    // The coordinates just written are kept on request, one map for each object.
    let again = xtask(
        folder.path(),
        &[
            "bake",
            "out/scene.glb",
            "--texels-per-unit",
            "12",
            "--set",
            "clusters=4",
            "--set",
            "paths=500",
            "--set",
            "charts=keep",
            "--set",
            "maps=objects",
            "--set",
            "directional=1",
            "-o",
            "kept",
        ],
    );
    assert!(again.status.success(), "{}", String::from_utf8_lossy(&again.stderr));
    let kept = scene::load(&folder.path().join("kept/scene.glb"), &scene::ImportOptions::default()).unwrap();
    for (a, b) in kept.meshes.iter().zip(&scene.meshes) {
        assert_eq!(a.uvs1, b.uvs1);
    }
    assert!(folder.path().join("kept/object.0.sh1x.exr").exists());
}

/// Edits and their opposites leave every bit as it was, and so does another number of threads; an edit alone
/// does not.
#[test]
fn undone_edits_leave_no_trace() {
    let folder = tempfile::tempdir().unwrap();
    let plain = bake(folder.path(), &["-o", "plain"])["sums"].clone();
    write_edits(folder.path(), THERE);
    let there = bake(folder.path(), &["-o", "there", "--edits", "edits.json"]);
    assert_ne!(there["sums"], plain);
    write_edits(folder.path(), &format!("{THERE}, {{\"op\": \"bake\", \"updates\": 5}}, {BACK}"));
    let back = bake(folder.path(), &["-o", "back", "--edits", "edits.json", "--threads", "1"]);
    assert_eq!(back["sums"], plain);
    // Saved edits are taken up, and further ones done.
    let resumed =
        bake(folder.path(), &["-o", "there", "--edits", "edits.json", "--resume", "there/bake.state"]);
    assert_eq!(resumed["sums"], plain);
}

/// Killed at 20 moments and resumed each time, a bake ends with the same bits.
#[test]
fn kills_leave_no_trace() {
    let folder = tempfile::tempdir().unwrap();
    write_edits(
        folder.path(),
        &format!(
            "{THERE}, {{\"op\": \"bake\"}}, {{\"op\": \"move_light\", \"light\": 1, \"by\": [0.1, 0, 0]}}"
        ),
    );
    let common = ["--edits", "edits.json", "--set", "save=0"];
    let whole = bake(folder.path(), &[&common[..], &["-o", "whole"]].concat());
    let state = folder.path().join("killed/bake.state");
    let mut resumed = 0;
    for kill in 0..20u64 {
        let before = std::fs::read(&state).ok();
        let resume: &[&str] = if before.is_some() { &["--resume", "killed/bake.state"] } else { &[] };
        resumed += u32::from(before.is_some());
        let mut child = Command::new(env!("CARGO_BIN_EXE_xtask"))
            .args([&SMALL[..], &common, &["-o", "killed"], resume].concat())
            .current_dir(folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // Some while it begins, the others somewhere after it saved anew, often while it saves again.
        if kill % 4 != 0 {
            while child.try_wait().unwrap().is_none() && std::fs::read(&state).ok() == before {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        std::thread::sleep(Duration::from_micros(kill.wrapping_mul(7_919_003) % 40_000));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    let resume: &[&str] = if state.exists() { &["--resume", "killed/bake.state"] } else { &[] };
    let last = bake(folder.path(), &[&common[..], &["-o", "killed"], resume].concat());
    assert!(resumed >= 15, "{resumed} of the kills were after a save");
    assert_eq!(last["sums"], whole["sums"]);
}

#[test]
fn what_is_wrong_is_named_in_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let f = folder.path();
    let call = |more: &[&'static str]| [&SMALL[..], &["-o", "out"], more].concat();
    // Edit lists.
    for (text, word) in [
        ("", "no JSON"),
        ("[]", "{\"edits\": [...]}"),
        (r#"{"edits": [7]}"#, "edits[0]: an edit is an object"),
        (r#"{"edits": [{}]}"#, "has no \"op\""),
        (r#"{"edits": [{"op": "bake"}, {"op": "paint"}]}"#, "edits[1]: there is no \"op\" \"paint\""),
        (r#"{"edits": [{"op": "move_object", "by": [1, 2, 3]}]}"#, "\"object\" is missing"),
        (r#"{"edits": [{"op": "move_object", "object": 99}]}"#, "none of the"),
        (r#"{"edits": [{"op": "move_object", "object": -1}]}"#, "none of the"),
        (r#"{"edits": [{"op": "move_object", "object": 0, "by": [1, 2]}]}"#, "\"by\" is no [x, y, z]"),
        (r#"{"edits": [{"op": "move_object", "object": 0, "by": [1, 2, 1e99]}]}"#, "\"by\" is no number"),
        (r#"{"edits": [{"op": "move_object", "object": 0, "too": [1, 2, 3]}]}"#, "has no \"too\""),
        (r#"{"edits": [{"op": "recolour", "material": "gold", "colour": [1, 1, 0]}]}"#, "is on no object"),
        (r#"{"edits": [{"op": "recolour", "object": 0, "colour": [2, 1, 0]}]}"#, "lies in [0, 1]"),
        (r#"{"edits": [{"op": "set_light", "light": 0}]}"#, "either \"times\" or \"flux\""),
        (r#"{"edits": [{"op": "set_light", "light": 0, "times": -1}]}"#, "cannot be negative"),
        (r#"{"edits": [{"op": "set_light", "light": 1, "times": 1}]}"#, "none of the 1 lights"),
        (
            r#"{"edits": [{"op": "add_light", "position": [0, 0, 0], "flux": [1, 1, 1], "radius": 0}]}"#,
            "\"radius\" 0",
        ),
        (
            r#"{"edits": [{"op": "add_light", "position": [0, 0, 0], "flux": [1, 1, 1], "file": "lamp.txt"}]}"#,
            "lamp.txt",
        ),
        (
            r#"{"edits": [{"op": "profile", "light": 0, "file": "broken.ies"}]}"#,
            "broken.ies: there is no TILT= line",
        ),
        (r#"{"edits": [{"op": "bake", "updates": 1.5}]}"#, "is no whole number"),
    ] {
        std::fs::write(f.join("broken.ies"), "IESNA").unwrap();
        std::fs::write(f.join("lamp.txt"), "").unwrap();
        std::fs::write(f.join("edits.json"), text).unwrap();
        refuses(f, &call(&["--edits", "edits.json"]), &["edits.json", word]);
    }
    assert!(!f.join("out").exists(), "nothing was written");
    // Saved bakes.
    std::fs::write(f.join("nonsense"), "nonsense").unwrap();
    refuses(f, &call(&["--resume", "nonsense"]), &["nonsense", "no saved bake"]);
    refuses(f, &call(&["--resume", "none"]), &["none"]);
    bake(f, &["-o", "done"]);
    refuses(f, &call(&["--resume", "done/bake.state", "--set", "samples=2"]), &["other texels"]);
    let dials = [
        "bake",
        "hall:20",
        "-o",
        "out",
        "--set",
        "clusters=2",
        "--set",
        "paths=100",
        "--texels-per-unit",
        "0.5",
    ];
    refuses(f, &[&dials[..], &["--resume", "done/bake.state"]].concat(), &["another scene"]);
    let mut bytes = std::fs::read(f.join("done/bake.state")).unwrap();
    bytes[6] = 9;
    std::fs::write(f.join("done/bake.state"), &bytes).unwrap();
    refuses(f, &call(&["--resume", "done/bake.state"]), &["format 9"]);
    // Calls.
    refuses(f, &call(&["--set", "samples=17"]), &["samples"]);
    refuses(f, &["bake", "cornell", "-o", "out", "--texels-per-unit", "1e6"], &["texels per unit or fewer"]);
    refuses(f, &["bake", "cornell", "-o", "out", "--texels-per-unit", "-1"], &["positive"]);
    refuses(f, &["bake", "cornell"], &["--output"]);
}

/// The Cornell box lit by its maps has the light of the path tracer's picture, the same bounces on both
/// sides.
#[test]
fn a_view_has_the_light_of_path_tracing() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let output = xtask(folder.path(), arguments);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    let dials = ["--set", "clusters=120", "--set", "paths=20000", "--set", "bounces=5", "--set", "samples=2"];
    let look = ["--set", "view=1", "--set", "spp=16", "--size", "48x48", "-o", "baked"];
    run(&[&["bake", "cornell", "--texels-per-unit", "32"], &dials[..], &look].concat());
    let path = ["render", "cornell", "--method", "path", "--bounces", "5", "--spp", "64", "--size", "48x48"];
    run(&[&path[..], &["--set", "materials=diffuse", "-o", "path.exr"]].concat());
    let read = |name: &str| scene::read_exr(&folder.path().join(name), Some((48, 48))).unwrap().pixels;
    let (baked, path) = (read("baked/view.exr"), read("path.exr"));
    // All but the lamp, whose border the few camera samples of either would decide.
    let dark = |i: &usize| baked[*i].max(path[*i]).max_element() < 0.7;
    let surfaces: Vec<usize> = (0..path.len()).filter(dark).collect();
    assert!(surfaces.len() > path.len() * 9 / 10);
    let mean = |pixels: &[glam::Vec3]| surfaces.iter().map(|&i| pixels[i].as_dvec3()).sum::<glam::DVec3>();
    let ratio = mean(&baked) / mean(&path);
    assert!((ratio - 1.0).abs().max_element() < 0.02, "{ratio}");
}
