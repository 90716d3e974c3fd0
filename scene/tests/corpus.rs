//! Broken files: each gives an error of one line that names the file, in bounded time, never a panic; and
//! real bytes mutated some thousand times never panic or hang either.

mod glb;
mod sound;

use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use glam::Vec3;
use lighttree::rng::Random;
use scene::{ImportError, ImportLimits, ImportOptions, Light, Scene, load};

use glb::{Asset, Folder, glb, jpeg, png, textured_triangle};

/// The longest that one small file may take, on a busy machine.
const PATIENCE: Duration = Duration::from_secs(5);

/// A textured, lit, emissive triangle under two nodes: something to break in many places.
fn base() -> Asset {
    let material = r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}},"emissiveFactor":[1,1,1]}"#;
    let mut asset = textured_triangle(material, 2, &[[10, 20, 30, 255]; 4]);
    asset.set("nodes", r#"[{"children":[1]},{"mesh":0,"extensions":{"KHR_lights_punctual":{"light":1}}}]"#);
    asset.set(
        "extensions",
        r#"{"KHR_lights_punctual":{"lights":[{"type":"point","intensity":1},{"type":"point","name":"lamp","intensity":2}]}}"#,
    );
    asset
}

/// `base()` with the first occurrence of `from` in its JSON replaced.
fn edited(from: &str, to: &str) -> Vec<u8> {
    let asset = base();
    let json = asset.json();
    assert!(json.contains(from), "{from} is not in {json}");
    glb(&json.replacen(from, to, 1), &asset.bin)
}

