//! How many draws a chi-square test takes where many cases are tested.

/// `few`, or a million with `LIGHTTREE_MILLION_DRAWS` set: minutes in the release profile.
pub(crate) fn draws(few: u32) -> u32 {
    if std::env::var_os("LIGHTTREE_MILLION_DRAWS").is_some() { 1_000_000 } else { few }
}
