//! How kernels are put together: plain WGSL files, one after the other.
//!
//! WGSL's declarations see one another in any order within a module, so a module is a list of files and
//! nothing else: no preprocessor, no build script, and every file can be edited and checked with ordinary
//! tools. Considered and left out: `naga_oil` (its shaders are no longer plain WGSL, and need a feature of
//! wgpu that others do not), WESL (compiles as long as wgpu does). What differs between variants is an
//! `override` constant, set where the pipeline is made. Files in `shaders/lib/` declare no bindings; each
//! kernel's own file does, and `draws.wgsl` and `two_level.wgsl` for several.

/// The text of one module.
#[derive(Clone, Copy, Debug)]
pub struct Source {
    /// Name of the module, for labels and messages.
    pub name: &'static str,
    /// All of its WGSL, but for a host's receivers if it [asks for them](Self::takes_receiver).
    pub text: &'static str,
    /// Whether the WGSL of a receiver has to be added: [`DEFAULT_RECEIVER`](crate::DEFAULT_RECEIVER) or the
    /// host's own.
    pub takes_receiver: bool,
}

/// A module of these files below `shaders/`.
macro_rules! source {
    ($name:literal, $($file:literal),+ $(,)?) => {
        crate::source::Source {
            name: $name,
            text: concat!($(include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders/", $file)), "\n"),+),
            takes_receiver: false,
        }
    };
    ($name:literal, receiver, $($file:literal),+ $(,)?) => {
        crate::source::Source { takes_receiver: true, ..crate::source::source!($name, $($file),+) }
    };
}
pub(crate) use source;

/// The same for a kernel that draws: with receivers, the tree, walks down it, and what all of these bind.
macro_rules! drawing_source {
    ($name:literal, $($file:literal),+ $(,)?) => {
        crate::source::source!(
            $name, receiver, "lib/records.wgsl", "lib/grid.wgsl", "lib/wide.wgsl", "lib/light.wgsl", "lib/random.wgsl",
            "lib/request.wgsl", "lib/toward.wgsl", "lib/walk.wgsl", "draws.wgsl", $($file),+
        )
    };
}
pub(crate) use drawing_source;

/// Every module of this crate: what tests validate.
pub const ALL: &[Source] = &[
    crate::tree::SURVEY,
    crate::tree::MORTON,
    crate::tree::SORT,
    crate::tree::BITONIC,
    crate::tree::NODES,
    crate::draw::DRAW_TREE,
    crate::draw::DRAW_CUT,
    crate::draw::DRAW_SHARED,
    crate::draw::DRAW_GUARDED,
    crate::two_level::DRAW_TREE,
    crate::two_level::DRAW_CUT,
    crate::two_level::DRAW_SHARED,
    crate::two_level::DRAW_GUARDED,
    crate::two_level::PLACE,
    crate::rays::CLOSEST,
    crate::rays::CLOSEST_INSTANCE,
    crate::rays::OCCLUDED,
    crate::shade::SHADE,
    crate::filter::SOURCES[0],
    crate::filter::SOURCES[1],
    crate::filter::SOURCES[2],
    crate::filter::SOURCES[3],
    crate::filter::SOURCES[4],
    crate::filter::SOURCES[5],
    crate::filter::SOURCES[6],
    crate::filter::SOURCES[7],
    crate::filter::SOURCES[8],
    crate::filter::SOURCES[9],
    crate::filter::SOURCES[10],
    crate::filter::SOURCES[11],
    crate::filter::SOURCES[12],
    crate::cdf::DRAW_CDF,
    crate::cdf::LEARN,
];