/// `base()` with `bytes` for its image.
fn with_image(bytes: &[u8]) -> Vec<u8> {
    let mut asset = base();
    let view = asset.view(bytes, "");
    asset.set("images", format!(r#"[{{"bufferView":{view},"mimeType":"image/png"}}]"#));
    asset.glb()
}

/// `base()` whose mesh takes its positions from an accessor of this JSON; `VIEW` stands for a view of
/// `bytes`.
fn with_positions(bytes: &[u8], view_extra: &str, accessor: &str) -> Vec<u8> {
    let mut asset = base();
    let view = asset.view(bytes, view_extra);
    let accessor = asset.accessor(accessor.replace("VIEW", &view.to_string()));
    asset.set("meshes", format!(r#"[{{"primitives":[{{"attributes":{{"POSITION":{accessor}}}}}]}}]"#));
    asset.glb()
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn word(glb: &[u8], at: usize, value: u32) -> Vec<u8> {
    let mut glb = glb.to_vec();
    glb[at..at + 4].copy_from_slice(&value.to_le_bytes());
    glb
}

/// The header of a PNG that says it is of this size, right to its checksum.
fn huge_png(width: u32, height: u32) -> Vec<u8> {
    let mut bytes = png(1, &[[0; 4]]);
    bytes[16..20].copy_from_slice(&width.to_be_bytes());
    bytes[20..24].copy_from_slice(&height.to_be_bytes());
    let crc = bytes[12..29].iter().fold(!0_u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| (c >> 1) ^ (0xEDB8_8320 * (c & 1)))
    });
    bytes[29..33].copy_from_slice(&(!crc).to_be_bytes());
    bytes
}

/// Name, bytes, and a part of the message that it must have.
fn corpus() -> Vec<(&'static str, Vec<u8>, &'static str)> {
    let sound = base().glb();
    let vec3 = r#""componentType":5126,"type":"VEC3","min":[0,0,0],"max":[1,1,1]"#;
    let nine = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    let with_nan = floats(&[0.0, 0.0, 0.0, 1.0, f32::NAN, 0.0, 0.0, 1.0, 0.0]);
    let positions = |count: &str, extra: &str| {
        with_positions(&nine, "", &format!(r#"{{"bufferView":VIEW,"count":{count},{vec3}{extra}}}"#))
    };
    let sparse = |count: &str, indices: &[u8]| {
        let mut asset = base();
        let (i, v) = (asset.view(indices, ""), asset.view(&nine, ""));
        let accessor = asset.accessor(format!(
            r#"{{"count":3,{vec3},"sparse":{{"count":{count},"indices":{{"bufferView":{i},"componentType":5121}},"values":{{"bufferView":{v}}}}}}}"#
        ));
        asset.set("meshes", format!(r#"[{{"primitives":[{{"attributes":{{"POSITION":{accessor}}}}}]}}]"#));
        asset.glb()
    };
    let mut bad_png = png(4, &[[1, 2, 3, 255]; 16]);
    let middle = bad_png.len() - 20;
    bad_png[middle] ^= 0xff;
    let mut cut_jpeg = jpeg(32, 32);
    cut_jpeg.truncate(40);
    let bin_header = 20 + u32::from_le_bytes([sound[12], sound[13], sound[14], sound[15]]) as usize;
    let deep =
        format!(r#"{{"asset":{{"version":"2.0"}},"extras":{}{}}}"#, "[".repeat(50_000), "]".repeat(50_000));
    let chain: Vec<String> = (0..3000).map(|i| format!(r#"{{"children":[{}]}}"#, i + 1)).collect();

    vec![
        ("empty", vec![], "is empty"),
        ("blank", b" \n\t ".to_vec(), "is empty"),
        ("text", b"hello".to_vec(), "neither glTF JSON nor binary glTF"),
        ("magic", [b"glTX", &sound[4..]].concat(), "neither glTF"),
        ("header-cut", sound[..7].to_vec(), "ends within its header"),
        ("version-1", word(&sound, 4, 1), "is version 1"),
        ("length-small", word(&sound, 8, 3), "no JSON chunk"),
        ("length-large", word(&sound, 8, u32::MAX), "cut short"),
        ("truncated", sound[..sound.len() / 2].to_vec(), "cut short"),
        ("json-chunk-long", word(&sound, 12, u32::MAX), "ends before"),
        ("json-chunk-short", word(&sound, 12, 16), "ends before"),
        ("json-chunk-kind", word(&sound, 16, 7), "no JSON chunk"),
        ("bin-chunk-long", word(&sound, bin_header, 1 << 30), "ends before"),
        ("json-not-utf8", edited("\"2.0\"", "\"2.\u{0}\""), "JSON"),
        ("json-broken", edited("{\"asset\"", "{\"asset\"}"), "JSON"),
        ("json-deep", deep.into_bytes(), "deep"),
        ("no-asset", edited("\"asset\"", "\"asses\""), "asset"),
        ("gigantic-index", edited("\"mesh\":0", "\"mesh\":4294967296"), "nodes[1].mesh"),
        ("mesh-out-of-range", edited("\"mesh\":0", "\"mesh\":7"), "index out of bounds"),
        ("accessor-out-of-range", edited("\"POSITION\":0", "\"POSITION\":99"), "POSITION"),
        ("indices-out-of-range", edited("\"indices\":2", "\"indices\":4000000000"), "index out of bounds"),
        ("index-not-a-number", edited("\"mesh\":0", "\"mesh\":-1"), "JSON"),
        ("scene-out-of-range", edited("\"scene\":0", "\"scene\":3"), "index out of bounds"),
        ("no-position", edited("\"POSITION\"", "\"NORMAL\""), "POSITION"),
        (
            "vertex-out-of-range",
            {
                let mut asset = base();
                let i = asset.indices(&[0, 1, 3]);
                asset.set(
                    "meshes",
                    format!(r#"[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":{i}}}]}}]"#),
                );
                asset.glb()
            },
            "index 2 names vertex 3 of 3",
        ),
        ("count-gigantic", positions("4611686018427387904", ""), "max_accessor_elements"),
        ("count-too-large", positions("4", ""), "do not fit"),
        ("count-zero", positions("0", ""), "is empty"),
        ("offset-gigantic", positions("3", r#","byteOffset":18446744073709551615"#), "do not fit"),
        (
            "stride-overflow",
            edited("\"byteLength\":36", "\"byteLength\":36,\"byteStride\":18446744073709551615"),
            "invalid value",
        ),
        (
            "stride-small",
            with_positions(
                &nine,
                r#","byteStride":8"#,
                &format!(r#"{{"bufferView":VIEW,"count":3,{vec3}}}"#),
            ),
            "stride of 8",
        ),
        (
            "view-gigantic",
            edited("\"byteLength\":36", "\"byteLength\":18446744073709551615"),
            "outside its buffer",
        ),
        (
            "view-offset-gigantic",
            edited("\"byteOffset\":0", "\"byteOffset\":18446744073709551615"),
            "outside its buffer",
        ),
        (
            "buffer-too-long",
            edited("\"buffers\":[{\"byteLength\":", "\"buffers\":[{\"byteLength\":9"),
            "bytes but has",
        ),
        ("buffer-missing", glb(&base().json(), &[]), "no binary chunk"),
        (
            "position-nan",
            with_positions(&with_nan, "", &format!(r#"{{"bufferView":VIEW,"count":3,{vec3}}}"#)),
            "POSITION of vertex 1",
        ),
        (
            "position-u16",
            with_positions(
                &nine,
                "",
                r#"{"bufferView":VIEW,"count":3,"componentType":5123,"type":"VEC3","min":[0,0,0],"max":[1,1,1]}"#,
            ),
            "wrong type VEC3 of u16",
        ),
        ("position-without-data", with_positions(&nine, "", &format!(r#"{{"count":3,{vec3}}}"#)), "missing"),
        ("sparse-gigantic", sparse("4000000000", &[0, 1, 2]), "replaces 4000000000"),
        ("sparse-disordered", sparse("3", &[0, 2, 1]), "out of order"),
        ("sparse-out-of-range", sparse("3", &[0, 1, 3]), "not below 3"),
        (
            "matrix-infinite",
            edited("{\"mesh\":0", "{\"matrix\":[1e39,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1],\"mesh\":0"),
            "node 1: transform is not finite",
        ),
        (
            "matrix-projective",
            edited("{\"mesh\":0", "{\"matrix\":[1,0,0,1,0,1,0,0,0,0,1,0,0,0,0,1],\"mesh\":0"),
            "last row",
        ),
        ("scale-overflow", edited("{\"mesh\":0", "{\"scale\":[1e38,1,1],\"mesh\":0"), "scale the scene down"),
        (
            "quaternion-zero",
            edited("{\"mesh\":0", "{\"rotation\":[0,0,0,0],\"mesh\":0"),
            "quaternion of length 0",
        ),
        ("nodes-cyclic", edited("{\"mesh\":0", "{\"children\":[0],\"mesh\":0"), "node 0: is reached twice"),
        ("node-own-child", edited("{\"children\":[1]}", "{\"children\":[0]}"), "reached twice"),
        ("node-two-parents", edited("[{\"children\":[1]}", "[{\"children\":[1,1]}"), "reached twice"),
        (
            "nodes-deep",
            {
                let mut asset = base();
                asset.set("nodes", format!("[{},{{}}]", chain.join(",")));
                asset.glb()
            },
            "max_node_depth",
        ),
        (
            "buffer-file-missing",
            base().json_with_buffer(r#"{"byteLength":100,"uri":"none.bin"}"#).into_bytes(),
            "none.bin",
        ),
        (
            "buffer-base64-bad",
            base().json_with_buffer(r#"{"byteLength":100,"uri":"data:;base64,@@@@"}"#).into_bytes(),
            "data URI",
        ),
        (
            "buffer-uri-not-utf8",
            base().json_with_buffer(r#"{"byteLength":100,"uri":"%ff%fe.bin"}"#).into_bytes(),
            "not UTF-8",
        ),
        (
            "buffer-outside",
            base().json_with_buffer(r#"{"byteLength":100,"uri":"../../secret.bin"}"#).into_bytes(),
            "scene's folder",
        ),
        ("png-corrupt", with_image(&bad_png), "cannot be decoded"),
        ("png-cut", with_image(&png(4, &[[1; 4]; 16])[..40]), "image 0"),
        ("png-empty", with_image(&[0]), "neither PNG nor JPEG"),
        ("png-huge", with_image(&huge_png(60_000, 60_000)), "max_texture_pixels"),
        ("png-gigantic", with_image(&huge_png(u32::MAX >> 1, u32::MAX >> 1)), "image 0"),
        ("jpeg-cut", with_image(&cut_jpeg), "cannot be decoded"),
        ("image-view-outside", edited("\"byteOffset\":68", "\"byteOffset\":99999"), "outside its buffer"),
        ("image-without-source", edited("\"bufferView\":3,\"mimeType\":\"image/png\"", ""), "images[0]"),
        ("texture-without-source", edited("\"source\":0", "\"sampler\":0"), "textures[0]"),
        (
            "intensity-negative",
            edited("\"intensity\":2", "\"intensity\":-2"),
            "light 1 \"lamp\": intensity is -2",
        ),
        ("intensity-nan", edited("\"intensity\":2", "\"intensity\":NaN"), "lights[1].intensity: is NaN"),
        (
            "intensity-infinite",
            edited("\"intensity\":2", "\"intensity\":1e39"),
            "light 1 \"lamp\": intensity is inf",
        ),
        ("light-color-negative", edited("\"intensity\":2", "\"color\":[1,-1,1]"), "light 1 \"lamp\": colour"),
        ("light-out-of-range", edited("\"light\":1", "\"light\":2"), "index out of bounds"),
        ("spot-without-angles", edited("\"type\":\"point\",\"name\"", "\"type\":\"spot\",\"name\""), "spot"),
        (
            "spot-angles-crossed",
            edited(
                "\"type\":\"point\",\"name\"",
                "\"type\":\"spot\",\"spot\":{\"innerConeAngle\":1.0,\"outerConeAngle\":0.5},\"name\"",
            ),
            "cone angles",
        ),
        (
            "emission-negative",
            edited("\"emissiveFactor\":[1,", "\"emissiveFactor\":[-1,"),
            "material 0: emissive factor is -1",
        ),
        ("emission-infinite", edited("\"emissiveFactor\":[1,", "\"emissiveFactor\":[1e39,"), "material 0"),
        (
            "base-color-infinite",
            edited("\"baseColorTexture\"", "\"baseColorFactor\":[1e39,1,1,1],\"baseColorTexture\""),
            "base colour",
        ),
        (
            "camera-without-lens",
            {
                let mut asset = base();
                asset.set(
                    "cameras",
                    r#"[{"type":"perspective","orthographic":{"xmag":1,"ymag":1,"zfar":2,"znear":1}}]"#,
                );
                asset.glb()
            },
            "cameras[0]",
        ),
        (
            "camera-too-wide",
            {
                let mut asset = base();
                asset.set("cameras", r#"[{"type":"perspective","perspective":{"yfov":4.0,"znear":1}}]"#);
                asset.set("nodes", r#"[{"camera":0}]"#);
                asset.glb()
            },
            "angle of view is 4",
        ),
        (
            "extension-required",
            {
                let mut asset = base();
                asset.set("extensionsRequired", r#"["KHR_draco_mesh_compression"]"#);
                asset.glb()
            },
            "KHR_draco_mesh_compression",
        ),
        (
            "name-with-line-break",
            edited("\"name\":\"lamp\",\"intensity\":2", "\"name\":\"la\\nmp\",\"intensity\":-2"),
            "intensity",
        ),
    ]
}

/// Largest resident memory of this process so far in KiB, where the system tells.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

#[test]
fn the_base_of_the_corpus_is_sound() {
    let folder = Folder::new("corpus-base");
    let scene = load(&folder.write("base.glb", &base().glb()), &ImportOptions::default()).unwrap();
    sound::assert_sound(&scene);
    assert_eq!((scene.triangle_count(), scene.lights.len(), scene.textures.len()), (1, 2, 1));
}

/// What is wrong with the way in which `load` takes the file at `path`, whose message should have `part` in
/// it; else the message without the path.
fn verdict(
    path: &Path,
    part: &str,
    patience: Duration,
    load: impl Fn(&Path, &ImportOptions) -> Result<Scene, ImportError>,
) -> Result<String, String> {
    let start = Instant::now();
    let loaded = catch_unwind(AssertUnwindSafe(|| match load(path, &ImportOptions::default()) {
        Ok(scene) => Err(format!("was imported: {:?}", scene.notes)),
        Err(error) => Ok(error.to_string()),
    }));
    let message = loaded.map_err(|_| "panicked".to_owned())??;
    if start.elapsed() >= patience {
        return Err(format!("took {:?}", start.elapsed()));
    }
    let Some(problem) = message.strip_prefix(&format!("{}: ", path.display())) else {
        return Err(format!("does not begin with its name: {message}"));
    };
    if message.contains(['\n', '\r']) {
        return Err(format!("has more than one line: {message}"));
    }
    if !message.contains(part) {
        return Err(format!("expected {part:?} in: {message}"));
    }
    Ok(problem.to_owned())
}

#[test]
fn every_broken_file_is_an_error_of_one_line_that_names_it() {
    let folder = Folder::new("corpus");
    let corpus = corpus();
    let (mut wrong, mut files, mut problems) = (Vec::new(), HashSet::new(), HashSet::new());
    let before = peak_memory();
    for (name, bytes, part) in &corpus {
        let path = folder.write(&format!("{name}.glb"), bytes);
        match verdict(&path, part, PATIENCE, load) {
            Ok(problem) => {
                problems.insert(problem);
            }
            Err(why) => wrong.push(format!("{name}: {why}")),
        }
        if !files.insert(bytes) {
            wrong.push(format!("{name} is another file once more"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    // Those that differ and end in the same message count once.
    assert!(problems.len() >= 30, "{} different problems", problems.len());
    if let (Some(before), Some(after)) = (before, peak_memory()) {
        assert!(after - before < 256 << 10, "the corpus took {} MiB", (after - before) >> 10);
    }
}

/// Negative controls: an importer that panics, takes what is broken, dawdles, hides which file it is or says
/// the wrong thing is found out.
#[test]
fn the_corpus_finds_a_bad_importer_out() {
    let folder = Folder::new("corpus-control");
    let (sound, broken) = (folder.write("sound.glb", &base().glb()), folder.write("broken.glb", b"hello"));
    let found =
        |path: &Path, part: &str, load: &dyn Fn(&Path, &ImportOptions) -> Result<Scene, ImportError>| {
            verdict(path, part, PATIENCE, load).unwrap_err()
        };
    assert!(verdict(&broken, "neither glTF", PATIENCE, load).is_ok());
    assert!(found(&sound, "", &load).starts_with("was imported"));
    assert!(found(&broken, "", &|_, _| Ok(Scene::default())).starts_with("was imported"));
    assert_eq!(found(&broken, "", &|_, _| panic!("on purpose")), "panicked");
    assert!(found(&broken, "something else", &load).starts_with("expected"));
    // Of another file.
    assert!(found(&broken, "", &|_, o| load(Path::new("none.glb"), o)).starts_with("does not begin"));
    assert!(verdict(&broken, "", Duration::ZERO, load).unwrap_err().starts_with("took"));
}

/// Negative control of what is called sound: scenes that break a promise are none.
#[test]
fn scenes_that_break_a_promise_are_not_sound() {
    let folder = Folder::new("corpus-unsound");
    let whole = load(&folder.write("whole.glb", &base().glb()), &ImportOptions::default()).unwrap();
    type Break = (&'static str, fn(&mut Scene));
    let breaks: [Break; 8] = [
        ("a vertex out of range", |s| s.meshes[0].triangles[0][1] = 99),
        ("a vertex that is no number", |s| s.meshes[0].positions[0].x = f32::NAN),
        ("a material out of range", |s| s.meshes[0].material = 99),
        ("a mesh out of range", |s| s.instances[0].mesh = 99),
        ("a transform without inverse", |s| s.instances[0].to_world.matrix3.x_axis *= 0.0),
        ("a texture without texels", |s| s.textures[0].texels.clear()),
        ("a negative emission", |s| s.materials[0].emissive.x = -1.0),
        ("a light without place", |s| {
            s.lights.push(Light::Point { position: Vec3::NAN, intensity: Vec3::ONE });
        }),
    ];
    for (what, break_it) in breaks {
        let mut scene = whole.clone();
        break_it(&mut scene);
        assert!(
            catch_unwind(AssertUnwindSafe(|| sound::assert_sound(&scene))).is_err(),
            "{what} is not seen"
        );
    }
}

#[test]
fn what_is_no_file_is_an_error() {
    let folder = Folder::new("no-file");
    let inside = folder.write("folder/x", b"");
    let folder_path = inside.parent().unwrap();
    for path in [folder_path, Path::new("/dev/zero"), Path::new(""), Path::new("none.glb")] {
        let message = load(path, &ImportOptions::default()).unwrap_err().to_string();
        assert!(message.contains("cannot be read") && !message.contains('\n'), "{message}");
    }
}

/// Loads mutations of `bytes`, `cases` of them, from a fixed seed; each must give a sound scene or an error
/// of one line.
fn mutate(name: &str, bytes: &[u8], seed: u32, cases: u32) {
    let imported = imported_mutations(name, bytes, seed, cases, load).unwrap_or_else(|why| panic!("{why}"));
    eprintln!("{name}: {imported} of {cases} mutations were imported");
    assert!(imported > 0 && imported < cases, "mutations should break some files and leave some whole");
}

/// How many of the mutations `load` imported, or the first that it took badly.
fn imported_mutations(
    name: &str,
    bytes: &[u8],
    seed: u32,
    cases: u32,
    load: impl Fn(&Path, &ImportOptions) -> Result<Scene, ImportError>,
) -> Result<u32, String> {
    let folder = Folder::new(&format!("mutation-{name}"));
    // Small limits, so that a case that asks for much is quick; they are not what is tested.
    let limits = ImportLimits {
        max_accessor_elements: 1 << 20,
        max_texture_pixels: 1 << 22,
        ..ImportLimits::default()
    };
    let options = ImportOptions { limits, ..ImportOptions::default() };
    let mut imported = 0;
    for case in 0..cases {
        let path = folder.write("case.glb", &mutation(bytes, &mut Random::new(seed, 0, case)));
        let start = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| match load(&path, &options) {
            Ok(scene) => {
                sound::assert_sound(&scene);
                true
            }
            Err(error) => {
                assert!(!error.to_string().contains('\n'));
                false
            }
        }));
        match result {
            Ok(loaded) => imported += u32::from(loaded),
            Err(_) => return Err(format!("{name}: seed {seed}, case {case} panicked")),
        }
        if start.elapsed() >= PATIENCE {
            return Err(format!("{name}: seed {seed}, case {case} took {:?}", start.elapsed()));
        }
    }
    Ok(imported)
}

/// Negative control: an importer that panics on one mutation in a hundred, or lets an index out of range
/// through, is found out.
#[test]
fn mutations_find_a_bad_importer_out() {
    let bytes = base().glb();
    let calls = AtomicU32::new(0);
    let panics = |path: &Path, options: &ImportOptions| {
        assert!(calls.fetch_add(1, Ordering::Relaxed) != 99, "on purpose");
        load(path, options)
    };
    let found = imported_mutations("control-panic", &bytes, 1, 200, panics).unwrap_err();
    assert_eq!(found, "control-panic: seed 1, case 99 panicked");
    let unsound = |path: &Path, options: &ImportOptions| {
        let mut scene = load(path, options)?;
        if let Some(mesh) = scene.meshes.first_mut() {
            mesh.triangles.push([0, 0, u32::MAX]);
        }
        Ok(scene)
    };
    assert!(imported_mutations("control-unsound", &bytes, 1, 200, unsound).is_err());
}

/// Flips bytes or digits, cuts, repeats, or splices.
fn mutation(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let below = |random: &mut Random, n: usize| (random.f64() * n as f64) as usize;
    for _ in 0..1 + below(random, 4) {
        let at = below(random, bytes.len());
        let length = below(random, 40).min(bytes.len() - at);
        match below(random, 8) {
            0 => bytes[at] ^= 1 << below(random, 8),
            1 => bytes[at] = random.u32() as u8,
            2 if bytes.len() > 100 => bytes.truncate(at.max(50)),
            3 => {
                let to = below(random, bytes.len());
                let piece = bytes[at..at + length].to_vec();
                let end = (to + length).min(bytes.len());
                bytes.splice(to..end, piece);
            }
            4 => {
                bytes.drain(at..at + length.min(bytes.len() / 4));
            }
            // A digit of the JSON text for another: counts, offsets and indices that parse.
            _ => {
                let json = 20..bytes.len().min(8000);
                let digits: Vec<usize> = json.filter(|&i| bytes[i].is_ascii_digit()).collect();
                if !digits.is_empty() {
                    bytes[digits[below(random, digits.len())]] = b'0' + below(random, 10) as u8;
                }
            }
        }
        if bytes.is_empty() {
            break;
        }
    }
    bytes
}

#[test]
fn mutations_of_a_small_file_never_panic() {
    mutate("small", &base().glb(), 1, 2000);
    // A JPEG, strips, sparse values and a camera.
    let mut asset = base();
    let view = asset.view(&jpeg(9, 7), "");
    asset.set("images", format!(r#"[{{"bufferView":{view},"mimeType":"image/jpeg"}}]"#));
    let (i, v) = (asset.view(&[1, 2], ""), asset.view(&floats(&[1.0; 6]), ""));
    let p = asset.accessor(format!(
        r#"{{"count":9,"componentType":5126,"type":"VEC3","min":[0,0,0],"max":[1,1,1],"sparse":{{"count":2,"indices":{{"bufferView":{i},"componentType":5121}},"values":{{"bufferView":{v}}}}}}}"#
    ));
    asset.set(
        "meshes",
        format!(r#"[{{"primitives":[{{"attributes":{{"POSITION":{p}}},"mode":5,"material":0}}]}}]"#),
    );
    asset.set("cameras", r#"[{"type":"perspective","perspective":{"yfov":0.7,"znear":0.1}}]"#);
    asset.set(
        "nodes",
        r#"[{"children":[1]},{"mesh":0,"camera":0,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,3,4,5,1]}]"#,
    );
    mutate("rich", &asset.glb(), 2, 2000);
}

#[test]
fn mutations_of_a_real_file_never_panic() {
    let folder = match std::env::var_os("LIGHTTREE_SCENES") {
        Some(folder) => PathBuf::from(folder),
        None => PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/scenes"),
    };
    match std::fs::read(folder.join("cornell-box.glb")) {
        Ok(bytes) => mutate("cornell", &bytes, 3, 1000),
        Err(_) => eprintln!("skipped: no cornell-box.glb in {}; set LIGHTTREE_SCENES", folder.display()),
    }
}
