//! What made a figure: program, sources, call and machine, so that it can be made again and judged.

use std::process::{Command, Stdio};
use std::time::{SystemTime, UNIX_EPOCH};

use serde_json::{Value, json};

use crate::cargo::workspace_root;

/// The call, the program and the machine, for files that hold figures.
pub(crate) fn provenance() -> Value {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    json!({
        "program": concat!("lighttree xtask ", env!("CARGO_PKG_VERSION")),
        "commit": commit(),
        "profile": if cfg!(debug_assertions) { "with debug assertions" } else { "release" },
        "command": command(),
        "unix_seconds": since,
        "machine": {
            "processor": processor(),
            "processors": std::thread::available_parallelism().ok().map(usize::from),
            "os": std::env::consts::OS,
            "arch": std::env::consts::ARCH,
        },
    })
}

/// What the numbers of a comparison or a report are measured in; [`scene::Errors`] has the formulas.
pub(crate) fn units() -> Value {
    json!({
        "seconds": "s, wall clock",
        "mse": "(W/m2/sr)^2, mean over pixels and channels of (t - r)^2",
        "relmse": "1, mean over pixels and channels of (t - r)^2 / (r^2 + 0.01 mean(r)^2)",
        "mape": "1, mean over pixels and channels of |t - r| / (|r| + 0.01 mean(r))",
        "bias": "1, mean(t) / mean(r) - 1",
        "ssim": "1, structural similarity of the tone-mapped pictures, 1 is the same",
        "flip": "1, mean FLIP of the tone-mapped pictures at 67 pixels per degree, 0 is the same",
        "pictures": "EXR: linear RGB radiance, W/m2/sr; PNG: sRGB of that times 2^exposure",
    })
}

/// The processor and how many threads of it were used, in half a sentence.
pub(crate) fn machine_line(threads: usize) -> String {
    let processor = processor().unwrap_or_else(|| std::env::consts::ARCH.to_owned());
    format!("{threads} threads of {processor}")
}

/// The call as it can be given to a shell.
fn command() -> String {
    let quoted = |word: String| {
        let plain = |c: char| c.is_alphanumeric() || "-_./:,=+@".contains(c);
        if !word.is_empty() && word.chars().all(plain) {
            word
        } else {
            format!("'{}'", word.replace('\'', "'\\''"))
        }
    };
    let words = std::env::args_os().skip(1).map(|word| quoted(word.to_string_lossy().into_owned()));
    ["cargo".to_owned(), "xtask".to_owned()].into_iter().chain(words).collect::<Vec<_>>().join(" ")
}

/// Of the sources, with `-dirty` behind it where they were changed; `None` outside of a clone.
fn commit() -> Option<String> {
    let mut git = Command::new("git");
    git.args(["describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]);
    let output = git.current_dir(workspace_root()).stderr(Stdio::null()).output().ok()?;
    let name = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    (output.status.success() && !name.is_empty()).then_some(name)
}

/// As Linux names it; `None` elsewhere.
fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}
