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
    /// Bake a scene's light into lightmaps, and let them follow edits: maps, the scene with coordinates to look them up, and a saved bake
    Bake(Box<bake::BakeArgs>),
    /// Measure how fast the crates are: criterion benchmarks, with curves under target/criterion
    Bench(bench::BenchArgs),
    /// Measure what each method gives for its time, dial by dial: curves of error against time, a page, pictures and data
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

/// A bug of ours is one line as well, with its place; the default hook's text is for people with the source open.
fn one_line_for_bugs() {
    std::panic::set_hook(Box::new(|panic| {
        let place = panic.location().map_or_else(String::new, |at| format!("{}:{}: ", at.file(), at.line()));
        let text =
            panic.payload_as_str().unwrap_or("no message").split_whitespace().collect::<Vec<_>>().join(" ");
        eprintln!("error: internal, {place}{text}; please report it with the command line");
        std::process::exit(1);
    }));
}

/// clap's message without its usage and hints: what is wrong, and where the right call is written.
fn first_paragraph(error: &clap::Error) -> String {
    let text = error.to_string();
    let what = text.split("\n\n").next().unwrap_or(&text).trim_start_matches("error: ");
    let subject = std::env::args().nth(1).filter(|word| !word.starts_with('-')).unwrap_or_default();
    let known = <Program as clap::CommandFactory>::command().find_subcommand(&subject).is_some();
    let command =
        if known { format!("cargo xtask {subject} --help") } else { "cargo xtask --help".to_owned() };
    format!("{}: see `{command}`", what.trim())
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_command_line_is_well_formed() {
        <super::Program as clap::CommandFactory>::command().debug_assert();
    }
}
