//! The one program of the workspace: `cargo xtask`.

mod adapter;
mod bake;
mod bench;
mod cargo;
mod check;
mod compare;
mod curves;
mod device;
mod failure;
mod frames;
mod html;
mod inspect;
mod memory;
mod methods;
mod output;
mod progress;
mod provenance;
mod render;
mod report;
mod settings;
mod shot;
mod source;
mod stop;
mod test;
mod trees;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use failure::Failure;

/// Renders scenes lit by very many lights, and looks after the workspace that does it.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", version, disable_help_subcommand = true)]
struct Program {
    #[command(subcommand)]
    command: Subject,
}

#[derive(Subcommand)]
enum Subject {
    /// Render one scene with one method: a picture as EXR and PNG, and what it took
    Render(Box<render::RenderArgs>),
    /// Compare methods on one scene, at equal time against one reference: a table, a page, pictures and data
    Compare(Box<compare::CompareArgs>),
    /// Say what a scene holds, and how light trees over it turn out
    Inspect(inspect::InspectArgs),
    /// Bake a scene's light into lightmaps, and let them follow edits: maps, the scene with coordinates to
    /// look them up, and a saved bake
    Bake(Box<bake::BakeArgs>),
    /// Measure how fast the crates are: criterion benchmarks, with curves under target/criterion
    Bench(bench::BenchArgs),
    /// Measure what each method gives for its time, dial by dial: curves of error against time, a page,
    /// pictures and data
    Report(Box<curves::ReportArgs>),
    /// Set up what the tests need and run all of them, examples and documentation included
    Test(test::TestArgs),
    /// Check everything that needs no test run: format, lints, documentation, licences, manifests
    Check,
}

fn main() -> ExitCode {
    one_line_for_bugs();
    let outcome = match Program::try_parse() {
        Ok(program) => run(&program.command),
        Err(error) if error.use_stderr() => Err(Failure::usage(first_paragraph(&error))),
        Err(help) => {
            let _ = help.print();
            Ok(())
        }
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("{failure}");
            ExitCode::from(failure.exit_code())
        }
    }
}

fn run(command: &Subject) -> Result<(), Failure> {
    match command {
        Subject::Render(args) => render::render(args),
        Subject::Compare(args) => compare::compare(args),
        Subject::Inspect(args) => inspect::inspect(args),
        Subject::Bake(args) => bake::bake(args),
        Subject::Bench(args) => bench::bench(args),
        Subject::Report(args) => curves::report(args),
        Subject::Test(args) => test::test(args),
        Subject::Check => check::check(),
    }
}

/// A bug of ours is one line as well, with its place; the default hook's text is for people with the source
/// open.
fn one_line_for_bugs() {
    std::panic::set_hook(Box::new(|panic| {
        let place = panic.location().map_or_else(String::new, |at| format!("{}:{}: ", at.file(), at.line()));
        let text =
            panic.payload_as_str().unwrap_or("no message").split_whitespace().collect::<Vec<_>>().join(" ");
        eprintln!("error: internal, {place}{text}; please report it with the command line");
        std::process::exit(1);
    }));
}

/// clap's message in a line: what is wrong, what was meant, and where the right call is written.
fn first_paragraph(error: &clap::Error) -> String {
    let subject = std::env::args().nth(1).filter(|word| !word.starts_with('-')).unwrap_or_default();
    let known = <Program as clap::CommandFactory>::command().find_subcommand(&subject).is_some();
    let command =
        if known { format!("cargo xtask {subject} --help") } else { "cargo xtask --help".to_owned() };
    if error.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return format!("no command is given: try `cargo xtask render`, or see `{command}`");
    }
    let text = error.to_string();
    let mut paragraphs = text.split("\n\n");
    let what = paragraphs.next().unwrap_or(&text).trim_start_matches("error: ").trim();
    let tip = paragraphs.find_map(|paragraph| paragraph.trim().strip_prefix("tip: "));
    let tip = tip.map_or_else(String::new, |tip| format!("; {}", tip.lines().next().unwrap_or_default()));
    format!("{}{tip}: see `{command}`", in_plain_words(what))
}

/// What the standard library and clap say of numbers, in words for people who don't write Rust.
fn in_plain_words(what: &str) -> String {
    for (technical, plain) in [
        ("invalid digit found in string", "write a whole number"),
        ("cannot parse integer from empty string", "write a whole number"),
        ("number too large to fit in target type", "write a smaller number"),
        ("invalid float literal", "write a number"),
    ] {
        if let Some(start) = what.strip_suffix(technical) {
            return format!("{start}{plain}");
        }
    }
    // "0 is not in 1..=1000000"
    let range =
        what.rsplit_once(" is not in ").and_then(|(start, range)| Some((start, range.split_once("..=")?)));
    match range {
        Some((start, (least, most))) => {
            let start = start.rsplit_once(": ").map_or(start, |(start, _)| start);
            format!("{start}: write a whole number from {least} to {most}")
        }
        None => what.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_command_line_is_well_formed() {
        <super::Program as clap::CommandFactory>::command().debug_assert();
    }

    #[test]
    fn ranges_and_slips_are_said_in_plain_words() {
        let line = |args: &[&str]| {
            let error = <super::Program as clap::Parser>::try_parse_from(args).err().expect("a bad call");
            super::first_paragraph(&error)
        };
        let spp = line(&["xtask", "render", "--spp", "0"]);
        assert!(spp.contains("'--spp <N>': write a whole number from 1 to 1000000: see"), "{spp}");
        let word = line(&["xtask", "render", "--spp", "many"]);
        assert!(word.contains("'--spp <N>': write a whole number: see"), "{word}");
        let slip = line(&["xtask", "render", "--metod", "tree"]);
        assert!(slip.contains("a similar argument exists: '--method'"), "{slip}");
        assert!(line(&["xtask"]).starts_with("no command is given"));
    }
}
