//! The one program of the workspace: `cargo xtask`.

fn main() {}
